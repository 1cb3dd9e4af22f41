"""The pose of its tool that a robot tells, as faults let it be told; the arm itself is where it is."""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

from emulators.faults.kinds import FOREVER, Fault, Parameter
from emulators.faults.ledger import Handler, Injection
from protocol.geometry import Pose, Vector, product

_AXES = ("x", "y", "z")
_AXIS = Parameter("x", "axis of the base frame", choices=_AXES)
_COUNT = Parameter(0, "it is over after so many; 0 for any number", 0, 100_000)
_NO_NUMBER = (math.nan, math.nan, math.nan)


def along_axes(limit: float, unit: str, meaning: str = "by how much") -> Mapping[str, Parameter]:
    """Parameters for the three axes of the base frame."""
    key = unit.replace("/", "_")
    return {
        f"{axis}_{key}": Parameter(0.0, f"{meaning} along base {axis}", -limit, limit, unit) for axis in _AXES
    }


_OFFSET, _SPEED = along_axes(2000.0, "mm"), along_axes(100.0, "mm/s", "how fast")

POSE_FAULTS: Mapping[str, Fault] = {
    "offset": Fault(
        "the told position is off; the arm stays where it is", _OFFSET, FOREVER, amounts=tuple(_OFFSET)
    ),
    "drift": Fault(
        "the told position goes astray; the arm stays where it is", _SPEED, FOREVER, amounts=tuple(_SPEED)
    ),
    "turned": Fault(
        "the told orientation is turned about an axis of the base frame",
        {"degrees": Parameter(30.0, "by how much", -180.0, 180.0, "°"), "axis": _AXIS},
        FOREVER,
    ),
    "mirrored": Fault(
        "the told position goes the other way, from where it is now",
        {"axis": Parameter("z", "axis of the base frame", choices=_AXES)},
        FOREVER,
    ),
    "late": Fault(
        "the told pose is an old one", {"ms": Parameter(200.0, "how old", 0.0, 5000.0, "ms")}, FOREVER
    ),
    "frozen": Fault("the told pose stays as it is", {}, FOREVER),
    "nan": Fault("the told position is not a number", {"count": _COUNT}, FOREVER),
    "missing": Fault("the pose is not told", {"count": _COUNT}, FOREVER),
}
"""Faults of the target `pose`."""


def pose_faults(without: Iterable[str] = ()) -> Mapping[str, Fault]:
    """Those of a robot that cannot tell some of them."""
    return {name: fault for name, fault in POSE_FAULTS.items() if name not in without}


@dataclass(slots=True, eq=False)
class _Wrong:
    """A fault under way."""

    injection: Injection
    begin: Pose | None
    """The pose at its begin; None until one is told."""


class ReportedPose:
    """A filter between the pose that is measured and the one that is told."""

    def __init__(
        self,
        measured: Callable[[float], Pose],
        faults: Mapping[str, Fault] = POSE_FAULTS,
        in_cycles: bool = True,
    ) -> None:
        """`measured` is the pose at a time that has passed, s. A robot that does not measure `in_cycles` knows its pose
        at any time; of another the first pose behind the begin of a fault is that at its begin.
        """
        self._measured, self._in_cycles = measured, in_cycles
        self._wrong: list[_Wrong] = []
        self.handlers: Mapping[str, Handler] = dict.fromkeys(faults, Handler(self._begin))
        """Handlers for a ledger."""

    @property
    def wrong(self) -> bool:
        """Whether a fault may be under way."""
        return bool(self._wrong)

    def told(self, pose: Pose, now: float) -> Pose | None:
        """Return the measured pose of `now`, s, as it is reported; None if it is not."""
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
        self._wrong.append(_Wrong(injection, begin))

    def _altered(self, pose: Pose, begin: Pose, injection: Injection, now: float) -> Pose | None:
        match injection.fault:
            case "offset":
                return _moved(pose, _along(injection, "mm", 1.0))
            case "drift":
                return _moved(pose, _along(injection, "mm_s", now - injection.injected_at))
            case "turned":
                return _turned(pose, math.radians(injection.number("degrees")), injection.values["axis"])
            case "mirrored":
                return _mirrored(pose, begin, injection.values["axis"])
            case "late":
                return self._measured(now - injection.number("ms") * 1e-3)
            case "frozen":
                return begin
            case "nan":
                return pose._replace(position=_NO_NUMBER)
            case _:  # missing
                return None


def _along(injection: Injection, unit: str, times: float) -> Vector:
    """So many millimetres along the axes, m."""
    x, y, z = (injection.number(f"{axis}_{unit}") * times / 1000.0 for axis in _AXES)
    return x, y, z


def _moved(pose: Pose, by: Vector) -> Pose:
    x, y, z = (place + more for place, more in zip(pose.position, by, strict=True))
    return pose._replace(position=(x, y, z))


def _mirrored(pose: Pose, begin: Pose, axis: object) -> Pose:
    x, y, z = (
        place + (2.0 * (mirror - place) if name == axis else 0.0)
        for name, place, mirror in zip(_AXES, pose.position, begin.position, strict=True)
    )
    return pose._replace(position=(x, y, z))


def _turned(pose: Pose, angle: float, axis: object) -> Pose:
    sine = math.sin(angle / 2.0)
    x, y, z = (sine * (name == axis) for name in _AXES)
    return pose._replace(quaternion=product((math.cos(angle / 2.0), x, y, z), pose.quaternion))
