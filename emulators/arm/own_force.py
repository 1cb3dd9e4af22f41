"""A robot's own idea of the force on its tool: late, noisy, with an offset, and wrong by faults of its own.

It is no force sensor at the wrist. A robot works it out of currents, torques or a coarse sensor of its own, so that it
serves as a witness beside one. All forces are those of the surroundings on the tool, base frame, N. Moments are noise.
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
"""Chosen: time between two looks at the contact. Real estimates change with some tens of hertz; looks cost time."""
_PASSED_S = 1e-6
"""Chosen: how long ago the moment of a look is, so that the path up to it is settled."""
_AXES = "xyz"
_WALK_S = 10.0
"""The time for which `Errors.walk_n` holds."""
NO_WRENCH: Wrench = (0.0,) * 6

WITNESS_FAULTS: Mapping[str, Fault] = {
    "dead": Fault("the robot's own force stays at its offset, whatever the tool touches", {}, FOREVER),
    "stuck": Fault("the robot's own force stays as it is", {}, FOREVER),
    "offset": Fault(
        "the robot's own force is off",
        {
            f"{axis}_n": Parameter(0.0, f"by how much along base {axis}", -1000.0, 1000.0, "N")
            for axis in _AXES
        },
        FOREVER,
        amounts=tuple(f"{axis}_n" for axis in _AXES),
    ),
    "scale": Fault(
        "the robot's own force tells so much of the contact",
        {"factor": Parameter(0.1, "share of the contact", -10.0, 10.0)},
        FOREVER,
    ),
    "nan": Fault("the robot's own force is not a number", {}, FOREVER),
}
"""Faults of the target `witness`."""


class Slow(NamedTuple):
    """A change that comes by a time constant."""

    size: float = 0.0
    seconds: float = 1.0

    def share(self, passed: float) -> float:
        """Of what is left of the change, after a time, s."""
        return 1.0 - math.exp(-passed / self.seconds)


class Errors(NamedTuple):
    """How wrong a healthy one is."""

    offset_n: float
    """Largest offset of each axis, N; the seed draws it."""
    lag_s: float
    """Time constant of its filter, s."""
    noise: Wrench = NO_WRENCH
    """White noise of each axis while the arm stands, root mean square, N and N·m."""
    moving: Wrench = NO_WRENCH
    """The same while it moves."""
    walk_n: float = 0.0
    """How far the zero of each axis walks at random in 10 s, root mean square, N."""
    slope_n_min: float = 0.0
    """Largest steady slope of that zero, N/min; the seed draws it."""
    turns: bool = False
    """The offset stands still along the flange's axes, and not along those of the base."""
    warm_up: Slow = Slow()
    """Largest change of each axis of the offset since the power came, N; the seed draws it."""
    creep: Slow = Slow()
    """Share of the contact that comes and goes slowly."""


class OwnForce:
    """The force that a robot feels on its tool, with moments of noise alone. Without a source nothing touches it."""

    def __init__(self, errors: Errors, seed: int) -> None:
        rng = random.Random(f"{seed} own force")
        x, y, z = (rng.uniform(-errors.offset_n, errors.offset_n) for _ in _AXES)
        self._offset: Vector = (x, y, z)
        x, y, z = (rng.uniform(-errors.slope_n_min, errors.slope_n_min) / 60.0 for _ in _AXES)
        self._slope: Vector = (x, y, z)
        """N/s"""
        x, y, z = (rng.uniform(-errors.warm_up.size, errors.warm_up.size) for _ in _AXES)
        self._to_warm: Vector = (x, y, z)
        """What the offset is still to change by, N."""
        self._crept: Vector = (0.0, 0.0, 0.0)
        """The contact as it is slowly taken, N."""
        self._errors = errors
        self._noise, self._walk = NoiseRows(seed, "own force"), NoiseRows(seed, "its zero")
        self._told = self._looks = 0
        """How often it was told, and how often it has looked at the contact."""
        self._contact: ContactSource | None = None
        self._felt: Vector = (0.0, 0.0, 0.0)
        """The contact behind the filter."""
        self._looked_at = -math.inf
        self._stuck: Vector | None = None
        self.level: Wrench = NO_WRENCH
        """What was told last, without its noise."""
        self._own = own = OwnFaults()
        self.handlers: Mapping[str, Handler] = {
            **own.held(name for name in WITNESS_FAULTS if name != "stuck"),
            **own.ended_by("stuck", self._loosen),
        }

    def feel(self, contact: ContactSource) -> None:
        """Set the source of the force."""
        self._contact = contact

    def at(self, now: float, moving: bool = False, flange: Quaternion | None = None) -> Wrench:
        """Return the reported force at `now`, s, which does not run backwards; `flange` is its orientation."""
        if now - self._looked_at >= EVERY_S - _PASSED_S:
            self._look(now)
        offset = rotate(flange, self._offset) if flange and self._errors.turns else self._offset
        if self._own.any:
            force, is_noisy = self._wrong(now, offset)
        else:
            force, is_noisy = _sum(self._felt, offset), True
            if share := self._errors.creep.size:
                x, y, z = self._crept
                force = _sum(force, (share * x, share * y, share * z))
        x, y, z = force
        self.level = x, y, z, 0.0, 0.0, 0.0
        return self._noisy(self._errors.moving if moving else self._errors.noise) if is_noisy else self.level

    def _noisy(self, rms: Wrench) -> Wrench:
        if rms == NO_WRENCH:
            return self.level
        row = self._noise.row(self._told)
        self._told += 1
        a, b, c, d, e, f = [part + size * n for part, size, n in zip(self.level, rms, row, strict=True)]
        return a, b, c, d, e, f

    def _look(self, now: float) -> None:
        """Let the contact through the filter, and the zero walk."""
        passed, self._looked_at = now - self._looked_at, now
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
        x, y, z = (f + share * (t - f) for f, t in zip(self._felt, contact, strict=True))
        self._felt = x, y, z
        if errors.creep.size:
            share = errors.creep.share(since)
            x, y, z = (c + share * (t - c) for c, t in zip(self._crept, contact, strict=True))
            self._crept = x, y, z

    def _drift(self, passed: float) -> None:
        step = self._errors.walk_n * math.sqrt(passed / _WALK_S)
        row = self._walk.row(self._looks)
        self._looks += 1
        zero = zip(self._offset, self._slope, row[:3], strict=True)
        x, y, z = (offset + slope * passed + step * normal for offset, slope, normal in zero)
        self._offset = x, y, z

    def _wrong(self, now: float, offset: Vector) -> tuple[Vector, bool]:
        """Return the force with the active faults, and whether it is noisy."""
        holds, felt = self._own.under_way, self._felt
        if holds("nan", now):
            return (math.nan, math.nan, math.nan), False
        if holds("stuck", now):
            self._stuck = self._stuck or _sum(felt, offset)
            return self._stuck, False
        share = 0.0 if holds("dead", now) else 1.0
        if scale := holds("scale", now):
            share *= scale.number("factor")
        if off := holds("offset", now):
            offset = _sum(offset, (off.number("x_n"), off.number("y_n"), off.number("z_n")))
        x, y, z = felt
        return _sum((share * x, share * y, share * z), offset), True

    def _loosen(self, now: float) -> None:
        self._stuck = None


def _sum(one: Vector, other: Vector) -> Vector:
    (a, b, c), (x, y, z) = one, other
    return a + x, b + y, c + z
