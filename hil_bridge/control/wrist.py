"""From what the wrist sensor says to the contact wrench on the tool."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hil_bridge.control.frames import Array, rotation_matrix, tool_gravity_wrench


@dataclass(frozen=True, slots=True)
class Wrist:
    """How the sensor sits between flange and tool.

    The sensor's origin lies on the tool's z axis, which is also its own, so its moments stay about that origin.
    """

    mounting: float = 0.0
    """Angle from the tool's x axis to the sensor's about the common z axis, rad."""
    flip: bool = False
    """Negate Fx and Mx: for a sensor that counts left-handed as seen from the tool (JR3 manual 5907E)."""
    mass: float = 0.0
    """What hangs below the sensor, kg."""
    centre_of_gravity: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Of that mass, from the sensor's origin in the tool frame, m."""

    def contact_wrench(
        self, measured: Sequence[float], quaternion: Sequence[float], quaternion_tare: Sequence[float]
    ) -> Array:
        """Wrench of the environment on the tool, tool frame, N and N·m, shape (6,).

        `measured` is in the sensor frame, counted from the zero taken at `quaternion_tare`; quaternions are w x y z,
        tool in base. The zero hides the weight at that orientation, so only its change since then is taken off.
        """
        wrench = np.array(measured, dtype=float)
        if self.flip:
            wrench[[0, 3]] *= -1.0
        if self.mounting:
            turn = rotation_matrix((math.cos(self.mounting / 2), 0.0, 0.0, math.sin(self.mounting / 2)))
            wrench = np.concatenate([turn @ wrench[:3], turn @ wrench[3:]])
        if self.mass and tuple(quaternion) != tuple(quaternion_tare):
            wrench -= tool_gravity_wrench(quaternion, self.mass, self.centre_of_gravity)
            wrench += tool_gravity_wrench(quaternion_tare, self.mass, self.centre_of_gravity)
        return wrench
