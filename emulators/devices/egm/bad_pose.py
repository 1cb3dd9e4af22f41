"""The measured pose of a robot as faults let it be told; the arm itself is where it is."""

import math
from collections.abc import Mapping

from emulators.devices.egm.faults import POSE_FAULTS
from emulators.faults.ledger import Handler, Injection
from protocol.devices.egm import Place, PoseMm


class BadPose:
    """A filter between what is measured and what is told; without a fault it tells all as it is."""

    def __init__(self) -> None:
        self._faults: list[Injection] = []
        self._shown: PoseMm | None = None
        """Pose that a frozen measurement goes on telling."""
        self.handlers: Mapping[str, Handler] = dict.fromkeys(POSE_FAULTS, Handler(self._begin))

    def told(self, place: Place, now: float) -> Place:
        """The measured place as it is told."""
        for injection in self._faults:
            if place.pose is None or not injection.holds(now):
                continue
            place = place._replace(pose=self._altered(place.pose, injection))
            injection.struck += 1
            if "count" in injection.values and injection.struck >= injection.number("count"):
                injection.finish(now)
        return place

    def _begin(self, injection: Injection) -> None:
        self._shown = None
        self._faults.append(injection)

    def _altered(self, pose: PoseMm, injection: Injection) -> PoseMm | None:
        match injection.fault:
            case "nan":
                return PoseMm((math.nan, math.nan, math.nan), pose.quaternion)
            case "missing":
                return None
            case "offset":
                x, y, z = (
                    p + injection.number(f"{axis}_mm")
                    for p, axis in zip(pose.position_mm, "xyz", strict=True)
                )
                return PoseMm((x, y, z), pose.quaternion)
            case _:  # frozen
                self._shown = self._shown or pose
                return self._shown
