"""The room of Externally Guided Motion, as the house sees it: its kind of robot, its client and its emulator."""

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
"""Where the emulated robot sends in real time: the port of ABB's example and of other clients [M, O:flo]."""


async def connect(
    url: str, settings: KindSettings[EgmSettings, EgmProfile], wiring: Wiring
) -> StreamedLink[Datagrams]:
    """The robot that sends to this address, not started yet. Errors as of `RobotKind.connect`."""
    url, _ = split_web(url)
    if "strangers" not in parse_url(url, LISTEN_DATAGRAMS).options:
        url = with_option(url, "strangers", "refuse")  # nothing else may take the robot's place
    wire = await wiring.datagrams(url, speak_first=False)
    own: EgmSettings = settings.client
    joints = JointCheck(Arm(settings.emulated.arm, 0.0), own.joints_in)
    client = EgmClient(own.sample_ms * 1e-3, own.feed_forward, own.force_axes, joints)
    return StreamedLink(wire, client, facts(url, settings), wiring.clock, wiring.log)


async def probe(url: str, settings: KindSettings[EgmSettings, EgmProfile], wiring: Wiring) -> ProbeResult:
    """Findings of a robot that sends to this address, and of its web services where the URL names them."""
    heard, beside = await asyncio.gather(
        probe_link(url, lambda silent: connect(url, settings, silent), mute(wiring)),
        ask_web(url),
        return_exceptions=True,
    )
    if isinstance(beside, DeviceError):
        beside = ProbeResult((("RobotWare", f"unknown: {beside}"),))
    if isinstance(beside, BaseException):
        raise beside
    if isinstance(heard, DeviceError) and beside.rows:
        heard = ProbeResult((("datagrams", heard.fact),), (Trouble(heard.fact, heard.remedy),))
    if isinstance(heard, BaseException):
        raise heard
    return heard.with_more(beside)


async def ask_web(url: str) -> ProbeResult:
    """Facts that a controller's web services tell; none where the URL names none. Raises DeviceError."""
    _, address = split_web(url)
    if address is None:
        return ProbeResult(())
    _check_extra()
    from hil_bridge.devices.robots.egm.web_client import find_refusals, read_state, state_rows

    state = await read_state(address)
    return ProbeResult(state_rows(state), find_refusals(state))


def facts(url: str, settings: KindSettings[EgmSettings, EgmProfile]) -> RobotFacts:
    """Facts of the robot behind a wire."""
    return robot_facts(settings.client, settings.emulated)


def make(settings: KindSettings[EgmSettings, EgmProfile]) -> RobotFactory:
    """The controller that a cell's section describes."""
    return lambda start, now, seed: EgmController(settings.emulated, start, now, seed)


def check(settings: KindSettings[EgmSettings, EgmProfile]) -> None:
    """Raise ConfigError for an emulated robot that no run can guide."""
    mode = settings.emulated.mode
    if mode != "pose":
        raise ConfigError(f'cell.egm.mode = "{mode}": a run guides by poses; set mode = "pose"')


async def serve(
    url: str, robot: Any, settings: KindSettings[EgmSettings, EgmProfile], serving: Serving
) -> str:
    """Let the emulated controller send to this address; the URL at which its client listens. Its web services listen
    where the URL names an address of theirs.
    """
    wire, address = split_web(url)
    if address is None:
        return await serving.serve_datagrams(wire, robot.endpoint, speak_first=True)
    _check_web(url, address)
    from hil_bridge.devices.robots.egm.web_server import WebServer  # aiohttp takes its time to import

    server = WebServer(WebServices(robot, settings.emulated), serving)
    real = await server.listen(address)
    return with_option(
        await serving.serve_datagrams(wire, robot.endpoint, speak_first=True), OPTION, real.authority
    )


def _check_web(url: str, address: WebAddress) -> None:
    """Raise ConfigError where web services cannot be served."""
    if parse_url(split_web(url)[0], CONNECT_DATAGRAMS).scheme == "udp+memory":
        raise ConfigError(f"{url!r}: web services are served in real time only; leave {OPTION} out")
    if not address.is_loopback:
        raise ConfigError(
            f"{url!r}: emulated web services listen on loopback only, such as {OPTION}=127.0.0.1:0"
        )
    _check_extra()


def _check_extra() -> None:
    """Raise ConfigError without the library of web services."""
    if importlib.util.find_spec("aiohttp") is None:
        raise ConfigError(f"{OPTION} needs the extra web: {install_command('web')}")


def _parse(url: str, settings: KindSettings[EgmSettings, EgmProfile]) -> WireUrl:
    return parse_url(split_web(url)[0], LISTEN_DATAGRAMS)


def usual(settings: KindSettings[EgmSettings, EgmProfile], virtual: bool) -> str:
    """The address that it sends to where none is named."""
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
