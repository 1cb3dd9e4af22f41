"""Recent cycles of the arm, and detection of a contact in them: tool_contact() of URScript.

The controller's own detector is not published. Assumed: a contact is a change of actual_TCP_force by more than a
threshold from the oldest stored cycles.
"""

import math
from collections import deque

from emulators.devices.rtde.kinematics import Joints
from protocol.geometry import Vector, Wrench

HISTORY_CYCLES = 250
"""Number of stored cycles. Chosen: half a second of an e-Series."""
_BASE = 50
"""Number of the oldest cycles whose mean is the force before a contact. Chosen."""
BEGIN_SHARE = 0.2
"""Share of the threshold that the change of force must exceed at the beginning of a contact. Chosen."""


class History:
    """Joint angles and forces of recent cycles."""

    def __init__(self) -> None:
        self._cycles: deque[tuple[Joints, Wrench]] = deque(maxlen=HISTORY_CYCLES)

    def note(self, joints: Joints, force: Wrench) -> None:
        """Store the joint angles of a cycle, and its actual_TCP_force in base axes."""
        self._cycles.append((joints, force))

    def forget(self) -> None:
        """Discard all cycles, because the force sensor has a new zero or another program begins."""
        self._cycles.clear()

    def joints_before(self, steps: int) -> Joints | None:
        """Return the joint angles this many cycles ago, or the oldest stored ones. None if no cycle is stored."""
        if not self._cycles:
            return None
        return self._cycles[-1 - min(max(steps, 0), len(self._cycles) - 1)][0]

    def steps_since_contact(self, direction: Vector, threshold_n: float) -> int:
        """Return the number of cycles back to just before a contact began; 0 if there is no contact.

        `direction`, in base axes, is the direction of the motion into the contact. A zero vector permits any
        direction. `threshold_n` is in N.
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
