"""Emulated arm: it streams its pose, and follows the set points in the answers."""

import math
from collections.abc import Sequence

from emulators.arm.followed import FollowedArm, FollowedProfile
from emulators.faults import FOREVER, Fault
from emulators.faults.own import OwnFaults
from emulators.orders import Act, Hindrance, Orders, Reach, ReceivedOrder
from emulators.seams import ArmPath, Handlers, Joints, StartPose
from protocol.geometry import Pose
from toy_robot.wire import CYCLE_S, HELLO, REPORT, TARGET

ARM_FAULTS = {
    "robot": {
        "mute": Fault("the arm sends nothing", {}, FOREVER),
        "emergency-stop": Fault("the arm stops, and reports the stop", {}, FOREVER),
    }
}
REACH = Reach(CYCLE_S, speed_m_s=0.25, turn_rad_s=1.5)
"""Speed of the arm; a set point farther from the previous one is a leap."""


class Arm:
    """Arm that reports each cycle and follows the set point in each answer: `EmulatedRobot` and `ReportingRobot`."""

    def __init__(self, profile: FollowedProfile, start: StartPose, now: float) -> None:
        self._arm = FollowedArm(profile, Pose(start.position, start.quaternion), now)
        self._number = 0
        self._report_at: float | None = None
        self._out: list[bytes] = []
        self.endpoint = self
        self.orders = Orders()
        self.path: ArmPath = self._arm.path
        self.targets = self._arm.path.targets
        self._faults = OwnFaults()
        self.handlers: Handlers = {"robot": self._faults.held(ARM_FAULTS["robot"])}

    def hindrance(self, now: float) -> Hindrance | None:
        """Return why set points do not move it, for `hil-bridge conform` and the panel."""
        stopped = self._faults.holds("emergency-stop", now)
        return Hindrance("the emergency stop is pressed", by_order=False) if stopped else None

    def joints_holding(self, pose: Pose, at: float) -> Joints | None:
        return None

    def receive(self, data: Sequence[bytes], now: float) -> None:
        for datagram in data:
            if datagram == HELLO:
                self._report_at = now
            elif len(datagram) == TARGET.size and datagram.startswith(b"AT"):
                _, _, x, y, z, w, i, j, k = TARGET.unpack(datagram)
                pose, taken = Pose((x, y, z), (w, i, j, k)), self.hindrance(now) is None
                if all(map(math.isfinite, (*pose.position, *pose.quaternion))) and any(pose.quaternion):
                    self.orders.tell(ReceivedOrder(now, Act.MOTION, "set point", taken, pose, reach=REACH))
                    if taken:
                        self._arm.follow(pose, now)
                else:
                    self.orders.tell(ReceivedOrder(now, Act.UNREADABLE, "set point that is no pose", False))

    def next_event(self) -> None:
        return None

    def data_to_send(self, now: float) -> Sequence[bytes]:
        out, self._out = self._out, []
        return out

    def next_deadline(self) -> float | None:
        return self._report_at

    def handle_deadline(self, now: float) -> None:
        while self._report_at is not None and self._report_at <= now:
            pose = self._arm.pose(now)
            stopped = self._faults.under_way("emergency-stop", now) is not None
            self._number += 1
            if stopped:
                self._arm.follow(pose, now)
            if self._faults.under_way("mute", now) is None:
                self._out.append(REPORT.pack(b"AR", self._number, *pose.position, *pose.quaternion, stopped))
            self._report_at += CYCLE_S
