"""Contents of a robot's telegram in the form that the client uses."""

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
"""Pose of a telegram whose position is not numeric. The robot is not moved to it."""


class RobotTelegram(NamedTuple):
    """Contents of a telegram of the robot."""

    ipoc: int
    pose: Pose
    planned: Pose | None
    """Set position, without any correction; None if the telegram has none."""
    late: int | None
    """Number of answers that were late or missing since the program started; None if the telegram has no count."""
    status: float | None
    axes: Joints | None = None
    """Actual axes, degrees; None if they are missing or not numeric."""
    planned_axes: Joints | None = None
    """Set axes, without any correction, degrees; None if they are missing or not numeric."""
    missing: str = ""
    """Name of a missing element that a correction of the axes needs; empty if none is missing."""

    @property
    def offset(self) -> Correction | None:
        """Difference between actual and set position; None if one of them is unknown."""
        return (
            None if self.planned is None or self.pose is NO_POSE else offset_between(self.pose, self.planned)
        )


def read_telegram(raw: bytes, needs_axes: bool) -> RobotTelegram:
    """Parse a telegram of the robot. A position that is not numeric becomes `NO_POSE`.

    Raises RemoteProtocolError if the position or the clock is missing.
    """
    telegram = decode(raw)
    values = telegram.values
    if telegram.root != ROBOT:
        raise RemoteProtocolError(f"it is a {telegram.root} telegram, not one from a robot")
    if not all(map(values.__contains__, _ACTUAL)):
        raise RemoteProtocolError("it has no RIst; add DEF_RIst to the controller's Ethernet configuration")
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
    """Parse the values of these tags as axes, degrees; None if a value is missing or not a number."""
    try:
        axes = numbers(values, tags)
    except RemoteProtocolError:
        return None
    if axes is None:
        return None
    a, b, c, d, e, f = axes
    return a, b, c, d, e, f


def _pose(values: Mapping[str, str], tags: tuple[str, ...]) -> Pose | None:
    """Parse the values of these tags as a pose; None if a value is missing or not a number."""
    texts = tuple([values.get(tag) for tag in tags])
    return None if None in texts else _pose_in(texts)


@lru_cache(maxsize=4)
def _pose_in(texts: tuple[str, ...]) -> Pose | None:
    """Parse X Y Z A B C as a pose; None if a value is not a number. The result is cached, because a set position
    rarely changes.
    """
    try:
        return pose_of([*map(number, texts)])
    except RemoteProtocolError:
        return None
