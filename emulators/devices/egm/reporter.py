"""Datagrams of an emulated controller with EGM: measured pose, joints and force, as altered by faults."""

import math
from collections.abc import Mapping

from emulators.arm.followed import FollowedArm
from emulators.arm.own_force import Errors, OwnForce
from emulators.arm.reported_pose import ReportedPose
from emulators.devices.egm.guided import GuidedMotion
from emulators.devices.egm.profile import EgmProfile
from emulators.devices.egm.state import Session
from emulators.faults.ledger import Handler
from emulators.faults.own import OwnFaults
from emulators.faults.packets import WIRE
from emulators.seams import Joints
from protocol.devices.egm import Place, RobotMessage, RobotWare, encode_robot, to_wire
from protocol.geometry import Pose, inverse, rotate

_EPOCH_S = 1_700_000_000
"""Calendar time of the controller at power-up, s since 1970. Chosen: constant, so that runs with equal seeds are
equal.
"""
_NUMBER, _NO_OWN_FORCE = "wrong-seqno", "missing"
_NO_FORCE = (0.0,) * 6


class Reporter:
    """Creates the datagrams of a controller, given the time of its power-up, s."""

    def __init__(
        self, profile: EgmProfile, motion: GuidedMotion, arm: FollowedArm, powered_at: float, seed: int
    ) -> None:
        self._profile, self._motion, self._powered_at = profile, motion, powered_at
        self._version = RobotWare(profile.rw)
        self.measured: tuple[Pose, Joints] = motion.pose, motion.joints
        """Newest measured pose, and the joints that hold it."""
        self._pose = ReportedPose(arm.pose)
        rms = profile.force_noise_n
        noise = (rms, rms, rms, 0.0, 0.0, 0.0)
        errors = Errors(profile.force_offset_n, profile.force_lag_ms * 1e-3, noise, noise)
        self._force = OwnForce(errors, seed)
        self.feel = self._force.feel
        """Sets the source of the measured force; see `emulators.seams.FeelingRobot`."""
        self._faults = faults = OwnFaults()
        self.handlers: Mapping[str, Mapping[str, Handler]] = {
            "pose": self._pose.handlers,
            WIRE: faults.held((_NUMBER,)),
            "witness": {**self._force.handlers, **faults.held((_NO_OWN_FORCE,))},
        }
        self._seqno = 0

    def begin_session(self) -> None:
        """Restart the numbering of datagrams at 0."""
        self._seqno = 0

    def make_datagram(self, measured: Pose, at: float, session: Session) -> bytes:
        """Return the next datagram, with the pose measured at the given time, s."""
        motion, profile = self._motion, self._profile
        if measured != self.measured[0]:
            self.measured = measured, motion.holding(measured) or motion.joints
        motors, guidance, rapid = session.state.value[:3]
        microseconds = round((at - self._powered_at) * 1e6)
        time_us = _EPOCH_S * 1_000_000 + microseconds
        pose = self._pose.told(measured, at)
        newer = self._version is RobotWare.RW7
        message = RobotMessage(
            self._seqno,
            profile.tm_start + microseconds // 1000,
            Place(self._in_unit(self.measured[1]), None if pose is None else to_wire(pose), (), time_us),
            Place(self._in_unit(motion.joints), to_wire(motion.pose), (), time_us),
            motors,
            guidance,
            rapid,
            session.converged,
            self._measured_force(measured, at) if profile.measured_force else _NO_FORCE,
            False if newer else None,
            motion.utilization_percent,
            0 if newer else None,
            False if newer else None,
            False if newer else None,
        )
        self._seqno += 1
        return encode_robot(self._altered(message, at), self._version)

    def _in_unit(self, joints: Joints) -> tuple[float, ...]:
        return tuple(joints) if self._profile.joints_in == "radians" else tuple(map(math.degrees, joints))

    def _altered(self, message: RobotMessage, at: float) -> RobotMessage:
        """Return a message, altered by the active faults."""
        if (wrong := self._faults.under_way(_NUMBER, at)) is not None:
            message = message._replace(seqno=message.seqno + int(wrong.number("by")))
        if self._faults.under_way(_NO_OWN_FORCE, at) is not None:
            message = message._replace(force=(), force_control=None)
        return message

    def _measured_force(self, measured: Pose, at: float) -> tuple[float, ...]:
        """Return the measured force along the tool's axes, N, with zero moments."""
        return *rotate(inverse(measured.quaternion), self._force.at(at)[:3]), 0.0, 0.0, 0.0
