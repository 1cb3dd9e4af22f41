"""A robot's own idea of the force on its tool: late, noisy, with an offset, and wrong by faults of its own.

It is no force sensor at the wrist. A robot works it out of currents, torques or a coarse sensor of its own, so that it
serves as a witness beside one. All forces are those of the surroundings on the tool, base frame, N.
"""

import math
import random
from collections.abc import Mapping
from typing import NamedTuple

from emulators.faults.kinds import FOREVER, Fault, Parameter
from emulators.faults.ledger import Handler
from emulators.faults.own import OwnFaults
from emulators.seams import ContactSource
from protocol.geometry import Vector

EVERY_S = 8e-3
"""Chosen: time between two looks at the contact. Real estimates change with some tens of hertz; looks cost time."""
_PASSED_S = 1e-6
"""Chosen: how long ago the moment of a look is, so that the path up to it is settled."""
_AXES = "xyz"

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
    "nan": Fault("the robot's own force is no number", {}, FOREVER),
}
"""Faults of the target `witness`."""


class Errors(NamedTuple):
    """How wrong a healthy one is."""

    offset_n: float
    """Largest offset of each axis, N; the seed draws it."""
    lag_s: float
    """Time constant of its filter, s."""
    noise_n: float = 0.0
    """Noise of each axis, root mean square, N."""


class OwnForce:
    """The force that a robot feels on its tool. Without a source nothing touches it."""

    def __init__(self, errors: Errors, seed: int) -> None:
        rng = random.Random(f"{seed} own force")
        x, y, z = (rng.uniform(-errors.offset_n, errors.offset_n) for _ in _AXES)
        self._offset: Vector = (x, y, z)
        self._lag, self._noise_n, self._gauss = errors.lag_s, errors.noise_n, rng.gauss
        self._contact: ContactSource | None = None
        self._felt: Vector = (0.0, 0.0, 0.0)
        """The contact behind the filter."""
        self._looked_at = -math.inf
        self._stuck: Vector | None = None
        self._own = own = OwnFaults()
        self.handlers: Mapping[str, Handler] = {
            **own.held(name for name in WITNESS_FAULTS if name != "stuck"),
            **own.ended_by("stuck", self._loosen),
        }

    def feel(self, contact: ContactSource) -> None:
        """The force comes from here."""
        self._contact = contact

    def at(self, now: float) -> Vector:
        """The force as it is told at `now`, s, which does not run backwards."""
        if self._contact is not None and now - self._looked_at >= EVERY_S - _PASSED_S:
            self._look(self._contact, now)
        if self._own.any:
            return self._wrong(now)
        return self._noisy(_sum(self._felt, self._offset))

    def _noisy(self, force: Vector) -> Vector:
        if not self._noise_n:
            return force
        x, y, z = (part + self._gauss(0.0, self._noise_n) for part in force)
        return x, y, z

    def _look(self, contact: ContactSource, now: float) -> None:
        passed, self._looked_at = now - self._looked_at, now
        share = 1.0 if not self._lag else 1.0 - math.exp(-passed / self._lag)
        x, y, z = (f + share * (t - f) for f, t in zip(self._felt, contact(now - _PASSED_S), strict=True))
        self._felt = x, y, z

    def _wrong(self, now: float) -> Vector:
        """The force with the faults that are under way."""
        holds, felt, offset = self._own.under_way, self._felt, self._offset
        if holds("nan", now):
            return math.nan, math.nan, math.nan
        if holds("stuck", now):
            self._stuck = self._stuck or _sum(felt, offset)
            return self._stuck
        share = 0.0 if holds("dead", now) else 1.0
        if scale := holds("scale", now):
            share *= scale.number("factor")
        if off := holds("offset", now):
            offset = _sum(offset, (off.number("x_n"), off.number("y_n"), off.number("z_n")))
        x, y, z = felt
        return self._noisy(_sum((share * x, share * y, share * z), offset))

    def _loosen(self, now: float) -> None:
        self._stuck = None


def _sum(one: Vector, other: Vector) -> Vector:
    (a, b, c), (x, y, z) = one, other
    return a + x, b + y, c + z
