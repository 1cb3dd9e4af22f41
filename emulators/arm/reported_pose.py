"""Tool pose that a robot reports, which faults may falsify. The faults do not affect the arm itself."""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

from emulators.faults.kinds import FOREVER, Fault, Parameter
from emulators.faults.ledger import Handler, Injection
from protocol.geometry import Pose, Vector, product

_AXES = ("x", "y", "z")
_AXIS = Parameter("x", "axis of the base frame", choices=_AXES)
_COUNT = Parameter(0, "number of affected poses; 0: no limit", 0, 100_000)
_NO_NUMBER = (math.nan, math.nan, math.nan)


def along_axes(limit: float, unit: str, meaning: str = "offset") -> Mapping[str, Parameter]:
    """Return one parameter per axis of the base frame."""
    key = unit.replace("/", "_")
    return {
        f"{axis}_{key}": Parameter(0.0, f"{meaning} along base {axis}", -limit, limit, unit) for axis in _AXES
    }


_OFFSET, _SPEED = along_axes(2000.0, "mm"), along_axes(100.0, "mm/s", "speed of the drift")

POSE_FAULTS: Mapping[str, Fault] = {
    "offset": Fault(
        "the reported position has an offset; the arm does not move", _OFFSET, FOREVER, amounts=tuple(_OFFSET)
    ),
    "drift": Fault(
        "the reported position drifts; the arm does not move", _SPEED, FOREVER, amounts=tuple(_SPEED)
    ),
    "turned": Fault(
        "the reported orientation is turned about an axis of the base frame",
        {"degrees": Parameter(30.0, "angle", -180.0, 180.0, "°"), "axis": _AXIS},
        FOREVER,
    ),
    "mirrored": Fault(
        "the reported position moves in the opposite direction, from its present value",
        {"axis": Parameter("z", "axis of the base frame", choices=_AXES)},
        FOREVER,
    ),
    "late": Fault(
        "the reported pose is outdated", {"ms": Parameter(200.0, "age", 0.0, 5000.0, "ms")}, FOREVER
    ),
    "frozen": Fault("the reported pose keeps its present value", {}, FOREVER),
    "nan": Fault("the reported position is not a number", {"count": _COUNT}, FOREVER),
    "missing": Fault("the pose is not reported", {"count": _COUNT}, FOREVER),
}
"""Faults of the target `pose`."""


def pose_faults(without: Iterable[str] = ()) -> Mapping[str, Fault]:
    """Return the pose faults except those that a robot cannot have."""
    return {name: fault for name, fault in POSE_FAULTS.items() if name not in without}


@dataclass(slots=True, eq=False)
class _ActiveFault:
    """Fault that is active."""

    injection: Injection
    begin: Pose | None
    """Pose at the start of the fault; None until a pose is reported."""


class ReportedPose:
    """Filter that converts the measured pose into the reported pose."""

    def __init__(
        self,
        measured: Callable[[float], Pose],
        faults: Mapping[str, Fault] = POSE_FAULTS,
        in_cycles: bool = True,
    ) -> None:
        """`measured` is a function that returns the pose at a past time, s.

        If `in_cycles` is false, the robot knows its pose at any time, so the pose at the start of a fault is
        measured at once. Otherwise, it is the first pose that is reported after the start.
        """
        self._measured, self._in_cycles = measured, in_cycles
        self._wrong: list[_ActiveFault] = []
        self.handlers: Mapping[str, Handler] = dict.fromkeys(faults, Handler(self._begin))
        """Fault handlers for a ledger, by fault name."""

    @property
    def wrong(self) -> bool:
        """Whether a fault may be active."""
        return bool(self._wrong)

    def told(self, pose: Pose, now: float) -> Pose | None:
        """Return the pose that is reported for the measured `pose` at `now`, s; None if no pose is reported."""
        if not self._wrong:
            return pose
        self._wrong = [wrong for wrong in self._wrong if wrong.injection.ended_at is None]
        for wrong in self._wrong:
            if not wrong.injection.holds(now):
                continue
            wrong.begin = wrong.begin or pose
            after = self._altered(pose, wrong.begin, wrong.injection, now)
            if after != pose:
                wrong.injection.strike(now)
            if after is None:
                return None
            pose = after
        return pose

    def _begin(self, injection: Injection) -> None:
        begin = None if self._in_cycles else self._measured(injection.injected_at)
        self._wrong.append(_ActiveFault(injection, begin))

    def _altered(self, pose: Pose, begin: Pose, injection: Injection, now: float) -> Pose | None:
        match injection.fault:
            case "offset":
                return _shift(pose, _along(injection, "mm", 1.0))
            case "drift":
                return _shift(pose, _along(injection, "mm_s", now - injection.injected_at))
            case "turned":
                return _rotate(pose, math.radians(injection.number("degrees")), injection.values["axis"])
            case "mirrored":
                return _mirror(pose, begin, injection.values["axis"])
            case "late":
                return self._measured(now - injection.number("ms") * 1e-3)
            case "frozen":
                return begin
            case "nan":
                return pose._replace(position=_NO_NUMBER)
            case _:  # missing
                return None


def _along(injection: Injection, unit: str, times: float) -> Vector:
    """Return the fault's parameters in this unit along the three axes, multiplied by `times`, in m."""
    x, y, z = (injection.number(f"{axis}_{unit}") * times / 1000.0 for axis in _AXES)
    return x, y, z


def _shift(pose: Pose, offset: Vector) -> Pose:
    x, y, z = (coordinate + by for coordinate, by in zip(pose.position, offset, strict=True))
    return pose._replace(position=(x, y, z))


def _mirror(pose: Pose, begin: Pose, axis: object) -> Pose:
    x, y, z = (
        coordinate + (2.0 * (mirror - coordinate) if name == axis else 0.0)
        for name, coordinate, mirror in zip(_AXES, pose.position, begin.position, strict=True)
    )
    return pose._replace(position=(x, y, z))


def _rotate(pose: Pose, angle: float, axis: object) -> Pose:
    sine = math.sin(angle / 2.0)
    x, y, z = (sine * (name == axis) for name in _AXES)
    return pose._replace(quaternion=product((math.cos(angle / 2.0), x, y, z), pose.quaternion))
