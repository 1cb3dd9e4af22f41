"""Contents of a robot's telegram, as its client reads them."""

import math
from collections.abc import Mapping
from functools import lru_cache
from typing import NamedTuple

from protocol.devices.rsi.angles import pose_of
from protocol.devices.rsi.corrections import Correction, offset_between
from protocol.devices.rsi.elements import axis_tags, pose_tags
from protocol.devices.rsi.telegram import ROBOT, decode, number, numbers
from protocol.endpoint import RemoteProtocolError
from protocol.geometry import Pose
from protocol.kinematics import Joints

_STATUS = "ProgStatus.R"
_ACTUAL, _SET, _LATE = pose_tags("RIst"), pose_tags("RSol"), "Delay.D"
_ACTUAL_AXES, _SET_AXES = axis_tags("AIPos"), axis_tags("ASPos")
NO_POSE = Pose((math.nan,) * 3, (1.0, 0.0, 0.0, 0.0))
"""Pose of a telegram whose position is not numeric; nothing moves with it."""


class RobotTelegram(NamedTuple):
    """Contents of a telegram of the robot."""

    ipoc: int
    pose: Pose
    planned: Pose | None
    """Set position, without any correction; None if the telegram has none."""
    late: int | None
    """Answers that came late or not at all, since the program began; None if the telegram has no count."""
    status: float | None
    axes: Joints | None = None
    """Actual axes, degrees; None if they are missing or not numeric."""
    planned_axes: Joints | None = None
    """Set axes, without any correction."""
    missing: str = ""
    """Missing element that a correction of the axes needs; empty if none is missing."""

    @property
    def offset(self) -> Correction | None:
        """Actual less set position; None where one of them is not known."""
        return (
            None if self.planned is None or self.pose is NO_POSE else offset_between(self.pose, self.planned)
        )


def read_telegram(raw: bytes, needs_axes: bool) -> RobotTelegram:
    """Read a telegram of the robot; a position that is not a number is reported as invalid.

    Raises RemoteProtocolError for one without a position or a clock.
    """
    telegram = decode(raw)
    values = telegram.values
    if telegram.root != ROBOT:
        raise RemoteProtocolError(f"it is a {telegram.root} telegram, not one of a robot")
    if not all(map(values.__contains__, _ACTUAL)):
        raise RemoteProtocolError(
            "it has no RIst; enter DEF_RIst into the controller's Ethernet configuration"
        )
    pose, planned = _pose(values, _ACTUAL), _pose(values, _SET)
    late = number(values[_LATE]) if _LATE in values else None
    status = number(values[_STATUS]) if _STATUS in values else None
    axes, planned_axes = (_axes(values, tags) if needs_axes else None for tags in (_ACTUAL_AXES, _SET_AXES))
    needed = {"RSol": _SET, "AIPos": _ACTUAL_AXES, "ASPos": _SET_AXES} if needs_axes else {}
    missing = next((name for name, tags in needed.items() if tags[0] not in values), "")
    late_count = None if late is None else int(late)
    return RobotTelegram(
        telegram.ipoc, pose or NO_POSE, planned, late_count, status, axes, planned_axes, missing
    )


def _axes(values: Mapping[str, str], tags: tuple[str, ...]) -> Joints | None:
    """Return the axes in these values, degrees; None if one is not a number."""
    try:
        found = numbers(values, tags)
    except RemoteProtocolError:
        return None
    if found is None:
        return None
    a, b, c, d, e, f = found
    return a, b, c, d, e, f


def _pose(values: Mapping[str, str], tags: tuple[str, ...]) -> Pose | None:
    """Return the pose in these values; None if one is missing or not a number."""
    texts = tuple([values.get(tag) for tag in tags])
    return None if None in texts else _pose_in(texts)


@lru_cache(maxsize=4)
def _pose_in(texts: tuple[str, ...]) -> Pose | None:
    """Return the pose in X Y Z A B C; None if one is not a number. A set position stays the same for long."""
    try:
        return pose_of([*map(number, texts)])
    except RemoteProtocolError:
        return None
