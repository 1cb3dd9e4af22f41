"""Robot kind `fanuc`: client and emulated controller."""

from typing import Any

from emulators.seams import RobotFactory
from hil_bridge.devices.emulator_fit import RobotFigures, Sections, match_cycles
from hil_bridge.devices.facts import RobotFacts
from hil_bridge.devices.kinds import KindSettings, RobotEmulation, RobotKind
from hil_bridge.devices.robots.streamed import StreamedLink
from hil_bridge.devices.wiring import Serving, Wiring
from hil_bridge.errors import ConfigError
from hil_bridge.transports.urls import CONNECT_DATAGRAMS, WireUrl, parse_url
from hil_fanuc.channels import Pieces
from hil_fanuc.client import FanucClient
from hil_fanuc.controller import FanucController
from hil_fanuc.describe import describe
from hil_fanuc.facts import robot_facts
from hil_fanuc.faults import FANUC_FAULTS
from hil_fanuc.panel import FANUC_CONTROLS
from hil_fanuc.probing import ask_interface, probe
from hil_fanuc.profile import FanucProfile
from hil_fanuc.settings import FanucSettings
from hil_fanuc.trajectory import play
from hil_fanuc.wires import connect_wires, parse_address, serve_robot

Settings = KindSettings[FanucSettings, FanucProfile]


async def connect(url: str, settings: Settings, wiring: Wiring) -> StreamedLink[Pieces]:
    """Connect to the controller, without starting the link. Errors as for `RobotKind.connect`."""
    wires = await connect_wires(url, wiring)
    client = FanucClient(settings.client, wiring.clock.now())
    wires.client = client
    return StreamedLink(wires, client, facts(url, settings), wiring.clock, wiring.log)


def facts(url: str, settings: Settings) -> RobotFacts:
    """Return the facts of the robot before a wire is opened."""
    return robot_facts(settings.client, settings.emulated)


def make(settings: Settings) -> RobotFactory:
    """Return a factory of the controller that the configuration section of the cell describes."""
    return lambda start, now, seed: FanucController(settings.emulated, start, now, seed)


async def serve(url: str, robot: Any, settings: Settings, serving: Serving) -> str:
    """Let the emulated controller listen, and return the URL for its client."""
    return await serve_robot(url, robot, serving)


def usual(settings: Settings, virtual: bool) -> str:
    """Return the default URL to listen on."""
    return "udp+memory:fanuc" if virtual else "udp-bind://127.0.0.1:0"


def check(settings: Settings) -> None:
    """Raise ConfigError for an emulated controller that does not fit the client."""
    client, emulated = settings.client, settings.emulated
    if client.model != emulated.model:
        raise ConfigError(
            f"robot.fanuc.model is {client.model}, and cell.fanuc.model is {emulated.model}; make them equal"
        )


def match(settings: Settings, figures: RobotFigures) -> Sections:
    """Return the settings that give the emulated controller the latency of a measured one."""
    return match_cycles("cell.fanuc", settings.emulated, settings.emulated.cycle_ms, figures)


def _parse(url: str, settings: Settings) -> WireUrl:
    return parse_url(parse_address(url).stream, CONNECT_DATAGRAMS)


MISHAPS = {"refused": "emergency-stop", "stopped": "servo-alarm"}

ROBOT = RobotKind(
    "fanuc",
    "FANUC robot by Stream Motion and the Remote Motion Interface",
    FanucSettings,
    connect,
    facts,
    RobotEmulation(
        FanucProfile, make, serve, usual, FANUC_FAULTS, FANUC_CONTROLS, MISHAPS, play=play, match=match
    ),
    check=check,
    parse=_parse,
    describe=describe,
    probe=probe,
    read_side_channel=ask_interface,
    usual_wire="udp://{host}",
)
