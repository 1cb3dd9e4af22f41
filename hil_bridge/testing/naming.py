"""Diagnosis of mistakes: describes the likely cause of the difference between a reported and a true value."""

import math
from collections.abc import Sequence

from protocol.geometry import Quaternion, Vector, angle_between
from protocol.wrench import AXES


class Finding(AssertionError):
    """Mistake that a suite detected; its text names it."""


_FACTORS = (
    (1000.0, "1000 times too large: mm or mN interpreted as m or N"),
    (1e-3, "1000 times too small: m or N interpreted as mm or mN"),
)


def position_mistake(reported: Vector, true: Vector, allowed: float) -> str:
    """Describe the error of a position; empty if it deviates from the true position by at most `allowed`, m."""
    if not all(map(math.isfinite, reported)):
        return f"the reported position {reported} is not a number"
    away = math.dist(reported, true)
    if away <= allowed:
        return ""
    text = f"the reported position is {away * 1e3:.1f} mm from the true one"
    for factor, meaning in _FACTORS:
        if math.dist(reported, tuple(factor * one for one in true)) <= 0.01 * math.hypot(*reported):
            return f"{text}: {meaning}"
    for axis in range(3):
        mirrored = [-one if k == axis else one for k, one in enumerate(true)]
        if math.dist(reported, mirrored) <= allowed:
            return f"{text}: the sign of {'xyz'[axis]} is wrong"
    return text


def orientation_mistake(reported: Quaternion, true: Quaternion, allowed: float) -> str:
    """Describe the error of an orientation; empty if it deviates from the true orientation by at most `allowed`,
    rad.
    """
    angle = angle_between(reported, true)
    if angle <= allowed:
        return ""
    text = f"the reported orientation is {math.degrees(angle):.1f} degrees from the true one"
    w, x, y, z = reported
    for other, meaning in (
        ((w, -x, -y, -z), "the sign of its vector part is wrong, so that it rotates the other way"),
        ((z, w, x, y), "it is in the order x y z w, not w x y z"),
    ):
        if angle_between(other, true) <= allowed:
            return f"{text}: {meaning}"
    return text


def wrench_mistake(reported: Sequence[float], true: Sequence[float], allowed: Sequence[float]) -> str:
    """Describe the error of a wrench; empty if each of its six values deviates from the true one by at most
    `allowed`.
    """
    if not all(map(math.isfinite, reported)):
        return f"a frame contains {tuple(reported)}, which is not a number"
    wrong = [k for k in range(6) if abs(reported[k] - true[k]) > allowed[k]]
    if not wrong:
        return ""
    k = max(wrong, key=lambda axis: abs(reported[axis] - true[axis]) / allowed[axis])
    text = f"{AXES[k]} is reported as {reported[k]:.4g}, but is {true[k]:.4g}"
    if abs(reported[k] + true[k]) <= allowed[k]:
        return f"{text}: the sign of {AXES[k]} is wrong"
    if abs(true[k]) > 10.0 * allowed[k]:
        factor = reported[k] / true[k]
        if abs(factor) > 1.5 or abs(factor) < 0.67:
            text = f"{text}: {factor:.4g} times the true value, a wrong unit or scale"
    elsewhere = [
        AXES[j] for j in range(6) if j != k and abs(reported[k] - true[j]) <= allowed[k] < abs(true[j])
    ]
    return f"{text}; it is the value of {elsewhere[0]}" if elsewhere else text
