"""Interface of a robot to a run, for both kinds of robot.

An *asked* robot reports its pose on request, and accepts points one by one. Each `to` is an order with an answer, and
the robot moves there by itself. A *streamed* robot sends a packet every few milliseconds by its own clock. Each packet
is answered at once with the next set point on the path to the newest target; `to` only replaces that target.

Guarantees for both kinds:

- Nothing moves outside the context `motion`. Leaving the context always ends the movement at the last point. After an
  exception, a streamed robot stays at the set point that was sent last.
- After `halt` and after `abandon` nothing more is ordered in this movement, not even its end.
- A robot that reports a fault accepts no target: `to` raises OrderRefused with the robot's message. A stream accepts
  targets again when it reports that it is ready and at its last set point.
- A target that the last gate stops is not sent: `to` raises GateStop.
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
"""Name of a stamp of a report: the time at which the last byte of its request left the line, s."""
PACKET, ANSWER = "packet", "answer"
"""Names of two more stamps of a report: the arrival of the stream's previous packet, s, and the time at which the
answer to that packet was passed to the wire, s.
"""
HOLD_AFTER_S = 0.5
"""Default of `hold_after` of a movement, s. Chosen: the default deadline of a decision of the run."""
GIVE_UP_AFTER_S = 60.0
"""Default of `give_up_after` of a movement, s. Chosen: longer than the time between two targets of a run, which is
20 s during a zero.
"""


def fault_reason(report: RobotReport) -> Reason | None:
    """Return the fault that a robot reports, or None."""
    if not report.fault:
        return None
    cause = Cause.ORIENTATION if orientation_fault(report.pose.quaternion) else Cause.ROBOT_STATE
    return Reason(cause, report.fault, report.remedy, facts=report.facts)


TURN_SPEED_RAD_S = math.radians(20.0)
"""Default of `turn_speed` of a movement, rad/s. Chosen: twice the speed of an `identify tool` sweep on a slow link."""

ACCELERATION_M_S2 = 2.0
"""Default of `acceleration` of a movement, m/s². Chosen: the default path velocity is reached in six cycles of 4 ms."""
TURN_ACCELERATION_RAD_S2 = math.radians(800.0)
"""Default of `turn_acceleration` of a movement, rad/s². Chosen: `turn_speed` is reached in the time that the
default path velocity takes.
"""


class Sent(NamedTuple):
    """Times of an order, s on the run's clock; NaN if unknown."""

    begun_at: float
    """Time at which the first byte was passed to the port. For a stream: time at which the target was replaced."""
    left_at: float = math.nan
    """Calculated time at which the last byte left the line."""
    accepted_at: float = math.nan
    """Time at which the robot acknowledged the order."""


@dataclass(frozen=True, slots=True)
class MotionLimits:
    """Settings of one movement, which apply to all of its orders."""

    speed: float
    """Speed along the path, m/s. For a stream, also the speed between two targets."""
    hold_after: float = HOLD_AFTER_S
    """Time without a new target after which a stream holds its set point, s."""
    give_up_after: float = GIVE_UP_AFTER_S
    """Time without a new target after which a stream ends the movement, s."""
    turn_speed: float = TURN_SPEED_RAD_S
    """Largest rotational speed, rad/s. An asked robot rotates in proportion to its translation, by its own rules."""
    acceleration: float = ACCELERATION_M_S2
    """Acceleration of a stream, and its deceleration at the end of the path, m/s². A stop is immediate."""
    turn_acceleration: float = TURN_ACCELERATION_RAD_S2
    """Rotational acceleration of a stream, and its deceleration at the end of the path, rad/s²."""
    bounds: Bounds | None = None
    """Bounds of the last gate, see `hil_bridge.devices.robots.gate`. None: the gate stops invalid poses only."""


class Motion(Protocol):
    """Movement in progress. Points are absolute poses of the tool in the robot's base frame."""

    speed: float
    """Speed along the path for the following orders, m/s."""

    @property
    def ordered(self) -> bool:
        """Whether the robot has accepted a point in this movement, as far as is known."""

    @property
    def commanded(self) -> Vector | None:
        """Last ordered point, m; None before the first order."""

    @property
    def halted(self) -> bool:
        """Whether a halt was ordered. No further order is then possible."""

    @property
    def abandoned(self) -> bool:
        """Whether the robot is considered unresponsive. No further order is then sent."""

    async def to(self, target: Pose, *, soon: bool = False) -> Sent:
        """Order the next point. Return when the robot has accepted the point, not when it has reached it.

        `soon` announces that another exchange follows at once. An asked link may prepare it; a stream ignores it.
        Raises OrderRefused if the robot refuses or reports a fault, other BridgeErrors if it does not answer.
        """

    async def settled(self) -> None:
        """Return when the robot has been sent the complete path to the last point. Errors as for `to`.

        An asked robot has received the path with the order. A stream is sent the path set point by set point.
        """

    def hold(self) -> None:
        """Discard the rest of the path to the last point. Never waits, never raises.

        A stream stays at the set point that was sent last. An asked robot already has the complete path, and stays
        at the end of that path.
        """

    async def halt(self) -> Sent:
        """Stop at once and discard all points, because the robot does not move as ordered. Nothing can be ordered
        afterwards. Errors as for `to`.
        """

    def abandon(self) -> None:
        """Order nothing more, because the robot does not answer."""


class RobotLink(Protocol):
    """Connection to a robot. At most one report and one order are in progress at a time."""

    @property
    def name(self) -> str:
        """URL of the wire, for messages."""

    @property
    def facts(self) -> RobotFacts:
        """Facts of the robot, including the settings of its URL."""

    @property
    def counters(self) -> Mapping[str, int]:
        """Counts since the link was opened, by name. `RobotFacts.routine` contains the names that do not indicate a
        problem.
        """

    def start(self) -> None:
        """Start receiving."""

    async def ready(self) -> RobotReport:
        """Make the robot ready to move and return its report. Raises DeviceError that names the obstacle if it
        cannot be made ready.
        """

    async def report(self, *, soon: bool = False) -> RobotReport:
        """Return the robot's pose and state. An asked robot is queried now; for `soon`, see `Motion.to`.

        A stream returns each report at most once: the newest report if it arrived within the last two cycles of the
        robot, otherwise the next report. A control period that is longer than the robot's cycle therefore uses the
        newest report at the end of each period. A run without a period follows the robot's cycle. Raises
        BridgeError if no report arrives.
        """

    async def release(self, report: RobotReport) -> None:
        """End a movement that an earlier run left open, at the pose of this report. Errors as for `Motion.to`."""

    def motion(self, limits: MotionLimits) -> AbstractAsyncContextManager[Motion]:
        """Return a movement. Entering the context begins the movement, leaving it ends the movement. Errors as for
        `Motion.to`.
        """

    async def aclose(self) -> None:
        """Send queued data and close the wire."""
