"""What the emulated surface knows of the tool's axis. Nothing of it was measured."""

import math

from hil_bridge.record.records import TruthRecord

TOUCH_N = 0.05
"""Force from which the tool touches. Chosen: far below any force that a sensor of the house resolves under noise."""


def tilt_deg(truth: TruthRecord) -> float | None:
    """Angle between the tool's axis and the inward normal; None where the truth tells no normal."""
    if not all(map(math.isfinite, (*truth.normal, *truth.quaternion))):
        return None
    w, x, y, z = truth.quaternion
    a = (2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y))
    b = tuple(-part for part in truth.normal)
    cross = (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])
    # The sine and the cosine: the cosine alone says little of a small angle.
    return math.degrees(math.atan2(math.hypot(*cross), sum(p * q for p, q in zip(a, b, strict=True))))


def touches(truth: TruthRecord) -> bool:
    """Whether the tool touches the surface."""
    return math.hypot(*truth.force) > TOUCH_N
