"""Corrections of a pose: X Y Z in mm, and angles A B C in degrees whose rotation is applied after the robot's own
rotation.
"""

import math

from protocol.devices.rsi.angles import nearest
from protocol.devices.rsi.profile import RsiLink
from protocol.geometry import Pose, angles_of, from_angles, inverse, product

Correction = tuple[float, ...]
"""Correction: X Y Z in mm, A B C in degrees."""
NO_CORRECTION: Correction = (0.0,) * 6


def offset_between(actual: Pose, planned: Pose) -> Correction:
    """Return the correction that leads from the planned to the actual pose."""
    (x, y, z), (u, v, w) = actual.position, planned.position
    return (
        (x - u) * 1e3,
        (y - v) * 1e3,
        (z - w) * 1e3,
        *angles_of(product(actual.quaternion, inverse(planned.quaternion))),
    )


def correction_for(pose: Pose, origin: tuple[Pose, Correction], near: Correction) -> Correction:
    """Return the correction that brings the robot to a pose. `origin` is a pose together with the correction that
    leads to it.

    Of all equivalent angles, the ones nearest to `near` are returned.
    """
    (position, quaternion), (x0, y0, z0, a0, b0, c0) = origin
    (x, y, z), (u, v, w) = pose.position, position
    turn = product(product(pose.quaternion, inverse(quaternion)), from_angles(a0, b0, c0))
    (a, b, c), (_, _, _, a0, b0, c0) = angles_of(turn), near
    x, y, z = x0 + (x - u) * 1e3, y0 + (y - v) * 1e3, z0 + (z - w) * 1e3
    return x, y, z, nearest(a, a0), nearest(b, b0), nearest(c, c0)


def clamp(correction: Correction, link: RsiLink) -> Correction:
    """Limit a correction to the range configured for the link."""
    most, most_deg = link.limit_mm, link.limit_deg
    return (
        *[max(-most, min(most, value)) for value in correction[:3]],
        *[max(-most_deg, min(most_deg, value)) for value in correction[3:]],
    )


def step_towards(goal: Correction, here: Correction, change: Correction, link: RsiLink) -> Correction:
    """Return the correction after one cycle: a step from `here` towards `goal`. The step may be as long as the set
    point's `change` plus what is allowed for catching up, but no faster than the robot's maximum speed.
    """
    x, y, z, a, b, c = [to - at for to, at in zip(goal, here, strict=True)]
    u, v, w, d, e, f = change
    cycle = link.cycle_ms / 1e3
    most_mm = min(link.fastest_mm_s * cycle, math.hypot(u, v, w) + link.catch_up_mm_s * cycle)
    most_deg = min(link.fastest_deg_s * cycle, math.hypot(d, e, f) + link.catch_up_deg_s * cycle)
    share = min(1.0, most_mm / max(math.hypot(x, y, z), 1e-12), most_deg / max(math.hypot(a, b, c), 1e-12))
    i, j, k, p, q, r = here
    return i + share * x, j + share * y, k + share * z, p + share * a, q + share * b, r + share * c
