"""Reception of a client's messages: reported to a judge as orders, then checked and accepted by a controller with
EGM.
"""

import math
from collections import Counter

from emulators.devices.egm.guided import ArmJoints
from emulators.devices.egm.profile import EgmProfile
from emulators.orders import Act, Reach, ReceivedOrder
from emulators.unmodelled import Unmodelled
from protocol.devices.egm import (
    Answer,
    PathCorrection,
    SensorMessage,
    decode_answer,
    from_wire,
    has_external_axes,
)
from protocol.endpoint import RemoteProtocolError

_COUNTS = (0, 6)
"""Valid numbers of joints in a message."""


class Receiver:
    """Reads messages in the mode of one controller."""

    def __init__(
        self,
        profile: EgmProfile,
        kinematics: ArmJoints,
        counters: Counter[str],
        unmodelled: Unmodelled,
        now: float,
    ) -> None:
        self._profile, self._kinematics = profile, kinematics
        self._counters, self._unmodelled = counters, unmodelled
        self._number: int | None = None
        """Number of the newest message, regardless of the state in which it arrived."""
        self._newest: int | None = None
        """Number of the newest accepted message; None before the first of a session."""
        self.received_at = now
        """Time of the newest message that keeps the session alive, s."""
        self.unusable = ""
        """Reason why the newest unusable message could not be used."""

    def begin_session(self, now: float) -> None:
        """Begin a session: count messages from the next one."""
        self._newest, self.received_at = None, now

    def accept(self, datagram: bytes, now: float) -> Answer | None:
        """Return the message in a datagram for the controller's queue; None if it contains no usable message."""
        try:
            message = decode_answer(datagram)
            self._check(message)
        except RemoteProtocolError as error:
            self._counters["unusable"] += 1
            self.unusable = str(error)
            if self._profile.bad_refreshes_timeout:
                self.received_at = now
            return None
        if self._profile.seqno_check == "drop_old" and self._is_old(message.seqno):
            self._counters["old number"] += 1
            return None
        self._newest, self.received_at = message.seqno, now
        self._counters["messages"] += 1
        if isinstance(message, SensorMessage):
            if has_external_axes(datagram):
                self._unmodelled.touch("externalJoints", "this arm has no external axes")
            if message.dnum:
                self._unmodelled.touch("RAPIDtoRobot.dnum", "no RAPID program reads it")
            if not message.has_content:
                return None
        return message

    def _is_old(self, seqno: int) -> bool:
        """Return whether a message is older than the newest one. Number 0 restarts the numbering [A]."""
        return bool(seqno) and self._newest is not None and (self._newest - seqno) % 2**32 < 2**31

    def _check(self, message: Answer) -> None:
        """Raise RemoteProtocolError for a message that cannot be used in this mode."""
        if isinstance(message, PathCorrection) != (self._profile.mode == "path"):
            raise RemoteProtocolError(f"a {type(message).__name__} in mode {self._profile.mode}")
        if isinstance(message, PathCorrection):
            return
        if len(message.joints_deg) not in _COUNTS or len(message.joint_speed_deg_s) not in _COUNTS:
            counts = f"{len(message.joints_deg)} joints and {len(message.joint_speed_deg_s)} joint speeds"
            raise RemoteProtocolError(f"expected 6 of each or none, got {counts}")
        if len(message.speed) not in (0, 3, 6):
            raise RemoteProtocolError("the number of speeds is neither 3 nor 6")
        pose = message.pose
        if pose is not None and abs(math.hypot(*pose.quaternion) - 1.0) > self._profile.quat_tol:
            raise RemoteProtocolError("the quaternion is not a unit quaternion")

    def read_order(self, datagram: bytes, now: float, accepted: bool) -> ReceivedOrder:
        """Return a message as an order, regardless of the state. `accepted` states whether the robot acts on it now."""
        try:
            message = decode_answer(datagram)
            if other := self._other_mode(message):
                problem = f"{other}, but EGM runs in mode {self._profile.mode}, see cell.egm.mode"
                return ReceivedOrder(now, Act.REFUSED, problem, False)
            self._check(message)
        except RemoteProtocolError as error:
            return ReceivedOrder(now, Act.UNREADABLE, str(error), False)
        order = ReceivedOrder(
            now, Act.MOTION, "speed", accepted, reach=self._reach, breach=self._breach_of(message)
        )
        if isinstance(message, PathCorrection):
            return order._replace(words="path correction", moves=any(message.offset_mm), reach=None)
        speed = any(message.speed) or any(message.joint_speed_deg_s)
        if message.pose is not None and not speed:
            return order._replace(words="pose", pose=from_wire(message.pose))
        if message.joints_deg and not speed:
            a, b, c, d, e, f = map(math.radians, message.joints_deg)
            return order._replace(words="joints", pose=self._kinematics.pose((a, b, c, d, e, f)))
        along, about = message.speed[:3], message.speed[3:]
        tool_speed = math.hypot(*along) * 1e-3, math.radians(math.hypot(*about))
        return order._replace(moves=speed, speed=tool_speed)

    def _other_mode(self, message: Answer) -> str:
        """Describe the order in a message that only another mode accepts; return an empty string for a message of
        this mode.
        """
        mode = self._profile.mode
        if isinstance(message, PathCorrection):
            return "" if mode == "path" else "a path correction"
        by_joints = bool(message.joints_deg or message.joint_speed_deg_s)
        by_pose = message.pose is not None or bool(message.speed)
        if mode == "path":
            return "a position or a speed" if by_joints or by_pose else ""
        if by_joints == by_pose or by_joints == (mode == "joint"):
            return ""
        return "joints" if by_joints else "a pose"

    @property
    def _reach(self) -> Reach:
        """Return the speed at which the guidance follows orders.

        In joint mode, the arm is assumed to be stretched, with the speeds of all axes added.
        """
        profile = self._profile
        if profile.mode != "joint":
            speed, turn = profile.max_tcp_mm_s * 1e-3, math.radians(profile.max_tcp_deg_s)
        else:
            turn = 6.0 * math.radians(profile.max_speed_dev_deg)
            speed = self._kinematics.reach * turn
        return Reach(profile.sample_ms * 1e-3, speed, turn)

    def _breach_of(self, message: Answer) -> str:
        """Describe a message number that does not exceed the previous one, as EGM's header requires. Number 0
        restarts.
        """
        numbered = self._number, message.seqno
        self._number = message.seqno
        last, number = numbered
        if last is None or not number or 0 < (number - last) % 2**32 < 2**31:
            return ""
        return f"the sequence number {number} after {last}"
