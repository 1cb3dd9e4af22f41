"""Device package for KUKA's Robot Sensor Interface: kind of robot, client and emulator."""

import math
from typing import Any

from emulators.devices.rsi import RSI_CONTROLS, RSI_FAULTS, RsiController, RsiProfile
from emulators.seams import RobotFactory
from hil_bridge.devices.facts import Pacing, RobotFacts, ServoFacts
from hil_bridge.devices.kinds import KindSettings, RobotEmulation, RobotKind
from hil_bridge.devices.robots.probe import ProbeResult, probe_link
from hil_bridge.devices.robots.rsi.emulator_fit import match
from hil_bridge.devices.robots.rsi.ethernet_file import compare_file
from hil_bridge.devices.robots.streamed import StreamedLink
from hil_bridge.devices.trajectory import Trajectory, TrajectoryResult, stream_trajectory
from hil_bridge.devices.wiring import Serving, Wiring
from hil_bridge.transports import Datagrams
from hil_bridge.transports.urls import LISTEN_DATAGRAMS, parse_url
from protocol.devices.rsi import RsiClient, RsiLink, describe
from protocol.marks import Mark
from protocol.marks import settings as marked

PORT = 49152
"""UDP port of the controller's client. Observed: configurations of the ROS driver and FZI. The protocol does not
define a port.
"""


def robot_facts(settings: KindSettings[RsiLink, RsiProfile]) -> RobotFacts:
    """Return the facts of a controller. The servo is assumed to equal the servo of the emulated controller."""
    link: RsiLink = settings.client
    servo: RsiProfile = settings.emulated
    marks = {
        item.name: str(item.info.mark if item.value == item.default else Mark.CHOSEN)
        for item in marked(servo)
    }
    return RobotFacts(
        f"KUKA controller with RSI, {link.mode} corrections"
        + (" of the axes" if link.correction == "axes" else ""),
        Pacing.STREAMED,
        cycle_s=link.cycle_ms / 1e3,
        late="the controller counts each, keeps the last correction, and stops at the limit of its signal flow",
        servo=ServoFacts(
            link.cycle_ms / 1e3,
            servo.transport_delay_ms / 1e3,
            servo.natural_frequency_rad_s,
            servo.damping_ratio,
            marks={
                "interpolation_s": marks["cycle_ms"],
                "transport_delay_s": marks["transport_delay_ms"],
                "natural_frequency_rad_s": marks["natural_frequency_rad_s"],
                "damping_ratio": marks["damping_ratio"],
            },
        ),
    )


def facts(url: str, settings: KindSettings[RsiLink, RsiProfile]) -> RobotFacts:
    """Return the facts of the controller, which are independent of the wire."""
    return robot_facts(settings)


async def connect(
    url: str, settings: KindSettings[RsiLink, RsiProfile], wiring: Wiring
) -> StreamedLink[Datagrams]:
    """Connect to the controller, which sends first on this wire, without starting the link. Errors as for
    `RobotKind.connect`.
    """
    if "strangers" not in parse_url(url, LISTEN_DATAGRAMS).options:
        url += f"{'&' if '?' in url else '?'}strangers=refuse"  # no other sender may replace the robot
    wire = await wiring.datagrams(url, speak_first=False)
    return StreamedLink(wire, RsiClient(settings.client), robot_facts(settings), wiring.clock, wiring.log)


async def probe(url: str, settings: KindSettings[RsiLink, RsiProfile], wiring: Wiring) -> ProbeResult:
    """Probe a controller that sends to this address. It is answered with its present correction: without an answer
    it would stop with an error, and this correction does not move it.
    """
    return await probe_link(url, lambda wiring: connect(url, settings, wiring), wiring)


def make(settings: KindSettings[RsiLink, RsiProfile]) -> RobotFactory:
    """Return a factory of the controller that the configuration section of the cell describes."""
    return lambda start, now, seed: RsiController(settings.emulated, start, now, seed)


async def serve(url: str, robot: Any, settings: KindSettings[RsiLink, RsiProfile], serving: Serving) -> str:
    """Let the emulated controller send to a URL, and return the URL for its client."""
    return await serving.serve_datagrams(url, robot.endpoint, speak_first=True, counts_late=True)


def usual(settings: KindSettings[RsiLink, RsiProfile], virtual: bool) -> str:
    """Return the URL to which the emulated controller sends. The port is fixed because the controller sends first."""
    return "udp+memory:rsi" if virtual else f"udp://127.0.0.1:{PORT}"


def play(
    robot: Any, trajectory: Trajectory, settings: KindSettings[RsiLink, RsiProfile], now: float
) -> TrajectoryResult:
    """Run a trajectory of positions as corrections; see `hil_bridge.devices.trajectory.PlayTrajectory`."""
    return stream_trajectory(robot.endpoint, RsiClient(settings.client), trajectory, now)


MISHAPS = {"refused": "emergency-stop", "stopped": "emergency-stop"}
"""Faults for the scenarios of `hil-bridge conform`. An emergency stop is the only stop that the telegrams of RSI
report.
"""

ROBOT = RobotKind(
    "rsi",
    "KUKA controller by the Robot Sensor Interface (RSI)",
    RsiLink,
    connect,
    facts,
    RobotEmulation(
        RsiProfile, make, serve, usual, RSI_FAULTS, RSI_CONTROLS, MISHAPS, late_ms=6.0, play=play, match=match
    ),
    parse=lambda url, settings: parse_url(url, LISTEN_DATAGRAMS),
    describe=describe,
    probe=probe,
    compare_file=compare_file,
    usual_wire=f"udp-bind://0.0.0.0:{PORT}",
    largest_turn=lambda settings: math.radians(settings.client.limit_deg),
)
