"""The newest cycles of the arm, and the contact that they show: tool_contact() of URScript.

The controller's own detector is not published. Assumed: a contact is a change of actual_TCP_force that is larger than
a threshold, against the force of the oldest cycles that are kept.
"""

import math
from collections import deque

from emulators.devices.rtde.kinematics import Joints
from protocol.geometry import Vector, Wrench

KEPT = 250
"""Chosen: cycles that are kept; half a second of an e-Series."""
_BASE = 50
"""Chosen: the oldest cycles, whose mean is the force before a contact."""
BEGIN_SHARE = 0.2
"""Chosen: a contact begins where the change passes this share of the threshold."""


class History:
    """Joints and force of the newest cycles."""

    def __init__(self) -> None:
        self._cycles: deque[tuple[Joints, Wrench]] = deque(maxlen=KEPT)

    def note(self, joints: Joints, force: Wrench) -> None:
        """One cycle: joints, and actual_TCP_force in base axes."""
        self._cycles.append((joints, force))

    def forget(self) -> None:
        """Forget older cycles: the force has another zero, or another program begins."""
        self._cycles.clear()

    def joints_before(self, steps: int) -> Joints | None:
        """Joints of so many cycles ago, the oldest where fewer are kept; None where none is."""
        if not self._cycles:
            return None
        return self._cycles[-1 - min(max(steps, 0), len(self._cycles) - 1)][0]

    def steps_since_contact(self, direction: Vector, threshold_n: float) -> int:
        """Cycles back to just before a contact began; 0 if there is none.

        `direction`, base axes, is that of the motion into the contact; of no length: any. `threshold_n` is in N.
        """
        cycles = list(self._cycles)
        base = cycles[:_BASE]
        if not base:
            return 0
        x, y, z = (sum(force[axis] for _, force in base) / len(base) for axis in range(3))
        length = math.hypot(*direction)

        def change(force: Wrench) -> float:
            a, b, c = force[0] - x, force[1] - y, force[2] - z
            if length < 1e-9:
                return math.hypot(a, b, c)
            return -(a * direction[0] + b * direction[1] + c * direction[2]) / length

        if change(cycles[-1][1]) < threshold_n:
            return 0
        steps = 1
        while steps < len(cycles) and change(cycles[-1 - steps][1]) > threshold_n * BEGIN_SHARE:
            steps += 1
        return steps
