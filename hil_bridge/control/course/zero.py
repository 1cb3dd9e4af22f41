"""Checks of a sensor before its reading is taken for zero, and before anything moves. Pure.

A reading is the mean of some frames in the sensor frame, fx fy fz in N and mx my mz in N·m, shape (6,).
"""

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from hil_bridge.control.geometry.frames import tool_gravity_wrench
from hil_bridge.control.geometry.wrist import NO_WRENCH, Wrist
from protocol.geometry import Quaternion

AXES = ("Fx", "Fy", "Fz", "Mx", "My", "Mz")
"""Names of the sensor's axes, in the order of a reading."""

UNVERIFIED_SHARE = 0.1
"""Chosen: part of a force that may lie on axes which nothing has verified. Were they mirrored, the sensor would tell 80
% of it.
"""

MAIN_SHARE = 0.5
"""Share of the approach direction on a sensor's axis from which that axis matters. Chosen: tilted by less than 60°."""

_MOMENT_ARM = 0.1
"""Chosen: N·m of unrest for each N that is allowed, m, the order of a tool's length."""


@dataclass(frozen=True, slots=True)
class Reading:
    """Some frames of a sensor that was left alone."""

    mean: tuple[float, ...]
    """N and N·m in the sensor frame, (6,)."""
    drift: tuple[float, ...]
    """Mean of the newer half less that of the older one, N and N·m, (6,)."""
    error_n: float = 0.0
    """Standard error of the mean by the white noise of the frames, of the force axis where it is largest, N."""

    def unsteady(self, change_n: float) -> str:
        """Which axis drifts by more than this, in words; empty for a reading at rest."""
        for axis, drift, limit, unit in zip(AXES, self.drift, _limits(change_n), _UNITS, strict=True):
            if abs(drift) > limit:
                return f"{axis} drifts by {drift:+.2f} {unit}"
        return ""


_UNITS = ("N",) * 3 + ("N·m",) * 3


def _limits(change_n: float) -> tuple[float, ...]:
    return (change_n,) * 3 + (change_n * _MOMENT_ARM,) * 3


def reading(wrenches: Sequence[Sequence[float]]) -> Reading:
    """Joint finding from these frames; at least two of them, oldest first."""
    table = np.asarray(wrenches, dtype=float)
    half = len(table) // 2
    drift = table[half:].mean(axis=0) - table[:half].mean(axis=0)
    noise = np.sqrt(0.5 * np.square(np.diff(table[:, :3], axis=0)).mean(axis=0))
    error_n = float(noise.max()) / math.sqrt(len(table))
    return Reading(tuple(table.mean(axis=0).tolist()), tuple(drift.tolist()), error_n)


def weight_reading(wrist: Wrist, quaternion: Quaternion) -> tuple[float, ...]:
    """Return the sensor's reading for this tool and its own bias at this orientation, without contact, (6,)."""
    weight = tool_gravity_wrench(quaternion, wrist.mass, wrist.centre_of_gravity)
    to_sensor = wrist.alignment().T
    seen = np.concatenate([to_sensor @ weight[:3], to_sensor @ weight[3:]]) + np.asarray(wrist.bias)
    return tuple(seen.tolist())


def weight_fault(
    read: Sequence[float], expected: Sequence[float], tolerance_n: float, tolerance_nm: float
) -> str:
    """Why a reading is not that of the tool alone, axis by axis and with what it looks like; empty while it is."""
    tolerances = (tolerance_n,) * 3 + (tolerance_nm,) * 3
    wrong = [k for k in range(len(AXES)) if not abs(read[k] - expected[k]) <= tolerances[k]]
    if not wrong:
        return ""
    told = ", ".join(
        f"{AXES[k]} reads {read[k]:.2f} {_UNITS[k]} where the tool's weight is {expected[k]:.2f} {_UNITS[k]}"
        for k in wrong
    )
    return f"{told}: {_likeness(read, expected, tolerances)}"


