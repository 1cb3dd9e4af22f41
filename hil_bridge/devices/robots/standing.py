"""Where a robot stands before a movement, and the faults of one movement of a stream. Pure."""

import math

from protocol.geometry import Pose, angle_between

NEAR_M, NEAR_RAD = 0.5e-3, math.radians(0.5)
"""Chosen: how near to its set point a robot must report to stand to be led on after a fault, and how near to
where it was looked at to be led at all; as far as it may stray from a small step.
"""


def moved_since(seen: Pose, stands: Pose) -> str:
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


class Faults:
    """A fault is told at least once, and as long as it stands."""

    def __init__(self) -> None:
        self.text = ""
        """The first fault that stands or has not been told, in words; empty without any."""
        self._told = False
        self.apart = False
        """The robot has reported a fault, and has not come back to its set point since."""

    def note(self, text: str, apart: bool) -> None:
        """A fault; `apart` as the field."""
        self.text = self.text or text
        self.apart = self.apart or apart

    def is_back(self, reported: Pose, setpoint: Pose) -> bool:
        """Whether a robot that reports no fault any more has come back to its set point, which ends the fault."""
        near = math.dist(reported.position, setpoint.position) <= NEAR_M
        back = near and angle_between(reported.quaternion, setpoint.quaternion) <= NEAR_RAD
        if back:
            self.apart = False
            if self._told:
                self.text, self._told = "", False
        return back

    def tell(self) -> str:
        """The fault in words, which is told by that; empty without any."""
        text = self.text
        self._told = bool(text) and self.apart
        if not self.apart:
            self.text = ""
        return text
