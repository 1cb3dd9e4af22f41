"""Checks that a robot reports poses in the same frame and unit in which it accepts them.

An answer is an absolute pose, computed from the reported pose. With another work object, another tool, or metres,
the robot would move to the wrong position. Before a movement, the measured pose is therefore compared with the
robot's own set point, and its position with the origin. A robot whose set point moves away from a constant answer
accepts poses in another frame.
"""

import math

from protocol.devices.egm.messages import PoseMm
from protocol.endpoint import NO_TROUBLE, Trouble
from protocol.geometry import angle_between

APART_MM, APART_RAD = 1.0, math.radians(1.0)
"""Largest difference between the measured pose and a constant set point, mm and rad. Chosen: a multiple of the
servo deflection when the tool presses. A pose farther away is reported in another frame.
"""
STOOD_S = 0.2
"""Time for which a set point, or an answer, must be constant before it is evaluated, s. Chosen: longer than the lag
of the robot.
"""
SAME_MM = 0.01
"""Largest movement between two datagrams at which a set point still counts as constant, mm. Chosen."""
LEAST_MM = 10.0
"""Minimum distance of a tool from the origin of the base frame, mm. Chosen: the origin lies inside the robot's
foot. Any position reported in metres is closer.
"""
_OTHER = (
    "have its program use the base frame and the same tool in EGMActPose and in EGMSetupUC, and millimetres"
)


class Frames:
    """State of the check that a robot reports its poses in the expected frame."""

    def __init__(self) -> None:
        self._planned: PoseMm | None = None
        self._constant_since = -math.inf
        self._answer: PoseMm | None = None
        self._answered_since = -math.inf
        self._nearest = math.inf
        self.refused = NO_TROUBLE
        """Reason why this robot gets no more answers in this session."""

    def fault(self, measured: PoseMm | None, planned: PoseMm | None, at: float) -> Trouble:
        """Return the reason to reject the pose that a stationary robot reports at time `at`, s."""
        is_constant = self._is_constant(planned, at)
        if self.refused or measured is None or planned is None:
            return self.refused
        if math.hypot(*measured.position_mm) < LEAST_MM and math.hypot(*planned.position_mm) < LEAST_MM:
            off = math.hypot(*measured.position_mm)
            self.refused = Trouble(
                f"it reports a position {off:.1f} mm from the origin of its base, where no tool can be",
                _OTHER,
            )
            return self.refused
        off = math.dist(measured.position_mm, planned.position_mm)
        turned = angle_between(planned.quaternion, measured.quaternion)
        if is_constant and (off > APART_MM or turned > APART_RAD):
            return Trouble(
                f"it reports a pose {off:.1f} mm and {math.degrees(turned):.1f}° from its own constant set point",
                _OTHER,
            )
        return NO_TROUBLE

    def leaves(self, answer: PoseMm | None, planned: PoseMm | None, at: float) -> Trouble:
        """Return the reason to conclude that a robot accepts poses in another frame than the one in which it
        reports them.
        """
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
                f"its set point went {off - self._nearest:.1f} mm away from a constant answer", _OTHER
            )
        return self.refused

    def _is_constant(self, planned: PoseMm | None, at: float) -> bool:
        """Return whether the set point has been constant for long enough. The first set point counts as constant."""
        before, self._planned = self._planned, planned
        if planned is None or before is None:
            return True
        if not math.dist(before.position_mm, planned.position_mm) <= SAME_MM:
            self._constant_since = at
        return at - self._constant_since >= STOOD_S
