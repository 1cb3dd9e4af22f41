"""Status with a falsified pose or mode. The arm is unaffected."""

from collections.abc import Mapping

from emulators.arm.reported_pose import ReportedPose
from emulators.arm.waypoints import WaypointArm
from emulators.devices.s3.faults import REPORTED_POSE_FAULTS
from emulators.faults.ledger import Handler
from emulators.faults.own import OwnFaults
from protocol.devices.s3.arap import Status, position_words, quaternion_words
from protocol.geometry import Pose

_LIMIT = 4.095875
"""Largest coordinate that fits the status, m. Mark: observed."""
_STANDBY = "false-standby"


class Reporting:
    """Falsifies the reported pose and mode of a controller."""

    def __init__(self, motion: WaypointArm) -> None:
        self._motion = motion
        self._pose = ReportedPose(self._measured, REPORTED_POSE_FAULTS, in_cycles=False)
        self._own = OwnFaults()
        self.pose_handlers: Mapping[str, Handler] = self._pose.handlers
        """Fault handlers for a ledger, for the reported pose and for the reported mode."""
        self.mode_handlers: Mapping[str, Handler] = self._own.held((_STANDBY,))

    def falsified(self, status: Status, now: float) -> Status:
        """Return the status that is reported instead of the true one."""
        if self._pose.wrong:
            pose = self._pose.told(self._measured(now), now)
            assert pose is not None, "a status always has a pose"
            x, y, z = (max(-_LIMIT, min(_LIMIT, place)) for place in pose.position)
            a, b, c, d = (max(-1.0, min(1.0, part)) for part in pose.quaternion)
            status = status._replace(
                position_words=position_words((x, y, z)), quaternion_words=quaternion_words((a, b, c, d))
            )
        if self._own.any and not status.standby and self._own.under_way(_STANDBY, now):
            status = status._replace(standby=True, operation=False)
        return status

    def _measured(self, time: float) -> Pose:
        return Pose(self._motion.reported(time), self._motion.path.orientation(time))
