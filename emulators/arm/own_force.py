"""Force estimate that the robot itself computes: delayed and noisy, with an offset and with faults of its own.

It does not replace a force sensor at the wrist. A robot derives the estimate from motor currents, torques or a
coarse internal sensor, so it can only serve as a witness in addition to a sensor. All forces act from the
surroundings on the tool, base frame, N. Moments are pure noise.
"""

import math
import random
from collections.abc import Mapping
from typing import NamedTuple

from emulators.arm.noise_rows import NoiseRows
from emulators.faults.kinds import FOREVER, Fault, Parameter
from emulators.faults.ledger import Handler
from emulators.faults.own import OwnFaults
from emulators.seams import ContactSource
from protocol.geometry import Quaternion, Vector, Wrench, rotate

EVERY_S = 8e-3
"""Time between two samples of the contact force, s. Chosen: real estimates change at some tens of hertz, and
samples cost computing time.
"""
_PASSED_S = 1e-6
"""Age of the contact force at which it is sampled, s. Chosen: the path up to that time is committed."""
_AXES = "xyz"
_WALK_S = 10.0
"""Time in which the root-mean-square random walk of the zero reaches `Errors.walk_n`, s."""
NO_WRENCH: Wrench = (0.0,) * 6

WITNESS_FAULTS: Mapping[str, Fault] = {
    "dead": Fault("the robot's own force stays at its offset, whatever the tool touches", {}, FOREVER),
    "stuck": Fault("the robot's own force keeps its present value", {}, FOREVER),
    "offset": Fault(
        "the robot's own force has an additional offset",
        {f"{axis}_n": Parameter(0.0, f"offset along base {axis}", -1000.0, 1000.0, "N") for axis in _AXES},
        FOREVER,
        amounts=tuple(f"{axis}_n" for axis in _AXES),
    ),
    "scale": Fault(
        "the robot's own force contains only a share of the contact force",
        {"factor": Parameter(0.1, "share of the contact force", -10.0, 10.0)},
        FOREVER,
    ),
    "nan": Fault("the robot's own force is not a number", {}, FOREVER),
}
"""Faults of the target `witness`."""


class Slow(NamedTuple):
    """Exponential change of a given size with a time constant."""

    size: float = 0.0
    seconds: float = 1.0

    def share(self, passed: float) -> float:
        """Return the share of the remaining change that happens within `passed`, s."""
        return 1.0 - math.exp(-passed / self.seconds)


class Errors(NamedTuple):
    """Errors of a healthy force estimate."""

    offset_n: float
    """Largest offset of each axis, N. The seed determines the actual offset."""
    lag_s: float
    """Time constant of the estimate's filter, s."""
    noise: Wrench = NO_WRENCH
    """White noise of each axis while the arm is stationary, root mean square, N and N·m."""
    moving: Wrench = NO_WRENCH
    """White noise of each axis while the arm moves, root mean square, N and N·m."""
    walk_n: float = 0.0
    """Change of the zero of each axis in 10 s by a random walk, root mean square, N."""
    slope_n_min: float = 0.0
    """Largest steady drift of the zero, N/min. The seed determines the actual drift."""
    turns: bool = False
    """Whether the offset is constant along the axes of the flange; if not, it is constant along the axes of the
    base.
    """
    warm_up: Slow = Slow()
    """Largest change of the offset of each axis after power-up, N. The seed determines the actual change."""
    creep: Slow = Slow()
    """Share of the contact force that builds up and decays slowly."""


