"""Telegrams of an emulated KUKA controller, with the tags that its configuration sends."""

import math
from collections.abc import Sequence

from emulators.arm.reported_pose import ReportedPose
from emulators.devices.rsi.arm import CorrectedArm
from emulators.devices.rsi.desk import Desk
from emulators.devices.rsi.profile import RsiProfile
from emulators.devices.rsi.session import Session
from protocol.devices.rsi import ROBOT, Telegram, axis_tags, encode, fixed, pose_tags
from protocol.devices.rsi.angles import values_of
from protocol.geometry import Pose
from protocol.kinematics import Joints as Axes

MAKER = "KUKA"
RUNS, STOPPED = "3", "4"
"""Values that report the state of the program. Observed (FZI's configuration)."""
NO_AXES: Axes = (math.nan,) * 6
_EXTERNAL = range(1, 7)
_ACTUAL, _LATE, _STATUS, _OVERRIDE = pose_tags("RIst"), "Delay.D", "ProgStatus.R", "OvPro.R"
_AXES, _TORQUES = axis_tags("AIPos"), axis_tags("GearTorque")
_TORQUE_TAGS = frozenset(_TORQUES)
_NO_NUMBER = "NaN"


class Reporter:
    """Creates the telegrams of one controller."""

    def __init__(self, profile: RsiProfile, arm: CorrectedArm, desk: Desk) -> None:
        self._profile, self._arm, self._desk = profile, arm, desk
        self.pose = ReportedPose(arm.pose)
        """Measured pose, as altered by faults."""

    def make_telegram(self, session: Session, ipoc: int, runs: bool, now: float) -> bytes:
        """Return the next telegram of a session; `runs` states whether the program is running."""
        empty = self._profile.empty_first and not session.sent
        session.sent += 1
        values = {} if empty else self._values(session, runs, now)
        return encode(Telegram(ROBOT, MAKER, values, ipoc), self._profile.rob_type_attr)

    def _values(self, session: Session, runs: bool, now: float) -> dict[str, str]:
        """Return the values of the tags that the configuration sends."""
        values = dict(session.values)
        if _ACTUAL[0] in values:
            pose = self.pose.told(self._arm.pose(now), now)
            if pose is None:
                values = {tag: text for tag, text in values.items() if tag not in (*_ACTUAL, *_AXES)}
            else:
                values.update(zip(_ACTUAL, self._texts(values_of(pose)), strict=True))
                if _AXES[0] in values:
                    axes = NO_AXES if math.isnan(pose.position[0]) else self._arm.axes_of(pose)
                    values.update(zip(_AXES, self._texts(axes), strict=True))
        if not _TORQUE_TAGS.isdisjoint(values) and (torques := self._arm.torques(now)) is not None:
            texts = zip(_TORQUES, self._texts(torques), strict=True)
            values.update({tag: text for tag, text in texts if tag in values})
        if _LATE in values:
            values[_LATE] = str(session.ethernet.late)
        if _STATUS in values:
            values[_STATUS] = RUNS if runs else STOPPED
        if _OVERRIDE in values:
            values[_OVERRIDE] = str(self._desk.override_percent)
        return values

    def constant_values(self, programmed: Pose, axes: Axes) -> dict[str, str]:
        """Return the values of the tags that are constant in a session, in order."""
        values: dict[str, str] = {}
        for tag in self._profile.send:
            name = tag.removeprefix("DEF_")
            match name:
                case "RIst" | "RSol":
                    group = dict(zip(pose_tags(name), self._texts(values_of(programmed)), strict=True))
                case "AIPos" | "ASPos":
                    group = dict(zip(axis_tags(name), self._texts(axes), strict=True))
                case "MACur":
                    group = dict.fromkeys(axis_tags(name), self._texts((0.0,))[0])
                case "EIPos" | "ESPos" | "MECur":
                    group = dict.fromkeys((f"{name}.E{axis}" for axis in _EXTERNAL), self._texts((0.0,))[0])
                case "Delay":
                    group = {_LATE: "0"}
                case _:
                    group = {name: "0"}
            values |= group
        return values

    def _texts(self, values: Sequence[float]) -> list[str]:
        return [_NO_NUMBER if math.isnan(v) else fixed(v, self._profile.precision) for v in values]
