"""Ground truth of the emulated surface relative to the tool axis. None of these values are measured."""

import math
from collections.abc import Sequence

from hil_bridge.record.records import TruthRecord
from protocol.geometry import angle_of_vectors, tool_axis

TOUCH_N = 0.05
"""Force above which the tool counts as in contact, N. Chosen: far below what any supported sensor resolves under
noise.
"""
LEAST_DEFLECTION_UM = 1.0
"""Deflection up to which a view counts the arm as rigid, µm. Chosen: far above a rounding error."""


def tilt_deg(truth: TruthRecord) -> float | None:
    """Return the angle between the tool axis and the inward normal, °; None if the normal is unknown."""
    if not all(map(math.isfinite, (*truth.normal, *truth.quaternion))):
        return None
    x, y, z = truth.normal
    return math.degrees(angle_of_vectors(tool_axis(truth.quaternion), (-x, -y, -z)))


def touches(truth: TruthRecord) -> bool:
    """Return whether the tool is in contact with the surface."""
    return math.hypot(*truth.force) > TOUCH_N


def deflection_um(truth: TruthRecord, approach: Sequence[float]) -> tuple[float, float]:
    """Return the deflection of the tool against the approach, positive while pressing, and its magnitude across it, µm.

    `approach` is a unit vector in the base frame. Both are NaN if the deflection is unknown.
    """
    along = sum(a * b for a, b in zip(truth.deflection, approach, strict=True))
    across = math.dist(truth.deflection, [along * part for part in approach])
    return -1e6 * along, 1e6 * across
