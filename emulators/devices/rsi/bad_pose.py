"""The actual pose of a robot as faults let it be told; the arm itself is where it is."""

import math
from collections.abc import Iterable

from emulators.faults import Handler, Injection
from protocol.geometry import Pose, Vector, product, turn_about

_TURNS: dict[str, Vector] = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


class BadPose:
    """A filter between the pose that is measured and the one that is told."""

    def __init__(self, names: Iterable[str]) -> None:
        """`names` are the faults of the target `pose`."""
        self._faults: list[Injection] = []
        self._shown: Pose | None = None
        """Pose that a frozen measurement goes on telling."""
        self.handlers = dict.fromkeys(names, Handler(self._begin))

    def told(self, pose: Pose, now: float) -> Pose:
        """The measured pose as it is told at `now`, s."""
        for injection in self._faults:
            if injection.holds(now):
                injection.struck += 1
                pose = self._altered(pose, injection, now)
        return pose

    def _begin(self, injection: Injection) -> None:
        self._shown = None
        self._faults.append(injection)

    def _altered(self, pose: Pose, injection: Injection, now: float) -> Pose:
        match injection.fault:
            case "offset":
                return _moved(pose, injection, "mm", 1.0)
            case "drift":
                return _moved(pose, injection, "mm_s", now - injection.injected_at)
            case "turned":
                turn = turn_about(
                    _TURNS[str(injection.values["axis"])], math.radians(injection.number("degrees"))
                )
                return Pose(pose.position, product(turn, pose.quaternion))
            case _:  # frozen
                self._shown = self._shown or pose
                return self._shown


def _moved(pose: Pose, injection: Injection, unit: str, times: float) -> Pose:
    x, y, z = (
        place + injection.number(f"{axis}_{unit}") * times * 1e-3
        for axis, place in zip("xyz", pose.position, strict=True)
    )
    return Pose((x, y, z), pose.quaternion)
