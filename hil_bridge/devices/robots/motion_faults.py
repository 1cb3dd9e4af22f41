"""Displacement of a robot before a movement, and faults of a streamed movement. Pure."""

import math

from hil_bridge.devices.robots.gate import Pose
from protocol.endpoint import NO_TROUBLE, Trouble
from protocol.geometry import angle_between

NEAR_M, NEAR_RAD = 0.5e-3, math.radians(0.5)
"""Largest distance and rotation, m and rad, between a robot and its set point at which it may continue after a
fault, and between a robot and its planned start at which it may begin to move. Chosen. Also the tolerance for a
small step.
"""


def describe_displacement(start: Pose, present: Pose) -> str:
    """Describe how far a robot has moved from the pose that was read before a movement. Return "" if it has not
    moved.

    The movement is planned from that pose. From any other pose, the first order would be a jump.
    """
    distance = math.dist(start.position, present.position)
    turn = angle_between(start.quaternion, present.quaternion)
    if distance <= NEAR_M and turn <= NEAR_RAD:
        return ""
    return (
        f"moved by {distance * 1e3:.1f} mm and turned by {math.degrees(turn):.1f}° before its movement began: "
        "let nothing else move it, then start again"
    )


class MotionFaults:
    """Fault of a movement. A fault is reported at least once, and for as long as it persists."""

    def __init__(self) -> None:
        self.first = NO_TROUBLE
        """First fault that persists or has not been reported yet."""
        self._reported = False
        self.displaced = False
        """Whether the robot has not returned to its set point since it reported a fault."""

    def note(self, fault: Trouble, displaced: bool) -> None:
        """Add a fault. See the field `displaced` for the argument of the same name."""
        self.first = self.first or fault
        self.displaced = self.displaced or displaced

    def is_back(self, reported: Pose, setpoint: Pose) -> bool:
        """Return whether a robot that reports no fault has returned to its set point. This ends the fault."""
        near = math.dist(reported.position, setpoint.position) <= NEAR_M
        back = near and angle_between(reported.quaternion, setpoint.quaternion) <= NEAR_RAD
        if back:
            self.displaced = False
            if self._reported:
                self.first, self._reported = NO_TROUBLE, False
        return back

    def report(self) -> Trouble:
        """Return the fault and mark it as reported."""
        fault = self.first
        self._reported = bool(fault) and self.displaced
        if not self.displaced:
            self.first = NO_TROUBLE
        return fault
