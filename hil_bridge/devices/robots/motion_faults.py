"""Where a robot stands before a movement, and the faults of one movement of a stream. Pure."""

import math

from hil_bridge.devices.robots.gate import Pose
from protocol.endpoint import NO_TROUBLE, Trouble
from protocol.geometry import angle_between

NEAR_M, NEAR_RAD = 0.5e-3, math.radians(0.5)
"""Chosen: how near to its set point a robot must report to stand to be led on after a fault, and how near to
where it was looked at to be led at all; as far as it may stray from a small step.
"""


def describe_displacement(seen: Pose, stands: Pose) -> str:
    """By how much a robot has left the pose where it was looked at before a movement, in words; empty where it has not.

    A movement is planned from the pose that was seen. From another one, its first order would be a jump.
    """
    way, turn = math.dist(seen.position, stands.position), angle_between(seen.quaternion, stands.quaternion)
    if way <= NEAR_M and turn <= NEAR_RAD:
        return ""
    return (
        f"moved by {way * 1e3:.1f} mm and turned by {math.degrees(turn):.1f}° before its movement began: let nothing "
        "else move it, then start again"
    )


class MotionFaults:
    """A fault is told at least once, and as long as it stands."""

    def __init__(self) -> None:
        self.first = NO_TROUBLE
        """The first fault that stands or has not been told."""
        self._told = False
        self.displaced = False
        """The robot has reported a fault, and has not come back to its set point since."""

    def note(self, fault: Trouble, displaced: bool) -> None:
        """A fault; `displaced` as the field."""
        self.first = self.first or fault
        self.displaced = self.displaced or displaced

    def is_back(self, reported: Pose, setpoint: Pose) -> bool:
        """Whether a robot that reports no fault any more has come back to its set point, which ends the fault."""
        near = math.dist(reported.position, setpoint.position) <= NEAR_M
        back = near and angle_between(reported.quaternion, setpoint.quaternion) <= NEAR_RAD
        if back:
            self.displaced = False
            if self._told:
                self.first, self._told = NO_TROUBLE, False
        return back

    def tell(self) -> Trouble:
        """The fault, which is told by that."""
        fault = self.first
        self._told = bool(fault) and self.displaced
        if not self.displaced:
            self.first = NO_TROUBLE
        return fault
