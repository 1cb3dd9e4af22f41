"""Additions of injected faults to the bound of the true force, N, with their reasons, as one table.

The guard observes the cell through one sensor and one robot. A fault that falsifies their reports, or that moves
the surface, raises the true force beyond the bound. The amount follows from the fault, the settings of the run and
the surface. The end of a run and its last line are judged regardless of the injected faults.
"""

import math
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import numpy as np

from hil_bridge.control.course.intent import BEFORE_TOUCH
from hil_bridge.control.geometry.frames import STANDARD_GRAVITY, rotation_matrix
from hil_bridge.lab.invariants.evidence import Floats, Promise
from hil_bridge.settings.configuration import Config
from hil_bridge.settings.faults import FaultConfig
from protocol.geometry import Vector

BEFORE = ("", *BEFORE_TOUCH)
"""Phases before any motion. A fault without a phase begins in the first phase."""
FORCE_AXES = ("fx", "fy", "fz")
FRAME_S = 0.1
"""Longest time for which frames that are corrupted one by one hide the force, s. Chosen."""


class World(NamedTuple):
    """Data that determine the addition by a fault, except the fault itself."""

    config: Config
    stiffness_n_m: float
    """Stiffness of the hardest object that the tool may touch, N/m."""
    speed_m_s: float
    """Speed of the fastest ordered motion into this object, m/s."""
    reaction_s: float
    """Reaction time that the bound uses, s."""
    lasted_s: float
    """Duration of the run, s, which is also the duration of a fault without an end."""
    direction: Vector
    """Unit vector along which the tool presses, base frame."""

    def reported_share(self, changed: Callable[[Floats], Floats]) -> float:
        """Return the share of a force along the direction that is reported, if the sensor changes forces as
        `changed` does.
        """
        along = rotation_matrix(self.config.cell.start_quaternion).T @ np.array(self.direction)
        return float(along @ changed(along))

    def hidden_n(self, share: float) -> float:
        """Return the true force in excess of the limit while the sensor reports this share of the force, N."""
        limit_n = max(self.config.limits.force_limit_n, self.config.limits.resultant_limit_n)
        return self.blind_m * self.stiffness_n_m if share <= 0.0 else limit_n * max(1.0 / share - 1.0, 0.0)

    @property
    def weight_n(self) -> tuple[float, ...]:
        """Magnitude of the tool's weight on each sensor axis, N."""
        down = rotation_matrix(self.config.cell.start_quaternion).T @ np.array((0.0, 0.0, STANDARD_GRAVITY))
        return tuple(abs(self.config.cell.tool.mass_kg * down).tolist())

    @property
    def blind_m(self) -> float:
        """Distance into the surface that the tool moves without a response of the force, m."""
        return self.config.task.approach_depth_limit_mm * 1e-3

    def lasts_s(self, fault: FaultConfig) -> float:
        """Return the longest possible duration of a fault in this run, s."""
        return self.lasted_s if fault.for_s is None else min(fault.for_s, self.lasted_s)


Adds = Callable[[FaultConfig, World], float]


class Void(NamedTuple):
    """Faults with the same addition to the bound: a tool displacement that the guard cannot observe, or a force in
    N.
    """

    on: str
    faults: frozenset[str]
    """Names of the faults at the target; empty for all faults that no earlier row names."""
    why: str
    metres: Adds | None = None
    newtons: Adds | None = None
    missed: Adds | None = None
    """Addition by a fault that is present before any motion, N: the part that the check before the run may fail to
    detect.
    """
    voids: frozenset[Promise] = frozenset()
    """Promises about orders that the fault voids entirely, because it falsifies the depth to which they refer."""

    def covers(self, fault: FaultConfig) -> bool:
        """Return whether this row applies to the fault."""
        return fault.on == self.on and (not self.faults or fault.fault in self.faults)

    def added_n(self, fault: FaultConfig, world: World) -> float:
        """Return the addition by a fault to the bound, N."""
        checked = fault.phase in BEFORE and not fault.after_s and not fault.when and fault.for_s is None
        if checked and self.missed is not None:
            return self.missed(fault, world)
        metres = 0.0 if self.metres is None else self.metres(fault, world)
        pressed = metres * world.stiffness_n_m if metres else 0.0
        return pressed + (0.0 if self.newtons is None else self.newtons(fault, world))


def _value(fault: FaultConfig, name: str, default: float) -> float:
    return float(fault.parameters.get(name, default))


def _length(fault: FaultConfig, *names: str) -> float:
    return math.hypot(*(_value(fault, name, 0.0) for name in names))


