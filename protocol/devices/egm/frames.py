"""Whether a robot tells its pose in the frame and in the unit in which it takes poses. Pure.

An answer is an absolute pose, made of what the robot has told. In another work object, with another tool, or in metres
the robot would go there. So before a movement its measured pose is compared with its own set point, and its place with
the origin. A robot whose set point leaves an answer that stands is seen to take poses in another frame.
"""

import math

from protocol.devices.egm.messages import PoseMm
from protocol.endpoint import NO_TROUBLE, Trouble
from protocol.geometry import angle_between

APART_MM, APART_RAD = 1.0, math.radians(1.0)
"""Chosen: a measured pose that is farther from a set point that stands is told in another frame; some times what a
servo gives way by when the tool presses.
"""
STOOD_S = 0.2
"""Chosen: for so long a set point, or an answer, has stood before it is judged; the lag of the robot is over."""
SAME_MM = 0.01
"""Chosen: a set point that moved by less in a datagram stands."""
LEAST_MM = 10.0
"""Chosen: no tool is nearer to the origin of the base frame, which lies inside the robot's foot. A place of any arm
that is told in metres is.
"""
_OTHER = (
    "have its program use the base frame and the same tool in EGMActPose and in EGMSetupUC, and millimetres"
)


class Frames:
    """Knowledge of the frame in which a robot tells its poses."""

    def __init__(self) -> None:
        self._planned: PoseMm | None = None
        self._stood_since = -math.inf
        self._answer: PoseMm | None = None
        self._answered_since = -math.inf
        self._nearest = math.inf
        self.refused = NO_TROUBLE
        """Reason for which this robot must get no more answers in this session."""

    def fault(self, measured: PoseMm | None, planned: PoseMm | None, at: float) -> Trouble:
        """Reason for which the pose that a robot tells at a time, s, while nothing moves it is not to be used."""
        stood = self._stands(planned, at)
        if self.refused or measured is None or planned is None:
            return self.refused
        if math.hypot(*measured.position_mm) < LEAST_MM and math.hypot(*planned.position_mm) < LEAST_MM:
            off = math.hypot(*measured.position_mm)
            self.refused = Trouble(
                f"it tells to stand {off:.1f} mm from the origin of its base, where no tool can be", _OTHER
            )
            return self.refused
        off = math.dist(measured.position_mm, planned.position_mm)
        turned = angle_between(planned.quaternion, measured.quaternion)
        if stood and (off > APART_MM or turned > APART_RAD):
            return Trouble(
                f"it tells to stand {off:.1f} mm and {math.degrees(turned):.1f}° from its own set point, which stands",
                _OTHER,
            )
        return NO_TROUBLE

    def leaves(self, answer: PoseMm | None, planned: PoseMm | None, at: float) -> Trouble:
        """Reason to think that a robot takes poses in another frame than it tells them in."""
        if answer != self._answer:
            first = self._answer is None
            self._answer, self._nearest = answer, math.inf
            self._answered_since = -math.inf if first else at
        if answer is None or planned is None or at - self._answered_since < STOOD_S:
            return self.refused
        off = math.dist(answer.position_mm, planned.position_mm)
        self._nearest = min(self._nearest, off)
        if off > self._nearest + APART_MM:
            self.refused = Trouble(
                f"its set point went {off - self._nearest:.1f} mm away from an answer that stands", _OTHER
            )
        return self.refused

    def _stands(self, planned: PoseMm | None, at: float) -> bool:
        """Whether the set point has stood for long enough; the first one counts as such."""
        before, self._planned = self._planned, planned
        if planned is None or before is None:
            return True
        if not math.dist(before.position_mm, planned.position_mm) <= SAME_MM:
            self._stood_since = at
        return at - self._stood_since >= STOOD_S
