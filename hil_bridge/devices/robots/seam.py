"""Interface of a robot to a run, for both kinds of robot.

An *asked* robot reports its pose on request, and accepts points one by one. Each `to` is an order with an answer, and
the robot moves there by itself. A *streamed* robot sends a packet every few milliseconds at its own clock. Each is
answered at once with the next set point on the path to the newest target; `to` only replaces that target.

Guarantees for both kinds:

- Nothing moves outside `motion`. Leaving it ends the movement at the last point, whatever happened inside; after an
  exception, a streamed robot stays at the set point that it was sent last.
- After `halt` and after `abandon` nothing more is ordered in this movement, not even its end.
- A robot that reports a fault accepts no target: `to` raises OrderRefused with the robot's message. A stream accepts
  targets again when it reports that it is ready, and at its last set point.
- What the last gate stops is not sent: `to` raises GateStop.
- If a robot does not answer, `report` and `to` raise BridgeError within seconds. Neither waits indefinitely.
"""

import math
from collections.abc import Mapping
from contextlib import AbstractAsyncContextManager
from dataclasses import dataclass
from typing import NamedTuple, Protocol

from hil_bridge.devices.facts import Pacing, RobotFacts
from hil_bridge.devices.robots.gate import Bounds
from hil_bridge.errors import Cause, Reason
from protocol.geometry import Pose, Vector
from protocol.robot import UNIT_TOLERANCE, RobotReport, orientation_fault

__all__ = [
    "QUESTION_LEFT",
    "UNIT_TOLERANCE",
    "Motion",
    "MotionLimits",
    "Pacing",
    "RobotFacts",
    "RobotLink",
    "RobotReport",
    "Sent",
    "fault_reason",
    "orientation_fault",
]

QUESTION_LEFT = "question_left"
"""Name of a stamp of a report: the time at which its request had left the line, s."""
PACKET, ANSWER = "packet", "answer"
"""Names of two more stamps of a report: the arrival of the stream's previous packet, and the time at which its answer
was passed to the wire, s.
"""
HOLD_AFTER_S = 0.5
"""Chosen: default of `hold_after` of a movement; the run's default deadline of a decision."""
GIVE_UP_AFTER_S = 60.0
"""Chosen: default of `give_up_after`; longer than a run waits between two targets, which is 20 s for a zero."""


def fault_reason(report: RobotReport) -> Reason | None:
    """Return the fault that a robot reports; None if it reports none."""
    if not report.fault:
        return None
    cause = Cause.ORIENTATION if orientation_fault(report.pose.quaternion) else Cause.ROBOT_STATE
    return Reason(cause, report.fault, report.remedy)


TURN_SPEED_RAD_S = math.radians(20.0)
"""Chosen: default of `turn_speed`; twice the speed of an `identify tool` sweep on a slow link."""

ACCELERATION_M_S2 = 2.0
"""Chosen: default of `acceleration`; the default path velocity is reached in six cycles of 4 ms."""
TURN_ACCELERATION_RAD_S2 = math.radians(800.0)
"""Chosen: default of `turn_acceleration`; `turn_speed` is reached in the same time."""


class Sent(NamedTuple):
    """Times of an order, s on the run's clock; NaN if unknown."""

    begun_at: float
    """Time at which the first byte was passed to the port; of a stream: at which the target was replaced."""
    left_at: float = math.nan
    """Time at which the last byte had left the line, calculated."""
    accepted_at: float = math.nan
    """Time at which the robot had acknowledged it."""


@dataclass(frozen=True, slots=True)
class MotionLimits:
    """Settings of one movement, for all of its orders."""

    speed: float
    """Speed along the path, m/s; of a stream also between two targets."""
    hold_after: float = HOLD_AFTER_S
    """Time without a new target after which a stream holds its set point, s."""
    give_up_after: float = GIVE_UP_AFTER_S
    """Time without a new target after which a stream ends the movement, s."""
    turn_speed: float = TURN_SPEED_RAD_S
    """Largest rotational speed, rad/s. An asked robot rotates in proportion to its motion, by its own rules."""
    acceleration: float = ACCELERATION_M_S2
    """Acceleration of a stream, m/s², and its deceleration at the end of its path. A stop is immediate."""
    turn_acceleration: float = TURN_ACCELERATION_RAD_S2
    """The same for rotation, rad/s²."""
    bounds: Bounds | None = None
    """Bounds of the last gate, see `hil_bridge.devices.robots.gate`; None: only invalid poses are stopped."""


class Motion(Protocol):
    """Movement in progress. Points are absolute poses of the tool in the robot's base frame."""

    speed: float
    """Speed along the path for the following orders, m/s."""

    @property
    def ordered(self) -> bool:
        """Whether a point has been accepted in this movement, as far as is known."""

    @property
    def commanded(self) -> Vector | None:
        """Last point ordered, m; None before the first."""

    @property
    def halted(self) -> bool:
        """Whether a halt was ordered: nothing more can be ordered."""

    @property
    def abandoned(self) -> bool:
        """Whether the robot is considered unresponsive: nothing more is ordered."""

    async def to(self, target: Pose, *, soon: bool = False) -> Sent:
        """Order the next point; returns when the robot has accepted it, not when it is reached.

        `soon` announces that another exchange follows at once: an asked link may prepare it, a stream ignores it.
        Raises OrderRefused if the robot refuses or reports a fault, other BridgeErrors if it does not answer.
        """

    async def settled(self) -> None:
        """Return once the robot has been sent the complete path to the last point; raises as `to`.

        An asked robot has it with the order. A stream is sent it set point by set point.
        """

    def hold(self) -> None:
        """Discard the rest of the path to the last point. Never waits, never raises.

        A stream stays at the set point that it was sent last. An asked robot already has the complete path, and stays
        at its end.
        """

    async def halt(self) -> Sent:
        """Stop at once and discard all points, for a robot that does not move as ordered. Nothing can be ordered
        afterwards. Raises as `to`.
        """

    def abandon(self) -> None:
        """Order nothing more: the robot does not answer."""


class RobotLink(Protocol):
    """Connection to a robot. One report and one order are in progress at a time."""

    @property
    def name(self) -> str:
        """URL of its wire, for messages."""

    @property
    def facts(self) -> RobotFacts:
        """Facts of the robot, with the settings of the URL."""

    @property
    def counters(self) -> Mapping[str, int]:
        """Counts since opening, by name; `RobotFacts.routine` names those that do not indicate a problem."""

    def start(self) -> None:
        """Start to receive."""

    async def ready(self) -> RobotReport:
        """Make the robot ready to move and return its report. Raises DeviceError that names the obstacle."""

    async def report(self, *, soon: bool = False) -> RobotReport:
        """Return the robot's pose and state. An asked robot is queried now; `soon` as for `Motion.to`.

        A stream returns its newest report, each once, if that arrived within the last two cycles of the robot.
        Otherwise it waits for the next one. So a control period that is longer than the robot's cycle acts on the
        newest report at the end of each period. A run without a period follows the robot's cycle. Raises BridgeError if
        none arrives.
        """

    async def release(self, report: RobotReport) -> None:
        """End a movement that an earlier run left open, at the pose of this report. Raises as `Motion.to`."""

    def motion(self, limits: MotionLimits) -> AbstractAsyncContextManager[Motion]:
        """Return a movement: entering begins it, leaving ends it. Raises as `Motion.to`."""

    async def aclose(self) -> None:
        """Send what is queued and close the wire."""
