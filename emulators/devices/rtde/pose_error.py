"""Error of the arm's own force measurement that depends on its pose.

Source: R. Trochimczuk et al., "Experimental Evaluation of UR5e Collaborative Robot Force Control in Low-Force
Applications", Sensors 26 (2026) 1709, doi:10.3390/s26051709. With 10 N desired in force mode, the mean contact force
was 8.95 N to 13.26 N, depending on the place in the work space. The abstract does not state the cause, and the forces
of single places are in its tables, which this project has not seen.

Assumed: the error is one of the measured force, and the range holds for every arm, also for a CB3. The error vanishes
without a contact, because force mode is used after zero_ftsensor(), which would remove a constant one. It is
proportional to the force up to 10 N, the largest force of that paper, and constant above: at the largest forces, a
proportional error would exceed any accuracy that a manufacturer specifies. It acts along the contact force.
"""

import math
import random
from operator import mul

from emulators.devices.rtde.kinematics import Joints
from protocol.geometry import Vector

_MEASURED_N = 10.0
"""Reported force at which the published range holds, N. Source: the paper."""
_WAVES = 2
"""Number of waves over the joint angles whose mean is the error. Chosen: over 25 places of the work space of a UR5e
with its tool down, the contact force at 10 N then varies by 3.8 N in the median over the seeds, by less than 2.5 N
for a tenth of them, and by 4.3 N at most.
"""
_PERIODS = (1, 2)
"""Periods of a wave in one turn of a joint. Chosen: an error of a joint repeats after a full turn, and these are the
fewest periods, so that the error varies slowly along a path.
"""


def _draw_periods(rng: random.Random) -> list[int]:
    """Draw the signed periods of a wave for each joint.

    If a tool that points down moves over the work space, joints 1 and 6 turn in the same direction, and joints 2 and
    3 in opposite ones. The signs let their parts of the phase add up, because the error varies over the work space.
    """
    a, b, c, d = (rng.choice((-1, 1)) for _ in range(4))
    return [sign * rng.choice(_PERIODS) for sign in (a, b, -b, c, d, a)]


class PoseError:
    """Smooth error of the measured contact force over the joint angles. The seed determines it."""

    def __init__(self, range_n: tuple[float, float], seed: int) -> None:
        """`range_n` is the least and the largest deviation of the contact force from a reported force of 10 N, N."""
        least, largest = range_n
        self._middle, self._half = 0.5 * (largest + least), 0.5 * (largest - least)
        rng = random.Random(f"{seed} pose error")
        self._waves = [(rng.uniform(0.0, 2.0 * math.pi), _draw_periods(rng)) for _ in range(_WAVES)]

    def deviation(self, joints: Joints) -> float:
        """Return the contact force minus the reported one at these joint angles, N, for a reported force of 10 N."""
        total = sum(math.sin(phase + sum(map(mul, periods, joints))) for phase, periods in self._waves)
        return self._middle + self._half * total / _WAVES

    def measure(self, contact: Vector, joints: Joints) -> Vector:
        """Return the measured contact force at these joint angles, N."""
        deviation = self.deviation(joints)
        share = 1.0 - deviation / max(math.hypot(*contact), _MEASURED_N + deviation)
        x, y, z = contact
        return share * x, share * y, share * z