def _axis(fault: FaultConfig, factor: float) -> Callable[[Floats], Floats]:
    """Return the error of a sensor that multiplies one axis of the force by this factor."""
    axis = str(fault.parameters.get("axis", "fz"))
    factors = [factor if axis in (name, "all") else 1.0 for name in FORCE_AXES]
    return lambda force: force * factors


def _swapped(fault: FaultConfig) -> Callable[[Floats], Floats]:
    one, other = (str(fault.parameters.get(name, usual)) for name, usual in (("axis", "fz"), ("other", "fx")))
    order = list(range(3))
    if one in FORCE_AXES and other in FORCE_AXES:
        i, j = FORCE_AXES.index(one), FORCE_AXES.index(other)
        order[i], order[j] = order[j], order[i]
        return lambda force: force[order]
    lost = one if one in FORCE_AXES else other
    return lambda force: force * [0.0 if name == lost else 1.0 for name in FORCE_AXES]


def _turned(fault: FaultConfig) -> Callable[[Floats], Floats]:
    angle = math.radians(_value(fault, "degrees", 90.0))
    c, s = math.cos(angle), math.sin(angle)
    return lambda force: np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ force


def _force_part(fault: FaultConfig, amount: float) -> float:
    """Return an amount on the axis of a fault as a force, N; 0 for a moment axis."""
    axis = fault.parameters.get("axis", "fz")
    return abs(amount) * (math.sqrt(3.0) if axis == "all" else 1.0) if axis in (*FORCE_AXES, "all") else 0.0


def _hides(changed: Callable[[FaultConfig], Callable[[Floats], Floats]]) -> Adds:
    """Return a function that computes the force that a sensor hides by this error."""
    return lambda fault, world: world.hidden_n(world.reported_share(changed(fault)))


def _scaled(fault: FaultConfig) -> Callable[[Floats], Floats]:
    return _axis(fault, _value(fault, "factor", 0.1))


def _wrong_scales(fault: FaultConfig, world: World) -> float:
    return world.hidden_n(_value(fault, "factor", 0.5)) if fault.parameters.get("of") != "moments" else 0.0


def _missed_scale(adds: Adds) -> Adds:
    """Return a function that computes `adds` for a scale factor that the check before the run may fail to detect.

    The check fails to detect a factor that changes each axis of the tool's weight by less than the tolerance.
    """

    def added(fault: FaultConfig, world: World) -> float:
        axis = fault.parameters.get("axis", "fz" if fault.on == "signal" else "all")
        weights = [
            part for name, part in zip(FORCE_AXES, world.weight_n, strict=True) if axis in (name, "all")
        ]
        off_n = abs(1.0 - _value(fault, "factor", 0.1 if fault.on == "signal" else 0.5)) * max(
            weights, default=0.0
        )
        return adds(fault, world) if 0.0 < off_n <= world.config.limits.weight_tolerance_n else 0.0

    return added


def _offset(fault: FaultConfig, world: World) -> float:
    return _force_part(fault, _value(fault, "amount", 20.0))


def _missed_offset(fault: FaultConfig, world: World) -> float:
    return min(_offset(fault, world), world.config.limits.weight_tolerance_n)


def _nothing(fault: FaultConfig, world: World) -> float:
    return 0.0


def _late_s(fault: FaultConfig, world: World) -> float:
    """Return the largest delay of forces before the guard ends the run, s.

    A delay that exists from the first frame on cannot be detected.
    """
    late_s = _value(fault, "ms", 100.0) * 1e-3
    return late_s if fault.phase in BEFORE else min(late_s, world.config.limits.stale_after_ms * 1e-3)


def _rises(fault: FaultConfig, world: World) -> float:
    """Return the effective rise of a surface, m.

    It is the rise until the tool retracts as fast as the surface, or the complete rise if the surface is faster.
    """
    speed = _value(fault, "mm_s", 2.0) * 1e-3
    lasts_s = min(1.0 if fault.for_s is None else fault.for_s, world.lasted_s)
    followed = speed <= world.speed_m_s
    return max(speed, 0.0) * (min(world.reaction_s, lasts_s) if followed else lasts_s)


def _harder(fault: FaultConfig, world: World) -> float:
    limit_n = world.config.limits.force_limit_n
    bound_n = limit_n + world.stiffness_n_m * world.speed_m_s * world.reaction_s
    return max(_value(fault, "factor", 10.0) - 1.0, 0.0) * bound_n


def _behind(fault: FaultConfig, world: World) -> float:
    limits = world.config.limits
    distance = limits.escape_mm_s * 1e-3 * world.reaction_s + limits.blind_retract_mm * 1e-3
    return _value(fault, "stiffness_n_m", 50e3) * distance


