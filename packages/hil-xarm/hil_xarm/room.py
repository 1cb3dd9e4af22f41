"""Robot kind `xarm`: client and emulated control box."""

from typing import Any

from emulators.seams import RobotFactory
from hil_bridge.devices.emulator_fit import RobotFigures, Sections, match_cycles
from hil_bridge.devices.facts import RobotFacts
from hil_bridge.devices.kinds import KindSettings, RobotEmulation, RobotKind
from hil_bridge.devices.robots.probe import ProbeResult, probe_link
from hil_bridge.devices.robots.streamed import StreamedLink
from hil_bridge.devices.wiring import Serving, Wiring
from hil_bridge.transports.bundle import Bundle
from hil_xarm.client import XarmClient
from hil_xarm.describe import describe
from hil_xarm.facts import robot_facts
from hil_xarm.faults import XARM_FAULTS
from hil_xarm.panel import XARM_CONTROLS
from hil_xarm.profile import XarmProfile
from hil_xarm.reports import Port
from hil_xarm.robot import XarmRobot
from hil_xarm.settings import XarmSettings
from hil_xarm.wires import open_wires, parse_address, serve_box

Settings = KindSettings[XarmSettings, XarmProfile]


async def connect(url: str, settings: Settings, wiring: Wiring) -> StreamedLink[Any]:
    """Connect to the control box, without starting the link. Errors as for `RobotKind.connect`."""
    client = XarmClient(settings.client, wiring.clock.now())
    return await _link(url, settings, wiring, client)


async def _link(url: str, settings: Settings, wiring: Wiring, client: XarmClient) -> StreamedLink[Any]:
    wires = await open_wires(url, wiring)
    bundle: Bundle[Port] = Bundle(url, wires, Port.COMMAND, client.farewell)
    return StreamedLink(bundle, client, facts(url, settings), wiring.clock, wiring.log)


async def probe(url: str, settings: Settings, wiring: Wiring) -> ProbeResult:
    """Probe a control box. Nothing is enabled, set or cleared."""
    client = XarmClient(settings.client, wiring.clock.now(), read_only=True)
    result = await probe_link(url, lambda wiring: _link(url, settings, wiring, client), wiring)
    return ProbeResult((*client.facts.items(), *result.rows[1:]), result.refusals)


def facts(url: str, settings: Settings) -> RobotFacts:
    """Return the facts of the robot before a wire is opened."""
    return robot_facts(settings.client, settings.emulated)


def make(settings: Settings) -> RobotFactory:
    """Return a factory of the control box that the configuration section of the cell describes."""
    return lambda start, now, seed: XarmRobot(settings.emulated, start, now, seed)


async def serve(url: str, robot: Any, settings: Settings, serving: Serving) -> str:
    """Let the emulated control box listen, and return the URL for its client."""
    return await serve_box(url, robot, serving)


def usual(settings: Settings, virtual: bool) -> str:
    """Return the default URL to listen on."""
    return "memory:xarm" if virtual else "tcp-listen://127.0.0.1:0"


def match(settings: Settings, figures: RobotFigures) -> Sections:
    """Return the settings that give the emulated arm the latency of a measured one."""
    return match_cycles("cell.xarm", settings.emulated, settings.emulated.control_ms, figures)


MISHAPS = {"refused": "emergency-stop", "stopped": "servo-error"}
CELL = {"start_position_mm": (400.0, -100.0, 200.0), "surface": {"origin_x_mm": 400.0, "height_mm": 190.0}}
"""Start pose in the middle of the arm's reach, and a surface 10 mm below. Chosen."""

ROBOT = RobotKind(
    "xarm",
    "UFACTORY xArm in servo mode",
    XarmSettings,
    connect,
    facts,
    RobotEmulation(
        XarmProfile, make, serve, usual, XARM_FAULTS, XARM_CONTROLS, MISHAPS, match=match, cell=CELL
    ),
    parse=lambda url, settings: parse_address(url).command,
    describe=describe,
    probe=probe,
    usual_wire="tcp://{host}",
)
