"""Reader of a client's packets as orders for a judge, whether or not the controller follows them."""

import math
from typing import NamedTuple

from emulators.orders import Act, Reach, ReceivedOrder
from hil_fanuc.motion import Motion
from hil_fanuc.packets import CARTESIAN, Command, Signal, ToRobot, is_finite
from hil_fanuc.profile import FanucProfile
from hil_fanuc.stream_server import StreamServer
from protocol.geometry import Pose, from_angles

JOINTS_AS_POSE = (
    "data style 0: the joints of the arm are read as the pose X Y Z W P R, and the arm leaves for it; "
    "0xFFFF means joints"
)
"""Breach of a client that sends joints with the data style of poses: a real incident."""
_NEAR_DEG = 20.0
"""Largest difference from the joints of the arm at which numbers are its joints, degrees. Chosen."""
_FAR_M = 0.05
"""Smallest distance of the pose from the tool at which it is not meant, m. Chosen."""
_TURN_RAD_S = math.radians(540.0)
"""Largest rotational speed of a tool, rad/s: that of the three joints of the wrist together."""


class Order(NamedTuple):
    """Tool pose that a command orders, and the rule that the command breaks."""

    pose: Pose
    breach: str = ""


class OrderReader:
    """Reads the commands of a client."""

    def __init__(self, profile: FanucProfile, motion: Motion, server: StreamServer) -> None:
        self._profile, self._motion, self._server = profile, motion, server
        speed = (profile.collaborative_mm_s or profile.max_speed_mm_s) / 1e3
        self._reach = Reach(profile.cycle_s, speed, _TURN_RAD_S)

    def read(self, packet: ToRobot, now: float, acts: bool) -> ReceivedOrder | None:
        """Return a packet as an order; None if it orders nothing. `acts` says whether the controller follows it."""
        if isinstance(packet, Signal):
            return ReceivedOrder(now, Act.CONTACT, "start or stop packet", True)
        if not isinstance(packet, Command) or not packet.moves:
            return None
        six = packet.position[:6]
        if not is_finite(six):
            return ReceivedOrder(now, Act.UNREADABLE, "a position that is not a number", False)
        style = packet.data_style
        order = self._pose_order(six) if style == CARTESIAN else self._joint_order(six)
        breach = order.breach or self._wrong_number(packet)
        text = "pose" if style == CARTESIAN else "joints"
        return ReceivedOrder(now, Act.MOTION, text, acts, order.pose, reach=self._reach, breach=breach)

    def _joint_order(self, six: tuple[float, ...]) -> Order:
        a, b, c, d, e, f = six
        return Order(self._motion.arm.pose((a, b, c, d, e, f)))

    def _pose_order(self, six: tuple[float, ...]) -> Order:
        arm, (x, y, z, w, p, r) = self._motion.arm, six
        pose = arm.in_base(Pose((x / 1e3, y / 1e3, z / 1e3), from_angles(r, p, w)))
        if not self._server.reports_tcp:
            pose = arm.tip_of(pose)
        joints = self._motion.set_point
        near = max(abs(to - q) for to, q in zip(six, joints, strict=True)) < _NEAR_DEG
        far = math.dist(pose.position, self._motion.path.pose.position) > _FAR_M
        return Order(pose, JOINTS_AS_POSE if near and far else "")

    def _wrong_number(self, command: Command) -> str:
        newest = self._server.sequence
        if command.sequence == newest:
            return ""
        return f"the number {command.sequence} is not that of the newest report"
