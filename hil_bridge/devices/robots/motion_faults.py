"""Displacement of a robot before a movement, and faults of one movement of a stream. Pure."""

import math

from hil_bridge.devices.robots.gate import Pose
from protocol.endpoint import NO_TROUBLE, Trouble
from protocol.geometry import angle_between

NEAR_M, NEAR_RAD = 0.5e-3, math.radians(0.5)
"""Chosen: largest distance from its set point at which a robot may continue after a fault, and from its planned start
at which it may begin to move; also the tolerance for a small step.
"""


def describe_displacement(start: Pose, present: Pose) -> str:
    """Describe how far a robot has moved from the pose that was read before a movement; empty if it has not.

    A movement is planned from that pose. From another one, its first order would be a jump.
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
    """Fault of a movement, which is reported at least once and as long as it lasts."""

    def __init__(self) -> None:
        self.first = NO_TROUBLE
        """First fault that persists or has not been reported."""
        self._reported = False
        self.displaced = False
        """Whether the robot has reported a fault, and has not returned to its set point since."""

    def note(self, fault: Trouble, displaced: bool) -> None:
        """Add a fault; `displaced` as for the field."""
        self.first = self.first or fault
        self.displaced = self.displaced or displaced

    def is_back(self, reported: Pose, setpoint: Pose) -> bool:
        """Return whether a robot without a fault has returned to its set point, which ends the fault."""
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
