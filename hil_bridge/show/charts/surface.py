"""The truth of the emulated surface along the tool's axis. Nothing of it was measured."""

import math

from hil_bridge.record.records import TruthRecord
from protocol.geometry import angle_of_vectors, tool_axis

TOUCH_N = 0.05
"""Force from which the tool touches. Chosen: far below any force that a sensor of the house resolves under noise."""


def tilt_deg(truth: TruthRecord) -> float | None:
    """Angle between the tool's axis and the inward normal; None where the truth tells no normal."""
    if not all(map(math.isfinite, (*truth.normal, *truth.quaternion))):
        return None
    x, y, z = truth.normal
    return math.degrees(angle_of_vectors(tool_axis(truth.quaternion), (-x, -y, -z)))


def touches(truth: TruthRecord) -> bool:
    """Whether the tool touches the surface."""
    return math.hypot(*truth.force) > TOUCH_N
