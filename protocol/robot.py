"""What a robot tells of itself, whatever its wire: one report, with its times."""

import math
from typing import NamedTuple

from protocol.geometry import Pose, Quaternion

UNIT_TOLERANCE = 0.01
"""Chosen: how far a quaternion's norm may be from 1. Robots round what they send: words of 1/16384 make up 0.0001."""


class RobotReport(NamedTuple):
    """Where the robot is, and whether it can move. Times are s on the receiver's clock."""

    sequence: int
    """Number of the report; it rises by one with each, and by more where some were lost."""
    pose: Pose
    """Of the tool in the robot's base frame, as reported."""
    pose_at: float
    """When the pose was true."""
    received_at: float
    """When the report was complete."""
    fault: str = ""
    """What forbids to move, in words with a remedy: emergency stop, program stopped; empty while nothing does."""
    stamps: tuple[tuple[str, float], ...] = ()
    """More times of the way to this report, by name."""


def orientation_fault(quaternion: Quaternion) -> str:
    """What is wrong with a reported orientation; empty while nothing is."""
    length = math.hypot(*quaternion)
    if abs(length - 1.0) <= UNIT_TOLERANCE:
        return ""
    return f"reports the orientation {quaternion}, which is none"
