"""Spindle of a tool: the rotating force of its unbalance and the run-out of its tip, as functions of time.

The tool turns about its z axis, right-handed, at a constant speed from power-up on. The seed determines the angle at
power-up. Unbalance and run-out have the same direction, because a displaced tool is heavier on that side.
"""

import math
import random
from collections.abc import Sequence

import numpy as np

from emulators.seams import Floats
from emulators.tool import ToolProfile, rotation_matrix
from protocol.geometry import Quaternion


class Spindle:
    """Spindle that turns a tool. Equal times give equal results, whatever was read before."""

    def __init__(self, tool: ToolProfile, powered_at: float, seed: int) -> None:
        """`powered_at` is the time from which the tool turns, s."""
        self.rate = tool.spindle_rpm * math.tau / 60.0
        """Angular speed about tool z, rad/s."""
        self._powered_at = powered_at
        self._begin = random.Random(f"{seed} spindle").uniform(0.0, math.tau)
        self._centrifugal = tool.unbalance_g_mm * 1e-6 * self.rate**2
        self._lever = tool.length_mm * 1e-3
        # A dial indicator reads twice the eccentricity, in m here.
        self._radial, self._axial = 0.5e-6 * tool.radial_run_out_um, 0.5e-6 * tool.axial_run_out_um

    def wrench(self, times: Floats) -> Floats:
        """Return the wrench (6, n) of the unbalance about the sensor's origin in the sensor frame, N and N·m.

        The force acts at the tip, in the plane perpendicular to tool z.
        """
        cosine, sine = self._direction(times)
        fx, fy = self._centrifugal * cosine, self._centrifugal * sine
        zero = np.zeros_like(fx)
        return np.stack((fx, fy, zero, -self._lever * fy, self._lever * fx, zero))

    def force(self, times: Floats, orientations: Sequence[tuple[slice, Quaternion]]) -> Floats:
        """Return the force (n, 3) of the unbalance on the tip in the base frame, N.

        `orientations` are slices that cover the n times.
        """
        return _in_base(self.wrench(times)[:3].T, orientations)

    def run_out(
        self, times: Floats, orientations: Sequence[tuple[slice, Quaternion]]
    ) -> tuple[Floats, Floats]:
        """Return the displacement (n, 3) of the tip from its mean position, m, and its velocity (n, 3), m/s.

        Both are in the base frame. The axial part is largest in the direction of the radial part.
        """
        cosine, sine = self._direction(times)
        offset = np.stack((self._radial * cosine, self._radial * sine, self._axial * cosine), axis=1)
        drift = np.stack((-self._radial * sine, self._radial * cosine, -self._axial * sine), axis=1)
        return _in_base(offset, orientations), _in_base(self.rate * drift, orientations)

    def turning(self, orientations: Sequence[tuple[slice, Quaternion]]) -> Floats:
        """Return the angular velocity (3, n) of the tool in the base frame, rad/s."""
        axes = np.empty((3, orientations[-1][0].stop))
        for part, quaternion in orientations:
            axes[:, part] = rotation_matrix(quaternion)[:, 2:]
        return self.rate * axes

    def _direction(self, times: Floats) -> tuple[Floats, Floats]:
        """Return the tool frame's x and y (n,) of the unit vector towards the heavy side."""
        angle = self._begin + self.rate * (times - self._powered_at)
        return np.cos(angle), np.sin(angle)


def _in_base(vectors: Floats, orientations: Sequence[tuple[slice, Quaternion]]) -> Floats:
    """Return vectors (n, 3) in the tool frame as vectors in the base frame."""
    rotated = np.empty_like(vectors)
    for part, quaternion in orientations:
        rotated[part] = vectors[part] @ rotation_matrix(quaternion).T
    return rotated