class OwnForce:
    """Force on the tool as the robot itself estimates it.

    Its moments are pure noise, and without a source the force is zero.
    """

    def __init__(self, errors: Errors, seed: int) -> None:
        rng = random.Random(f"{seed} own force")
        x, y, z = (rng.uniform(-errors.offset_n, errors.offset_n) for _ in _AXES)
        self._offset: Vector = (x, y, z)
        x, y, z = (rng.uniform(-errors.slope_n_min, errors.slope_n_min) / 60.0 for _ in _AXES)
        self._slope: Vector = (x, y, z)
        """Steady drift of the zero, N/s."""
        x, y, z = (rng.uniform(-errors.warm_up.size, errors.warm_up.size) for _ in _AXES)
        self._to_warm: Vector = (x, y, z)
        """Remaining change of the offset, N."""
        self._crept: Vector = (0.0, 0.0, 0.0)
        """Output of the creep filter for the contact force, N."""
        self._errors = errors
        self._noise, self._walk = NoiseRows(seed, "own force"), NoiseRows(seed, "its zero")
        self._reports = self._samples = 0
        """Number of noisy reports, and number of samples of the contact force."""
        self._contact: ContactSource | None = None
        self._filtered: Vector = (0.0, 0.0, 0.0)
        """Contact force after the filter, N."""
        self._sampled_at = -math.inf
        self._stuck: Vector | None = None
        self.level: Wrench = NO_WRENCH
        """Last reported wrench, excluding its noise, N and N·m."""
        self._own = own = OwnFaults()
        self.handlers: Mapping[str, Handler] = {
            **own.held(name for name in WITNESS_FAULTS if name != "stuck"),
            **own.ended_by("stuck", self._release),
        }

    def feel(self, contact: ContactSource) -> None:
        """Set the source of the contact force."""
        self._contact = contact

    def at(self, now: float, moving: bool = False, flange: Quaternion | None = None) -> Wrench:
        """Return the reported wrench at `now`, s, which must not decrease.

        `flange` is the orientation of the flange.
        """
        if now - self._sampled_at >= EVERY_S - _PASSED_S:
            self._sample(now)
        offset = rotate(flange, self._offset) if flange and self._errors.turns else self._offset
        if self._own.any:
            force, is_noisy = self._faulty_force(now, offset)
        else:
            force, is_noisy = _sum(self._filtered, offset), True
            if share := self._errors.creep.size:
                x, y, z = self._crept
                force = _sum(force, (share * x, share * y, share * z))
        x, y, z = force
        self.level = x, y, z, 0.0, 0.0, 0.0
        return self._noisy(self._errors.moving if moving else self._errors.noise) if is_noisy else self.level

    def _noisy(self, rms: Wrench) -> Wrench:
        if rms == NO_WRENCH:
            return self.level
        row = self._noise.row(self._reports)
        self._reports += 1
        a, b, c, d, e, f = [part + size * n for part, size, n in zip(self.level, rms, row, strict=True)]
        return a, b, c, d, e, f

    def _sample(self, now: float) -> None:
        """Sample the contact force, filter it, and update the offset."""
        passed, self._sampled_at = now - self._sampled_at, now
        errors = self._errors
        since = 0.0 if math.isinf(passed) else passed
        if errors.walk_n or errors.slope_n_min:
            self._drift(since)
        if errors.warm_up.size:
            share = errors.warm_up.share(since)
            x, y, z = self._to_warm
            self._offset = _sum(self._offset, (share * x, share * y, share * z))
            self._to_warm = (1.0 - share) * x, (1.0 - share) * y, (1.0 - share) * z
        if self._contact is None:
            return
        share = 1.0 if not errors.lag_s else 1.0 - math.exp(-passed / errors.lag_s)
        contact = self._contact(now - _PASSED_S)
        x, y, z = (f + share * (t - f) for f, t in zip(self._filtered, contact, strict=True))
        self._filtered = x, y, z
        if errors.creep.size:
            share = errors.creep.share(since)
            x, y, z = (c + share * (t - c) for c, t in zip(self._crept, contact, strict=True))
            self._crept = x, y, z

    def _drift(self, passed: float) -> None:
        step = self._errors.walk_n * math.sqrt(passed / _WALK_S)
        row = self._walk.row(self._samples)
        self._samples += 1
        zero = zip(self._offset, self._slope, row[:3], strict=True)
        x, y, z = (offset + slope * passed + step * normal for offset, slope, normal in zero)
        self._offset = x, y, z

    def _faulty_force(self, now: float, offset: Vector) -> tuple[Vector, bool]:
        """Return the force changed by the active faults, and whether it has noise."""
        holds, contact = self._own.under_way, self._filtered
        if holds("nan", now):
            return (math.nan, math.nan, math.nan), False
        if holds("stuck", now):
            self._stuck = self._stuck or _sum(contact, offset)
            return self._stuck, False
        share = 0.0 if holds("dead", now) else 1.0
        if scale := holds("scale", now):
            share *= scale.number("factor")
        if off := holds("offset", now):
            offset = _sum(offset, (off.number("x_n"), off.number("y_n"), off.number("z_n")))
        x, y, z = contact
        return _sum((share * x, share * y, share * z), offset), True

    def _release(self, now: float) -> None:
        self._stuck = None


def _sum(one: Vector, other: Vector) -> Vector:
    (a, b, c), (x, y, z) = one, other
    return a + x, b + y, c + z
