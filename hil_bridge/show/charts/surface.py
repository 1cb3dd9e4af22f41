"""Ground truth of the emulated surface relative to the tool axis. None of these values are measured."""

import math

from hil_bridge.record.records import TruthRecord
from protocol.geometry import angle_of_vectors, tool_axis

TOUCH_N = 0.05
"""Force above which the tool counts as in contact, N. Chosen: far below what any supported sensor resolves under
noise.
"""


def tilt_deg(truth: TruthRecord) -> float | None:
    """Return the angle between the tool axis and the inward normal, °; None if the normal is unknown."""
    if not all(map(math.isfinite, (*truth.normal, *truth.quaternion))):
        return None
    x, y, z = truth.normal
    return math.degrees(angle_of_vectors(tool_axis(truth.quaternion), (-x, -y, -z)))


def touches(truth: TruthRecord) -> bool:
    """Return whether the tool is in contact with the surface."""
    return math.hypot(*truth.force) > TOUCH_N
