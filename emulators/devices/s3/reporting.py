"""The status while encoders or the status itself are wrong; the arm goes on as ever."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from emulators.arm.waypoints import WaypointArm
from emulators.faults.ledger import Handler, Injection
from protocol.devices.s3.arap import Status, position_words, quaternion_words
from protocol.geometry import Quaternion, Vector, product

_AXES = "xyz"
_LIMIT = 4.095875
"""Largest coordinate that a status can tell, m. Mark: observed."""


@dataclass(frozen=True, slots=True)
class _Report:
    """Place and mode that are told."""

    position: Vector
    quaternion: Quaternion
    standby: bool


@dataclass(slots=True)
class _Wrong:
    """A fault under way."""

    injection: Injection
    began: _Report
    """The report at its begin."""


class Reporting:
    """Falsifies the told pose and mode of a controller."""

    def __init__(self, motion: WaypointArm) -> None:
        self._motion = motion
        self._wrong: list[_Wrong] = []
        self.handlers: Mapping[str, Handler] = {name: Handler(self._begin) for name in _FALSIFY}
        """Handlers for a ledger."""

    @property
    def wrong(self) -> bool:
        """Whether there is anything that might falsify."""
        return bool(self._wrong)

    def falsified(self, status: Status, now: float) -> Status:
        """The status that is told instead of a true one."""
        told = before = self._true(now, status.standby)
        self._wrong = [wrong for wrong in self._wrong if wrong.injection.ended_at is None]
        for wrong in self._wrong:
            if not wrong.injection.holds(now):
                continue
            told, before = _FALSIFY[wrong.injection.fault](wrong, told, self._motion, now), told
            wrong.injection.struck += told != before
        return status._replace(
            position_words=position_words(told.position),
            quaternion_words=quaternion_words(told.quaternion),
            standby=told.standby,
            operation=status.operation and (status.standby or not told.standby),
        )

    def _true(self, now: float, standby: bool) -> _Report:
        return _Report(self._motion.reported(now), self._motion.path.orientation(now), standby)

    def _begin(self, injection: Injection) -> None:
        self._wrong.append(_Wrong(injection, self._true(injection.injected_at, False)))


def _moved(report: _Report, by: Vector) -> _Report:
    x, y, z = (max(-_LIMIT, min(_LIMIT, p + d)) for p, d in zip(report.position, by, strict=True))
    return replace(report, position=(x, y, z))


def _offset(wrong: _Wrong, report: _Report, motion: WaypointArm, now: float) -> _Report:
    x, y, z = (wrong.injection.number(f"{axis}_mm") * 1e-3 for axis in _AXES)
    return _moved(report, (x, y, z))


def _drift(wrong: _Wrong, report: _Report, motion: WaypointArm, now: float) -> _Report:
    since = now - wrong.injection.injected_at
    x, y, z = (wrong.injection.number(f"{axis}_mm_s") * 1e-3 * since for axis in _AXES)
    return _moved(report, (x, y, z))


def _frozen(wrong: _Wrong, report: _Report, motion: WaypointArm, now: float) -> _Report:
    return replace(report, position=wrong.began.position, quaternion=wrong.began.quaternion)


def _late(wrong: _Wrong, report: _Report, motion: WaypointArm, now: float) -> _Report:
    return replace(report, position=motion.reported(now - wrong.injection.number("ms") * 1e-3))


def _mirrored(wrong: _Wrong, report: _Report, motion: WaypointArm, now: float) -> _Report:
    axis = _AXES.index(str(wrong.injection.values["axis"]))
    by = [0.0, 0.0, 0.0]
    by[axis] = 2.0 * (wrong.began.position[axis] - report.position[axis])
    x, y, z = by
    return _moved(report, (x, y, z))


def _turned(wrong: _Wrong, report: _Report, motion: WaypointArm, now: float) -> _Report:
    half = math.radians(wrong.injection.number("degrees")) / 2.0
    x, y, z = (math.sin(half) * (axis == wrong.injection.values["axis"]) for axis in _AXES)
    turned = product((math.cos(half), x, y, z), report.quaternion)
    w, x, y, z = (max(-1.0, min(1.0, part)) for part in turned)
    return replace(report, quaternion=(w, x, y, z))


def _standby(wrong: _Wrong, report: _Report, motion: WaypointArm, now: float) -> _Report:
    return replace(report, standby=True)


_FALSIFY: Mapping[str, Callable[[_Wrong, _Report, WaypointArm, float], _Report]] = {
    "offset": _offset,
    "drift": _drift,
    "frozen": _frozen,
    "late": _late,
    "mirrored": _mirrored,
    "turned": _turned,
    "standby": _standby,
}
