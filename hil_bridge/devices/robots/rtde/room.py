"""Device package for Universal Robots controllers: kind `rtde`, client and emulator."""

from pathlib import Path
from typing import Any

from emulators.devices.rtde import RTDE_CONTROLS, RTDE_FAULTS, TEXT_MAX, RtdeProfile, RtdeRobot, make_robot
from emulators.seams import RobotFactory
from hil_bridge.devices.facts import RobotFacts
from hil_bridge.devices.kinds import KindSettings, RobotEmulation, RobotKind
from hil_bridge.devices.robots.probe import ProbeResult, probe_link
from hil_bridge.devices.robots.rtde import port_server as ports
from hil_bridge.devices.robots.rtde.addresses import RTDE_PORT, parse_address
from hil_bridge.devices.robots.rtde.emulator_fit import match
from hil_bridge.devices.robots.rtde.facts import robot_facts
from hil_bridge.devices.robots.rtde.program_folder import read_programs
from hil_bridge.devices.robots.rtde.trajectory import play
from hil_bridge.devices.robots.streamed import StreamedLink
from hil_bridge.devices.wiring import Serving, Wiring
from hil_bridge.errors import ConfigError
from hil_bridge.transports import Transport
from hil_bridge.transports.bundle import Bundle
from hil_bridge.transports.urls import WireUrl
from protocol.devices.rtde.client import RtdeClient
from protocol.devices.rtde.describe import describe
from protocol.devices.rtde.profile import ClientProfile
from protocol.devices.rtde.wires import Pieces, Port


async def connect(
    url: str, settings: KindSettings[ClientProfile, RtdeProfile], wiring: Wiring
) -> StreamedLink[Pieces]:
    """Connect to the controller's ports, without starting the link. Raises ConfigError for an invalid URL,
    TransportUnavailable if a wire cannot be opened.
    """
    return await _open(url, settings, wiring, read_only=False)


async def _open(
    url: str, settings: KindSettings[ClientProfile, RtdeProfile], wiring: Wiring, read_only: bool
) -> StreamedLink[Pieces]:
    profile: ClientProfile = settings.client
    wires = await open_wires(url, profile, wiring, script=not read_only)
    client = RtdeClient(profile, wiring.clock.now(), read_only)
    facts = robot_facts(profile, settings.emulated)
    bundle = Bundle(url, wires, Port.RTDE, client.farewell)
    return StreamedLink(bundle, client, facts, wiring.clock, wiring.log)


async def probe(url: str, settings: KindSettings[ClientProfile, RtdeProfile], wiring: Wiring) -> ProbeResult:
    """Probe a controller. The probe sends no program and writes no inputs."""
    return await probe_link(url, lambda wiring: _open(url, settings, wiring, read_only=True), wiring)


async def open_wires(
    url: str, profile: ClientProfile, wiring: Wiring, dashboard: bool = True, script: bool = True
) -> dict[Port, Transport[bytes]]:
    """Open the wires to a controller's ports. `dashboard` and `script` select the wires in addition to RTDE; a
    dashboard port of 0 is not opened.
    """
    address = parse_address(url)
    numbers = {
        Port.RTDE: RTDE_PORT,
        Port.DASHBOARD: profile.dashboard_port,
        Port.SCRIPT: profile.script_port,
    }
    wires: dict[Port, Transport[bytes]] = {}
    try:
        for port, usual in numbers.items():
            number = address.ports.get(port, usual)
            if port is Port.DASHBOARD and not (dashboard and profile.dashboard_port):
                continue
            if port is Port.SCRIPT and not script:
                continue
            wire_url = address.memory_url(port) if address.name else f"tcp://{address.authority}:{number}"
            wires[port] = await wiring.bytes(wire_url)
    except BaseException:
        for wire in wires.values():
            await wire.aclose()
        raise
    return wires


def facts(url: str, settings: KindSettings[ClientProfile, RtdeProfile]) -> RobotFacts:
    """Return the facts of a controller before a wire is opened."""
    return robot_facts(settings.client, settings.emulated)


def make(settings: KindSettings[ClientProfile, RtdeProfile]) -> RobotFactory:
    """Return a factory of the controller that the configuration section of the cell describes, with the programs of
    its folder. Raises ConfigError if a program is invalid.
    """
    folder = settings.emulated.program_folder
    return make_robot(settings.emulated, read_programs(Path(folder), TEXT_MAX) if folder else {})


async def serve(
    url: str, robot: RtdeRobot, settings: KindSettings[ClientProfile, RtdeProfile], serving: Serving
) -> str:
    """Let the emulated controller listen on its ports."""
    return await ports.serve(url, robot, serving)


def usual(settings: KindSettings[ClientProfile, RtdeProfile], virtual: bool) -> str:
    """Return the default URL to listen on."""
    return "memory:rtde" if virtual else "tcp-listen://127.0.0.1:0"


def check(settings: KindSettings[ClientProfile, RtdeProfile]) -> None:
    """Raise ConfigError if the emulated controller cannot send at the rate that the client expects."""
    client, emulated = settings.client.cycle_ms, settings.emulated
    if not (client / emulated.cycle_ms).is_integer():
        raise ConfigError(
            f"robot.rtde.cycle_ms of {client:g} is not a multiple of cell.rtde.cycle_ms, {emulated.cycle_ms:g}; "
            "set both to 2 for an e-Series, to 8 for a CB3"
        )


MISHAPS = {"refused": "motors-off", "stopped": "protective-stop"}


def _parse(url: str, settings: Any) -> WireUrl:
    return parse_address(url).wire


ROBOT = RobotKind(
    "rtde",
    "Universal Robots' controller over RTDE",
    ClientProfile,
    connect,
    facts,
    RobotEmulation(
        RtdeProfile, make, serve, usual, RTDE_FAULTS, RTDE_CONTROLS, MISHAPS, play=play, match=match
    ),
    check=check,
    parse=_parse,
    describe=describe,
    probe=probe,
    usual_wire="tcp://{host}",
)
