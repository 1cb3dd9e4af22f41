"""The view that a run has of a robot, of either kind.

An *asked* robot tells where it is when it is asked, and takes points one by one. Each `to` is an order with an answer,
and the robot goes there by itself. A *streamed* robot sends a packet every few milliseconds by its own clock. Each is
answered at once with the next set point on the way to the newest target; `to` only replaces that target.

What a run may rely on, for both kinds:

- Nothing moves outside `motion`. Leaving it ends the movement at the last point, whatever happened inside; after an
  exception, a streamed robot is left at the set point that it was given last.
- After `halt` and after `abandon` nothing more is ordered in this movement, not even its end.
- A robot that reports a fault takes no target: `to` raises OrderRefused with the robot's words. A stream takes targets
  again when it reports to be ready, and to stand where it was led last.
- What the last gate stops is not sent: `to` raises GateStop.
- A robot that does not answer makes `report` and `to` raise BridgeError within seconds. Neither waits for ever.
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
"""Name of the stamp of a report: when the question for it had left the line, s."""
PACKET, ANSWER = "packet", "answer"
"""Names of two more stamps of a report: when the stream's packet before arrived, and when its answer was handed to the
wire, s.
"""
HOLD_AFTER_S = 0.5
"""Chosen: what a movement has as `hold_after` where its user says nothing; the run's usual deadline of a decision."""
GIVE_UP_AFTER_S = 60.0
"""Chosen: the same for `give_up_after`; longer than a run waits between two targets, which is for a zero of 20 s."""


def fault_reason(report: RobotReport) -> Reason | None:
    """The fault that a robot reports; None while it reports none."""
    if not report.fault:
        return None
    cause = Cause.ORIENTATION if orientation_fault(report.pose.quaternion) else Cause.ROBOT_STATE
    return Reason(cause, report.fault, report.remedy)


TURN_SPEED_RAD_S = math.radians(20.0)
"""Chosen: the same for `turn_speed`; twice what a sweep of `identify tool` turns on a slow link."""

ACCELERATION_M_S2 = 2.0
"""Chosen: the same for `acceleration`; the usual path velocity is reached in six cycles of 4 ms."""
TURN_ACCELERATION_RAD_S2 = math.radians(800.0)
"""Chosen: the same for `turn_acceleration`; `turn_speed` is reached in as long."""


class Sent(NamedTuple):
    """The times of an order, s on the run's clock; NaN for what is not known."""

    begun_at: float
    """The first byte was handed to the port; of a stream: the target was replaced."""
    left_at: float = math.nan
    """The last byte had left the line, calculated."""
    accepted_at: float = math.nan
    """The robot had said that it takes it."""


@dataclass(frozen=True, slots=True)
class MotionLimits:
    """Settings that hold for one movement, whatever is ordered in it."""

    speed: float
    """Along the path, m/s; of a stream also between two targets."""
    hold_after: float = HOLD_AFTER_S
    """A stream holds its set point when there was no new target for so long, s."""
    give_up_after: float = GIVE_UP_AFTER_S
    """A stream ends the movement when there was none for so long, s."""
    turn_speed: float = TURN_SPEED_RAD_S
    """Largest speed of turning, rad/s. A robot that is asked turns as fast as it goes, by its own rules."""
    acceleration: float = ACCELERATION_M_S2
    """Fastest gain of speed of a stream, m/s², and loss of speed at the end of its way. A stop is at once."""
    turn_acceleration: float = TURN_ACCELERATION_RAD_S2
    """The same for turning, rad/s²."""
    bounds: Bounds | None = None
    """Bounds of the last gate, see `hil_bridge.devices.robots.gate`; None leaves it open for all that is a pose."""


class Motion(Protocol):
    """A movement under way. Points are absolute poses of the tool in the robot's base frame."""

    speed: float
    """Along the path for the orders to come, m/s."""

    @property
    def ordered(self) -> bool:
        """Whether a point has been taken in this movement, as far as is known."""

    @property
    def commanded(self) -> Vector | None:
        """The last point ordered, m; None before the first."""

    @property
    def halted(self) -> bool:
        """Whether it was ordered to stand still: nothing more can be ordered."""

    @property
    def abandoned(self) -> bool:
        """Whether the robot is taken for one that does not answer: nothing more is ordered."""

    async def to(self, target: Pose, *, soon: bool = False) -> Sent:
        """Order the next point; returns when it is the robot's, not when it is reached.

        With `soon` another exchange follows at once: a link that is asked may prepare it, a stream takes no notice.
        Raises OrderRefused when the robot refuses or reports a fault, other BridgeErrors when it does not answer.
        """

    async def settled(self) -> None:
        """Return once the robot has been given the whole way to the last point; raises as `to`.

        A robot that is asked has it with the order. A stream is given it set point by set point.
        """

    def hold(self) -> None:
        """Give up what is left of the way to the last point. Never waits, never raises.

        A stream stays at the set point that it was given last. A robot that is asked has been given the whole way
        already, and stays at its end.
        """

    async def halt(self) -> Sent:
        """Stand still at once and forget all points, for a robot that does not go where it was ordered to. Nothing can
        be ordered afterwards. Raises as `to`.
        """

    def abandon(self) -> None:
        """Order nothing more: the robot does not answer."""


class RobotLink(Protocol):
    """A robot that can be reached. One report and one order are under way at a time."""

    @property
    def name(self) -> str:
        """The URL of its wire, for messages."""

    @property
    def facts(self) -> RobotFacts:
        """Facts of the robot, with the settings of the URL."""

    @property
    def counters(self) -> Mapping[str, int]:
        """Counts since opening, by name; `RobotFacts.routine` names those that tell of no trouble."""

    def start(self) -> None:
        """Begin to listen."""

    async def ready(self) -> RobotReport:
        """Bring it to where it can move; where it stands. Raises DeviceError that names what stands against it."""

    async def report(self, *, soon: bool = False) -> RobotReport:
        """Where it is. An asked robot is asked now; `soon` as in `Motion.to`.

        A stream hands out its newest report, each once, if that came within the last two cycles of the robot. Else it
        waits for the next one. So a control period that is longer than the robot's cycle acts on the newest report at
        each period's end. A run without a period goes at the robot's pace. Raises BridgeError when none comes.
        """

    async def release(self, report: RobotReport) -> None:
        """End what an earlier run left open, where this report says that the robot is. Raises as `Motion.to`."""

    def motion(self, limits: MotionLimits) -> AbstractAsyncContextManager[Motion]:
        """A movement: entering begins it, leaving ends it. Raises as `Motion.to`."""

    async def aclose(self) -> None:
        """Hand over what is queued and close the wire."""
