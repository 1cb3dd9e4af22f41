"""Checks of a sensor before its reading is used as the zero, and before the robot moves. Pure.

A reading is the mean of some frames in the sensor frame: fx fy fz in N and mx my mz in N·m, shape (6,).
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
"""Largest share of a force that may act on unverified axes. Chosen: if these axes were mirrored, the sensor would
report 80 % of the force.
"""

MAIN_SHARE = 0.5
"""Smallest component of the approach direction on an axis of the sensor for which the axis matters. Chosen: an axis
tilted by less than 60°.
"""

_MOMENT_ARM = 0.1
"""Allowed fluctuation of a moment, N·m, divided by the allowed fluctuation of a force, N, in m. Chosen: the order
of magnitude of a tool's length.
"""


@dataclass(frozen=True, slots=True)
class Reading:
    """Mean of several frames of a sensor without contact."""

    mean: tuple[float, ...]
    """Mean in the sensor frame, N and N·m, shape (6,)."""
    drift: tuple[float, ...]
    """Mean of the newer half less the mean of the older half, N and N·m, shape (6,)."""
    error_n: float = 0.0
    """Standard error of the mean due to the white noise of the frames, for the noisiest force axis, N."""

    def unsteady(self, change_n: float) -> str:
        """Return a description of an axis that drifts by more than `change_n`; empty if the reading is steady."""
        for axis, drift, limit, unit in zip(AXES, self.drift, _limits(change_n), _UNITS, strict=True):
            if abs(drift) > limit:
                return f"{axis} drifts by {drift:+.2f} {unit}"
        return ""


_UNITS = ("N",) * 3 + ("N·m",) * 3


def _limits(change_n: float) -> tuple[float, ...]:
    return (change_n,) * 3 + (change_n * _MOMENT_ARM,) * 3


def reading(wrenches: Sequence[Sequence[float]]) -> Reading:
    """Return the mean of the given frames, oldest first. At least two frames are required."""
    table = np.asarray(wrenches, dtype=float)
    half = len(table) // 2
    drift = table[half:].mean(axis=0) - table[:half].mean(axis=0)
    noise = np.sqrt(0.5 * np.square(np.diff(table[:, :3], axis=0)).mean(axis=0))
    error_n = float(noise.max()) / math.sqrt(len(table))
    return Reading(tuple(table.mean(axis=0).tolist()), tuple(drift.tolist()), error_n)


def weight_reading(wrist: Wrist, quaternion: Quaternion) -> tuple[float, ...]:
    """Return the reading of a sensor with this tool and its own bias at the given orientation, without contact,
    shape (6,).
    """
    weight = tool_gravity_wrench(quaternion, wrist.mass, wrist.centre_of_gravity)
    to_sensor = wrist.alignment().T
    load = np.concatenate([to_sensor @ weight[:3], to_sensor @ weight[3:]]) + np.asarray(wrist.bias)
    return tuple(load.tolist())


def weight_fault(
    read: Sequence[float], expected: Sequence[float], tolerance_n: float, tolerance_nm: float
) -> str:
    """Return a description of how a reading differs from the weight of the tool, for each axis and with the likely
    cause; empty if it matches.
    """
    tolerances = (tolerance_n,) * 3 + (tolerance_nm,) * 3
    wrong = [k for k in range(len(AXES)) if not abs(read[k] - expected[k]) <= tolerances[k]]
    if not wrong:
        return ""
    deviations = ", ".join(
        f"{AXES[k]} reads {read[k]:.2f} {_UNITS[k]} where the tool's weight is {expected[k]:.2f} {_UNITS[k]}"
        for k in wrong
    )
    return f"{deviations}: {_likeness(read, expected, tolerances)}"


def _likeness(read: Sequence[float], expected: Sequence[float], tolerances: Sequence[float]) -> str:
    """Return possible causes of a reading, as text: always a touch, and also a fault of one axis if it fits."""
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
        f"{touch}, the tool or the sensor's bias has changed (`identify tool`), or an axis is scaled wrongly"
    )


def unverified_axes(
    wrist: Wrist | None, quaternion: Quaternion, tolerance_n: float, tolerance_nm: float
) -> tuple[int, ...]:
    """Return the indices of the axes that the tool's weight cannot verify, because a dead axis would give the same
    reading within its tolerance. All axes are included if the tool's weight is unknown.
    """
    if wrist is None:
        return tuple(range(len(AXES)))
    weight = weight_reading(replace(wrist, bias=NO_WRENCH), quaternion)
    tolerances = (tolerance_n,) * 3 + (tolerance_nm,) * 3
    return tuple(k for k, limit in enumerate(tolerances) if not abs(weight[k]) > limit)


def doubtful_axes(
    wrist: Wrist, direction: Sequence[float], quaternion: Quaternion, unverified: Collection[int]
) -> tuple[int, ...]:
    """Return the indices of the unverified force axes that carry too large a share of a force in the given
    direction; empty if together they carry no more than `UNVERIFIED_SHARE`. `direction` is a unit vector in the
    base frame.
    """
    shares = wrist.in_sensor_axes(direction, quaternion).tolist()
    parts = {k: shares[k] ** 2 for k in range(3) if k in unverified}
    if sum(parts.values()) <= UNVERIFIED_SHARE:
        return ()
    return tuple(k for k, part in parts.items() if part > UNVERIFIED_SHARE / 3.0)


def main_axes(wrist: Wrist, approach: Sequence[float], quaternion: Quaternion) -> tuple[int, ...]:
    """Return the indices of the sensor's force axes with a major component of the approach direction."""
    shares = wrist.in_sensor_axes(approach, quaternion).tolist()
    return tuple(k for k, share in enumerate(shares) if abs(share) >= MAIN_SHARE)


def lost_forces(wrist: Wrist | None, approach: Sequence[float], quaternion: Quaternion) -> tuple[float, ...]:
    """Return the forces along the approach, relative to its zero, that a sensor would report after losing the
    tool's weight, N.

    The sensor may lose the weight on all axes, or on one of the main axes of the approach. Empty if the weight is
    unknown.
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
    """Return the reason why a force that changed during the motion from the surface forbids a zero; empty if the
    zero may be taken.

    `change` is the magnitude of the change of the force, N. `before` and `after` are magnitudes of the contact
    force, N, or None if the tool's weight is unknown.
    """
    if change <= change_n:
        return ""
    motion = f"while the tool moved {moved_mm:.3f} mm against frame.approach"
    if before is None or after is None:
        return (
            f"the force changed by {change:.1f} N {motion}: the tool was touching, or frame.approach points the wrong "
            "way; "
            "free it (hil-bridge free), or correct frame.approach"
        )
    if after < before:
        return (
            f"the tool was touching: the contact force fell from {before:.1f} to {after:.1f} N {motion}; "
            "free it (hil-bridge free), then start again"
        )
    return (
        f"away is not away: the contact force rose from {before:.1f} to {after:.1f} N {motion}; "
        "correct frame.approach, or look what is behind the tool"
    )