def _likeness(read: Sequence[float], expected: Sequence[float], tolerances: Sequence[float]) -> str:
    """Possible causes of a reading, in words: always a touch, and one fault of an axis where it fits."""
    touch = "the tool touches something"
    main = max(range(3), key=lambda k: abs(expected[k]))
    value, weight, tolerance = read[main], expected[main], tolerances[main]
    if abs(weight) > tolerance:
        others = [k for k in range(3) if k != main]
        quiet = all(abs(read[k] - expected[k]) <= tolerances[k] for k in others)
        for k in others:
            if abs(abs(read[k]) - abs(weight)) <= tolerance and abs(value) <= tolerance:
                return f"{touch}, or {AXES[main]} and {AXES[k]} are swapped"
        if quiet and abs(value + weight) <= tolerance:
            return f"{touch}, or {AXES[main]} is mirrored (sensor.quaternion, sensor.flip_fx_mx)"
        if quiet and abs(value) <= tolerance:
            return f"{touch}, {AXES[main]} is dead or scaled wrongly, or the tool is gone"
    return (
        f"{touch}, the tool or the sensor's bias is another (`identify tool`), or an axis is scaled wrongly"
    )


def unverified_axes(
    wrist: Wrist | None, quaternion: Quaternion, tolerance_n: float, tolerance_nm: float
) -> tuple[int, ...]:
    """Numbers of the axes on which a reading of the weight proves nothing: a dead one would read the same within its
    tolerance. All of them where the tool's weight is not known.
    """
    if wrist is None:
        return tuple(range(len(AXES)))
    weight = weight_reading(replace(wrist, bias=NO_WRENCH), quaternion)
    tolerances = (tolerance_n,) * 3 + (tolerance_nm,) * 3
    return tuple(k for k, limit in enumerate(tolerances) if not abs(weight[k]) > limit)


def doubtful_axes(
    wrist: Wrist, direction: Sequence[float], quaternion: Quaternion, unverified: Collection[int]
) -> tuple[int, ...]:
    """Numbers of the force axes, of those that nothing has verified, on which too much of a force in this direction
    lies; empty where they carry no more than `UNVERIFIED_SHARE` of it together. `direction` is a unit vector, base
    frame.
    """
    shares = wrist.in_sensor_axes(direction, quaternion).tolist()
    parts = {k: shares[k] ** 2 for k in range(3) if k in unverified}
    if sum(parts.values()) <= UNVERIFIED_SHARE:
        return ()
    return tuple(k for k, part in parts.items() if part > UNVERIFIED_SHARE / 3.0)


def main_axes(wrist: Wrist, approach: Sequence[float], quaternion: Quaternion) -> tuple[int, ...]:
    """Numbers of the sensor's force axes on which the approach direction mainly lies."""
    shares = wrist.in_sensor_axes(approach, quaternion).tolist()
    return tuple(k for k, share in enumerate(shares) if abs(share) >= MAIN_SHARE)


def lost_forces(wrist: Wrist | None, approach: Sequence[float], quaternion: Quaternion) -> tuple[float, ...]:
    """Return the forces along the approach that a sensor reports, from its zero, after losing the tool's weight, N.

    It loses the weight on all axes, or on one that the approach mainly lies on. Empty if the weight is unknown.
    """
    if wrist is None:
        return ()
    weight = weight_reading(replace(wrist, bias=NO_WRENCH), quaternion)
    shares = wrist.in_sensor_axes(approach, quaternion).tolist()
    lost = [weight[k] * shares[k] for k in range(3)]
    return sum(lost), *(lost[k] for k in main_axes(wrist, approach, quaternion))


def lift_fault(
    change: float, before: float | None, after: float | None, change_n: float, moved_mm: float
) -> str:
    """Why the force that changed on the way from the surface forbids a zero; empty while it may be taken.

    `change` is the length of the change of the force, N; `before` and `after` are lengths of the contact force, N, None
    where the tool's weight is not known.
    """
    if change <= change_n:
        return ""
    way = f"while the tool moved {moved_mm:.3f} mm against frame.approach"
    if before is None or after is None:
        return (
            f"the force changed by {change:.1f} N {way}: the tool was touching, or frame.approach points the wrong "
            "way; "
            "free it (hil-bridge free), or correct frame.approach"
        )
    if after < before:
        return (
            f"the tool was touching: the contact force fell from {before:.1f} to {after:.1f} N {way}; "
            "free it (hil-bridge free), then start again"
        )
    return (
        f"away is not away: the contact force rose from {before:.1f} to {after:.1f} N {way}; "
        "correct frame.approach, or look what is behind the tool"
    )
