"""Names for mistakes: from a value that is wrong, and the right one, to the words that say what was done wrong."""

import math
from collections.abc import Sequence

from protocol.geometry import Quaternion, Vector, angle_between
from protocol.wrench import AXES


class Finding(AssertionError):
    """A mistake that a suite has found; its text names it."""


_FACTORS = (
    (1000.0, "1000 times too large: mm or mN taken for m or N"),
    (1e-3, "1000 times too small: m or N taken for mm or mN"),
)


def position_mistake(told: Vector, true: Vector, allowed: float) -> str:
    """Words for a position, m, that is more than `allowed` from the true one; empty for one that is not."""
    if not all(map(math.isfinite, told)):
        return f"the reported position {told} is not a number"
    away = math.dist(told, true)
    if away <= allowed:
        return ""
    words = f"the reported position is {away * 1e3:.1f} mm from where the robot is"
    for factor, meaning in _FACTORS:
        if math.dist(told, tuple(factor * one for one in true)) <= 0.01 * math.hypot(*told):
            return f"{words}: {meaning}"
    for axis in range(3):
        mirrored = [-one if k == axis else one for k, one in enumerate(true)]
        if math.dist(told, mirrored) <= allowed:
            return f"{words}: the sign of {'xyz'[axis]} is wrong"
    return words


def orientation_mistake(told: Quaternion, true: Quaternion, allowed: float) -> str:
    """Words for an orientation that is more than `allowed`, rad, from the true one; empty for one that is not."""
    angle = angle_between(told, true)
    if angle <= allowed:
        return ""
    words = f"the reported orientation is {math.degrees(angle):.1f} degrees from the true one"
    w, x, y, z = told
    for other, meaning in (
        ((w, -x, -y, -z), "the sign of its vector part is wrong, so that it turns the other way"),
        ((z, w, x, y), "it is in the order x y z w, not w x y z"),
    ):
        if angle_between(other, true) <= allowed:
            return f"{words}: {meaning}"
    return words


def wrench_mistake(told: Sequence[float], true: Sequence[float], allowed: Sequence[float]) -> str:
    """Words for six values of which one is more than `allowed` from the true one; empty where none is."""
    if not all(map(math.isfinite, told)):
        return f"a frame tells {tuple(told)}, which is not a number"
    wrong = [k for k in range(6) if abs(told[k] - true[k]) > allowed[k]]
    if not wrong:
        return ""
    k = max(wrong, key=lambda axis: abs(told[axis] - true[axis]) / allowed[axis])
    words = f"{AXES[k]} is told as {told[k]:.4g}, it is {true[k]:.4g}"
    if abs(told[k] + true[k]) <= allowed[k]:
        return f"{words}: the sign of {AXES[k]} is wrong"
    if abs(true[k]) > 10.0 * allowed[k]:
        factor = told[k] / true[k]
        if abs(factor) > 1.5 or abs(factor) < 0.67:
            words = f"{words}: {factor:.4g} times the true value, a wrong unit or scale"
    elsewhere = [AXES[j] for j in range(6) if j != k and abs(told[k] - true[j]) <= allowed[k] < abs(true[j])]
    return f"{words}; it is the value of {elsewhere[0]}" if elsewhere else words