def _weight_n(fault: FaultConfig, world: World) -> float:
    """Return the part of the tool's weight that a false orientation moves to another axis, N."""
    tilt = min(abs(_value(fault, "degrees", 30.0)), world.config.limits.tilt_deg)
    return world.config.cell.tool.mass_kg * STANDARD_GRAVITY * math.radians(tilt)


def _stale(fault: FaultConfig, world: World) -> float:
    return world.speed_m_s * world.config.limits.stale_after_ms * 1e-3


def _stuck(fault: FaultConfig, world: World) -> float:
    limits = world.config.limits
    return max(limits.unchanged_mm, limits.unanswered_mm) * 1e-3 + _stale(fault, world)


def _followed(fault: FaultConfig, world: World) -> float:
    return world.config.limits.following_error_mm * 1e-3


def _unreported_travel(fault: FaultConfig, world: World) -> float:
    """Return the displacement of the tool while the reported position remains constant, m."""
    return world.config.limits.correction_total_mm * 1e-3


def _accepted_error(displacement: Adds) -> Adds:
    """Return a function that computes a position error, m, limited to the error that the guard accepts."""
    return lambda fault, world: min(displacement(fault, world), _followed(fault, world))


def _drift_error(fault: FaultConfig, world: World) -> float:
    return _length(fault, "x_mm_s", "y_mm_s", "z_mm_s") * 1e-3 * world.lasts_s(fault)


def _off(fault: FaultConfig, world: World) -> float:
    return _length(fault, "x_mm", "y_mm", "z_mm") * 1e-3


def _any_order(fault: FaultConfig, world: World) -> float:
    return world.config.robot.velocity_mm_s * 1e-3 * world.reaction_s


def _path_error(fault: FaultConfig, world: World) -> float:
    return world.config.limits.path_error_mm * 1e-3 + world.speed_m_s * world.reaction_s


_FORCE, _PLACE = "the sensor reports a false force", "the robot reports a false position"
_MOVES = "the surface or an obstacle moves, even if the tool is stationary"
_LATE = "forces or orders are delayed, which the link does not reveal"
_ORDERS = frozenset({Promise.ORDERS, Promise.SPEED})


def _row(on: str, faults: str, why: str, **how: Any) -> Void:
    return Void(on, frozenset(faults.split()), why, **how)


