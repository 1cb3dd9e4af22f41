"""Device package for Externally Guided Motion: kind of robot, client and emulator."""

import asyncio
import importlib.util
from typing import Any

from emulators.devices.egm import EGM_CONTROLS, EGM_FAULTS, EgmController, EgmProfile
from emulators.devices.egm.web_services import WebServices
from emulators.seams import RobotFactory
from hil_bridge.devices.facts import RobotFacts
from hil_bridge.devices.kinds import KindSettings, RobotEmulation, RobotKind
from hil_bridge.devices.robots.egm.emulator_fit import match
from hil_bridge.devices.robots.egm.facts import robot_facts
from hil_bridge.devices.robots.egm.settings import EgmSettings
from hil_bridge.devices.robots.egm.trajectory import play
from hil_bridge.devices.robots.egm.web_address import OPTION, WebAddress, split_web
from hil_bridge.devices.robots.probe import ProbeResult, mute, probe_link
from hil_bridge.devices.robots.streamed import StreamedLink
from hil_bridge.devices.wiring import Serving, Wiring
from hil_bridge.errors import ConfigError, DeviceError
from hil_bridge.errors.extras import install_command
from hil_bridge.transports import Datagrams
from hil_bridge.transports.urls import CONNECT_DATAGRAMS, LISTEN_DATAGRAMS, WireUrl, parse_url, with_option
from protocol.devices.egm import EgmClient, JointCheck, describe
from protocol.endpoint import Trouble
from protocol.kinematics import Arm

USUAL = "udp://127.0.0.1:6510"
"""Address to which the emulated robot sends in real time: the port of ABB's example and of other clients [M, O:flo]."""


async def connect(
    url: str, settings: KindSettings[EgmSettings, EgmProfile], wiring: Wiring
) -> StreamedLink[Datagrams]:
    """Connect to the robot that sends to this address, without starting the link. Errors as for `RobotKind.connect`."""
    url, _ = split_web(url)
    if "strangers" not in parse_url(url, LISTEN_DATAGRAMS).options:
        url = with_option(url, "strangers", "refuse")  # no other sender may replace the robot
    wire = await wiring.datagrams(url, speak_first=False)
    own: EgmSettings = settings.client
    joints = JointCheck(Arm(settings.emulated.arm, 0.0), own.joints_in)
    client = EgmClient(own.sample_ms * 1e-3, own.feed_forward, own.force_axes, joints)
    return StreamedLink(wire, client, facts(url, settings), wiring.clock, wiring.log)


async def probe(url: str, settings: KindSettings[EgmSettings, EgmProfile], wiring: Wiring) -> ProbeResult:
    """Probe a robot that sends to this address, and its web services if the URL contains their address."""
    datagrams, web_services = await asyncio.gather(
        probe_link(url, lambda silent: connect(url, settings, silent), mute(wiring)),
        ask_web(url),
        return_exceptions=True,
    )
    if isinstance(web_services, DeviceError):
        web_services = ProbeResult((("RobotWare", f"unknown: {web_services}"),))
    if isinstance(web_services, BaseException):
        raise web_services
    if isinstance(datagrams, DeviceError) and web_services.rows:
        datagrams = ProbeResult(
            (("datagrams", datagrams.fact),), (Trouble(datagrams.fact, datagrams.remedy),)
        )
    if isinstance(datagrams, BaseException):
        raise datagrams
    return datagrams.with_more(web_services)


async def ask_web(url: str) -> ProbeResult:
    """Read facts from a controller's web services. The result is empty if the URL does not contain their address.
    Raises DeviceError if the web services cannot be read.
    """
    _, address = split_web(url)
    if address is None:
        return ProbeResult(())
    _check_extra()
    from hil_bridge.devices.robots.egm.web_client import find_refusals, read_state, state_rows

    state = await read_state(address)
    return ProbeResult(state_rows(state), find_refusals(state))


def facts(url: str, settings: KindSettings[EgmSettings, EgmProfile]) -> RobotFacts:
    """Return the facts of the robot at a wire's URL."""
    return robot_facts(settings.client, settings.emulated)


def make(settings: KindSettings[EgmSettings, EgmProfile]) -> RobotFactory:
    """Return a factory of the controller that the configuration section of the cell describes."""
    return lambda start, now, seed: EgmController(settings.emulated, start, now, seed)


def check(settings: KindSettings[EgmSettings, EgmProfile]) -> None:
    """Raise ConfigError for settings of an emulated robot that a run cannot guide."""
    mode = settings.emulated.mode
    if mode != "pose":
        raise ConfigError(f'cell.egm.mode = "{mode}": a run sends poses; set mode = "pose"')


async def serve(
    url: str, robot: Any, settings: KindSettings[EgmSettings, EgmProfile], serving: Serving
) -> str:
    """Let the emulated controller send to this address, and return the URL for its client. If the URL contains an
    address for web services, they listen on it.
    """
    wire, address = split_web(url)
    if address is None:
        return await serving.serve_datagrams(wire, robot.endpoint, speak_first=True)
    _check_web(url, address)
    from hil_bridge.devices.robots.egm.web_server import WebServer  # importing aiohttp is slow

    server = WebServer(WebServices(robot, settings.emulated), serving)
    real = await server.listen(address)
    return with_option(
        await serving.serve_datagrams(wire, robot.endpoint, speak_first=True), OPTION, real.authority
    )


def _check_web(url: str, address: WebAddress) -> None:
    """Raise ConfigError if the web services cannot be served."""
    if parse_url(split_web(url)[0], CONNECT_DATAGRAMS).scheme == "udp+memory":
        raise ConfigError(f"{url!r}: web services are served in real time only; leave {OPTION} out")
    if not address.is_loopback:
        raise ConfigError(
            f"{url!r}: emulated web services listen on loopback only, such as {OPTION}=127.0.0.1:0"
        )
    _check_extra()


def _check_extra() -> None:
    """Raise ConfigError if the library for web services is missing."""
    if importlib.util.find_spec("aiohttp") is None:
        raise ConfigError(f"{OPTION} needs the extra web: {install_command('web')}")


def _parse(url: str, settings: KindSettings[EgmSettings, EgmProfile]) -> WireUrl:
    return parse_url(split_web(url)[0], LISTEN_DATAGRAMS)


def usual(settings: KindSettings[EgmSettings, EgmProfile], virtual: bool) -> str:
    """Return the default address to which the emulated controller sends."""
    return "udp+memory:egm" if virtual else USUAL


MISHAPS = {"refused": "motors-off", "stopped": "program-stopped"}

ROBOT = RobotKind(
    "egm",
    "ABB robot by Externally Guided Motion",
    EgmSettings,
    connect,
    facts,
    RobotEmulation(EgmProfile, make, serve, usual, EGM_FAULTS, EGM_CONTROLS, MISHAPS, play=play, match=match),
    check=check,
    parse=_parse,
    describe=describe,
    probe=probe,
    read_side_channel=ask_web,
    usual_wire="udp-bind://0.0.0.0:6510",
)
