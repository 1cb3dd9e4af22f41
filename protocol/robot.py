"""Status report of a robot, independent of its wire, and the interface of a client whose robot drives the cycle."""

import math
from typing import NamedTuple, Protocol, TypeAlias, TypeVar

from protocol.endpoint import Endpoint
from protocol.geometry import Pose, Quaternion, Vector

UNIT_TOLERANCE = 0.01
"""Allowed deviation of a quaternion's norm from 1. Chosen: robots round the values that they send; words of 1/16384
cause a deviation of up to 0.0001.
"""


class RobotReport(NamedTuple):
    """Reported pose of a robot, and whether the robot can move. Times are in s on the receiver's clock."""

    sequence: int
    """Number of the report. It increases by one with each report, and by more if reports were lost."""
    pose: Pose
    """Reported pose of the tool in the robot's base frame."""
    pose_at: float
    """Time at which the robot had this pose."""
    received_at: float
    """Time at which the report was completely received."""
    fault: str = ""
    """Reason why the robot cannot move, such as an emergency stop or a stopped program; empty if there is none."""
    stamps: tuple[tuple[str, float], ...] = ()
    """Further time stamps of this report on its path, by name."""
    force: Vector | None = None
    """Contact force on the tool as estimated by the robot itself, in the base frame, N; None if the robot reports
    none. The force is coarse and may have an offset, so the user measures it relative to its own zero.
    """
    remedy: str = ""
    """Remedy for the fault, for an operator; empty if none is known."""
    facts: str = ""
    """Further facts about the fault, such as recent messages of the robot."""


def orientation_fault(quaternion: Quaternion) -> str:
    """Return the text of the fault of an orientation; empty if the orientation is valid."""
    return (
        ""
        if abs(math.hypot(*quaternion) - 1.0) <= UNIT_TOLERANCE
        else f"the orientation {quaternion}, which is invalid"
    )


def pose_fault(pose: Pose) -> str:
    """Return the text of the fault of a pose from an external source; empty if the pose is valid."""
    if not all(map(math.isfinite, pose.position)):
        return f"the position {pose.position}, which is invalid"
    return orientation_fault(pose.quaternion)


class ReportReceived(NamedTuple):
    """A packet of the robot was received."""

    report: RobotReport


class StreamLost(NamedTuple):
    """The robot or this side has ended the movement."""

    text: str
    """Reason for the end of the movement."""
    remedy: str = ""
    """Advice for an operator; empty if none is known."""


class StreamNotice(NamedTuple):
    """Event that should appear in the recording."""

    kind: str
    text: str


StreamEvent: TypeAlias = ReportReceived | StreamLost | StreamNotice

Data = TypeVar("Data")


class StreamClient(Endpoint[Data, Data, StreamEvent], Protocol[Data]):
    """Interface of the client of a robot that sends packets on its own clock and expects an answer to each.

    The user takes the events at once. For each `ReportReceived`, in order, it calls either `target` or `hold` once,
    before it asks for the data to send. The data contains the answers, one for each packet. The client needs no
    limits, ramps or watchdog, because its user has them.

    Sequence numbers count packets. A client unwraps the robot's own number, and continues the count when that
    number restarts. A packet that arrived late keeps its own, smaller number.
    """

    def begin(self, pose: Pose) -> None:
        """Begin a movement at this pose, which is the pose that the robot reported."""

    def target(self, pose: Pose, now: float) -> None:
        """Answer the most recently reported packet with this pose. Only allowed during a movement."""

    def hold(self, now: float) -> None:
        """Answer the most recently reported packet so that the robot does not move, or do not answer it. Only
        allowed outside a movement.
        """

    def end(self) -> None:
        """End the movement. Reports should continue if possible, because a run needs the final position of the tool."""