VOIDS: tuple[Void, ...] = (
    _row("signal", "dead", _FORCE, newtons=_hides(lambda fault: _axis(fault, 0.0)), missed=_nothing),
    _row("signal", "scale", _FORCE, newtons=_hides(_scaled), missed=_missed_scale(_hides(_scaled))),
    _row("signal", "sign", _FORCE, newtons=_hides(lambda fault: _axis(fault, -1.0)), missed=_nothing),
    _row("signal", "swapped", _FORCE, newtons=_hides(_swapped), missed=_nothing),
    _row("signal", "turned", _FORCE, newtons=_hides(_turned), missed=_nothing),
    _row("sensor", "wrong-scales", _FORCE, newtons=_wrong_scales, missed=_missed_scale(_wrong_scales)),
    _row("signal", "offset", _FORCE, newtons=_offset, missed=_missed_offset),
    _row(
        "signal",
        "drift",
        "a drifting force is reported too low, by its rate times its duration",
        newtons=lambda fault, world: _force_part(fault, _value(fault, "per_s", 1.0)) * world.lasts_s(fault),
    ),
    _row(
        "signal",
        "spike",
        _FORCE,
        metres=lambda fault, world: (
            world.speed_m_s * (0.005 if fault.for_s is None else world.lasts_s(fault))
        ),
    ),
    _row(
        "signal",
        "intermittent",
        _FORCE,
        metres=lambda fault, world: min(
            world.speed_m_s * _value(fault, "period_s", 0.5) * (1.0 - _value(fault, "duty", 0.5)),
            world.blind_m,
        ),
    ),
    _row("signal", "stuck", "constant counts end a run only after some distance", metres=_stuck),
    _row(
        "signal",
        "replayed",
        "a replayed force does not respond, so the tool moves up to the depth limits",
        metres=lambda fault, world: world.config.limits.correction_total_mm * 1e-3,
    ),
    _row(
        "sensor",
        "biased",
        "another program zeroes the sensor under load, possibly at the force limit",
        newtons=lambda fault, world: world.config.limits.force_limit_n,
    ),
    _row("sensor", "unplugged", _FORCE, metres=lambda fault, world: world.blind_m),
    _row("sensor", "slow frozen-counter", _LATE, metres=_stale),
    _row("sensor-wire", "late", _LATE, metres=lambda fault, world: world.speed_m_s * _late_s(fault, world)),
    _row("sensor-wire", "reordered", _LATE, metres=lambda fault, world: world.speed_m_s * FRAME_S),
    _row(
        "sensor-wire",
        "corrupted garbled",
        "a corrupted frame that passes its check may report any force",
        metres=_stale,
    ),
    _row("bus", "babble errors", "frames wait on the bus", metres=_stale),
    _row("pose", "encoder-offset", "the arm moves by the offset", metres=_off, voids=_ORDERS),
    _row("pose", "offset", _PLACE, metres=_accepted_error(_off), voids=_ORDERS),
    _row("pose", "drift", _PLACE, metres=_accepted_error(_drift_error), voids=_ORDERS),
    _row(
        "pose",
        "late",
        _PLACE,
        metres=_accepted_error(lambda fault, world: world.speed_m_s * _value(fault, "ms", 200.0) * 1e-3),
        voids=_ORDERS,
    ),
    _row(
        "pose",
        "mirrored frozen",
        _PLACE,
        metres=_followed,
        voids=_ORDERS,
    ),
    _row(
        "pose",
        "turned",
        "the tool's weight is subtracted along another axis",
        newtons=_weight_n,
        voids=_ORDERS,
    ),
    _row("pose", "", _PLACE, voids=_ORDERS),
    _row(
        "wire",
        "late",
        _LATE,
        metres=lambda fault, world: world.speed_m_s * _value(fault, "ms", 100.0) * 1e-3,
        voids=_ORDERS,
    ),
    _row(
        "wire",
        "twice reordered",
        "an order is executed twice, or an old one again",
        metres=_path_error,
        voids=_ORDERS,
    ),
    _row(
        "wire",
        "corrupted garbled babble",
        "a corrupted order that passes its check may lead anywhere, at the robot's own speed",
        metres=_any_order,
        voids=_ORDERS,
    ),
    _row(
        "robot",
        "spontaneous limit slider",
        "the robot does not execute the order that it accepted",
        metres=_path_error,
        voids=_ORDERS,
    ),
    _row("robot", "clock-jump", _LATE, metres=_path_error, voids=_ORDERS),
    _row(
        "surface",
        "step",
        _MOVES,
        metres=lambda fault, world: abs(_value(fault, "mm", 1.0)) * 1e-3,
    ),
    _row("surface", "hole", _MOVES, metres=lambda fault, world: _value(fault, "depth_mm", 20.0) * 1e-3),
    _row("surface", "rises", _MOVES, metres=_rises),
    _row("surface", "swings", _MOVES, metres=lambda fault, world: 2.0 * _value(fault, "mm", 1.0) * 1e-3),
    _row("surface", "hard", "the surface under the tool becomes harder", newtons=_harder),
    _row("obstacle", "", "the tool retracts into the obstacle", newtons=_behind),
    _row(
        "computer",
        "pause",
        "the computer makes no decisions during that time",
        metres=lambda fault, world: world.speed_m_s * _value(fault, "seconds", 0.5),
    ),
)
"""All faults that add to the bound. Any fault that is not in this table adds nothing."""


def rows_of(fault: FaultConfig) -> tuple[Void, ...]:
    """Return the row that applies to a fault, as a tuple; empty if the fault adds nothing."""
    return tuple(row for row in VOIDS if row.covers(fault))[:1]


def moves_surface(fault: FaultConfig) -> bool:
    """Return whether a fault moves the surface. A fault that is not in the table may do so."""
    return fault.on == "surface" and all(row.why == _MOVES for row in rows_of(fault))


def added_n(faults: Iterable[FaultConfig], world: World) -> float:
    """Return the sum of the additions by these faults to the bound, N."""
    return sum(row.added_n(fault, world) for fault in faults for row in rows_of(fault))


def position_error_m(faults: Iterable[FaultConfig], world: World) -> float:
    """Return the largest error of the reported position that these faults cause, m."""
    errors: dict[str, Adds] = {
        "encoder-offset": _off,
        "offset": _off,
        "drift": _drift_error,
        "frozen": _unreported_travel,
        "mirrored": lambda fault, world: 2.0 * _unreported_travel(fault, world),
    }
    return sum(errors.get(fault.fault, _followed)(fault, world) for fault in faults if fault.on == "pose")


def void_reasons(promise: Promise, faults: Iterable[FaultConfig]) -> tuple[str, ...]:
    """Return the reasons why a promise is void in a run with these faults; empty if the promise applies."""
    reasons = (row.why for fault in faults for row in rows_of(fault) if promise in row.voids)
    return tuple(dict.fromkeys(reasons))
