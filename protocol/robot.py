"""Report of a robot about itself, whatever its wire, and the shape of a client whose robot drives the cycle."""

import math
from typing import NamedTuple, Protocol, TypeAlias, TypeVar

from protocol.endpoint import Endpoint
from protocol.geometry import Pose, Quaternion, Vector

UNIT_TOLERANCE = 0.01
"""Chosen: how far a quaternion's norm may be from 1. Robots round what they send: words of 1/16384 make up 0.0001."""


class RobotReport(NamedTuple):
    """Where the robot is, and whether it can move. Times are s on the receiver's clock."""

    sequence: int
    """Number of the report; it rises by one with each, and by more where some were lost."""
    pose: Pose
    """Pose of the tool in the robot's base frame, as reported."""
    pose_at: float
    """When the pose was true."""
    received_at: float
    """When the report was complete."""
    fault: str = ""
    """Reasons that forbid to move, in words: emergency stop, program stopped; empty without any."""
    stamps: tuple[tuple[str, float], ...] = ()
    """More times of the way to this report, by name."""
    force: Vector | None = None
    """Force of the surroundings on the tool as the robot itself feels it, base frame, N; None where it tells none. It
    is coarse, and may have an offset: its user counts from a zero of its own.
    """
    remedy: str = ""
    """Advice against the fault, for an operator; empty where none is known."""


def orientation_fault(quaternion: Quaternion) -> str:
    """Fault of an orientation, in words; empty without any."""
    return (
        ""
        if abs(math.hypot(*quaternion) - 1.0) <= UNIT_TOLERANCE
        else f"the orientation {quaternion}, which is invalid"
    )


def pose_fault(pose: Pose) -> str:
    """Fault of a pose that another side has given, in words; empty without any."""
    if not all(map(math.isfinite, pose.position)):
        return f"the position {pose.position}, which is invalid"
    return orientation_fault(pose.quaternion)


class ReportReceived(NamedTuple):
    """A packet of the robot came."""

    report: RobotReport


class StreamLost(NamedTuple):
    """The robot, or this side, has ended the movement."""

    text: str
    """The reason."""
    remedy: str = ""
    """Advice for an operator; empty where none is known."""


class StreamNotice(NamedTuple):
    """Something worth a line in the record."""

    kind: str
    text: str


StreamEvent: TypeAlias = ReportReceived | StreamLost | StreamNotice

Data = TypeVar("Data")


class StreamClient(Endpoint[Data, Data, StreamEvent], Protocol[Data]):
    """The codec of a robot that sends a packet by its own clock and is answered each time.

    Its user takes the events at once. For each `ReportReceived`, in order, it calls `target` or `hold` exactly once,
    before it asks for the data to send. These are the answers, one for each packet. The client needs no limits, no
    ramps and no watchdog: its user has them.

    Sequence numbers count packets. A client unwraps the robot's own number, and counts on where that begins again. A
    packet that came late keeps its own, smaller number.
    """

    def begin(self, pose: Pose) -> None:
        """Begin a movement at this pose, the one that the robot reported."""

    def target(self, pose: Pose, now: float) -> None:
        """Answer the packet that was told last with this pose; only within a movement."""

    def hold(self, now: float) -> None:
        """Answer the packet that was told last so that the robot does not move, or not at all; only outside of one."""

    def end(self) -> None:
        """End the movement. Reports should continue where the robot can: a run needs the tool's final position."""
