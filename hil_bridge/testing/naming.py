"""Diagnosis of mistakes: from a wrong and a true value to a description of the likely cause."""

import math
from collections.abc import Sequence

from protocol.geometry import Quaternion, Vector, angle_between
from protocol.wrench import AXES


class Finding(AssertionError):
    """Mistake that a suite detected; its text names it."""


_FACTORS = (
    (1000.0, "1000 times too large: mm or mN taken for m or N"),
    (1e-3, "1000 times too small: m or N taken for mm or mN"),
)


def position_mistake(reported: Vector, true: Vector, allowed: float) -> str:
    """Describe the error of a position that is more than `allowed`, m, from the true one; empty if it is not."""
    if not all(map(math.isfinite, reported)):
        return f"the reported position {reported} is not a number"
    away = math.dist(reported, true)
    if away <= allowed:
        return ""
    words = f"the reported position is {away * 1e3:.1f} mm from where the robot is"
    for factor, meaning in _FACTORS:
        if math.dist(reported, tuple(factor * one for one in true)) <= 0.01 * math.hypot(*reported):
            return f"{words}: {meaning}"
    for axis in range(3):
        mirrored = [-one if k == axis else one for k, one in enumerate(true)]
        if math.dist(reported, mirrored) <= allowed:
            return f"{words}: the sign of {'xyz'[axis]} is wrong"
    return words


def orientation_mistake(reported: Quaternion, true: Quaternion, allowed: float) -> str:
    """Describe the error of an orientation that is more than `allowed`, rad, from the true one; empty if it is not."""
    angle = angle_between(reported, true)
    if angle <= allowed:
        return ""
    words = f"the reported orientation is {math.degrees(angle):.1f} degrees from the true one"
    w, x, y, z = reported
    for other, meaning in (
        ((w, -x, -y, -z), "the sign of its vector part is wrong, so that it rotates the other way"),
        ((z, w, x, y), "it is in the order x y z w, not w x y z"),
    ):
        if angle_between(other, true) <= allowed:
            return f"{words}: {meaning}"
    return words


def wrench_mistake(reported: Sequence[float], true: Sequence[float], allowed: Sequence[float]) -> str:
    """Describe the error of six values of which one is more than `allowed` from the true one; empty if none is."""
    if not all(map(math.isfinite, reported)):
        return f"a frame tells {tuple(reported)}, which is not a number"
    wrong = [k for k in range(6) if abs(reported[k] - true[k]) > allowed[k]]
    if not wrong:
        return ""
    k = max(wrong, key=lambda axis: abs(reported[axis] - true[axis]) / allowed[axis])
    words = f"{AXES[k]} is reported as {reported[k]:.4g}, but is {true[k]:.4g}"
    if abs(reported[k] + true[k]) <= allowed[k]:
        return f"{words}: the sign of {AXES[k]} is wrong"
    if abs(true[k]) > 10.0 * allowed[k]:
        factor = reported[k] / true[k]
        if abs(factor) > 1.5 or abs(factor) < 0.67:
            words = f"{words}: {factor:.4g} times the true value, a wrong unit or scale"
    elsewhere = [
        AXES[j] for j in range(6) if j != k and abs(reported[k] - true[j]) <= allowed[k] < abs(true[j])
    ]
    return f"{words}; it is the value of {elsewhere[0]}" if elsewhere else words
