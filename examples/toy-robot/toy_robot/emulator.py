"""The arm itself: it streams its pose, and follows the set points that it is answered with."""

import math
from collections.abc import Sequence

from emulators.arm.followed import FollowedArm, FollowedProfile
from emulators.faults import FOREVER, Fault
from emulators.faults.own import OwnFaults
from emulators.seams import ArmPath, Handlers, Joints, StartPose
from protocol.geometry import Pose
from toy_robot.wire import CYCLE_S, HELLO, REPORT, TARGET

ARM_FAULTS = {
    "arm": {
        "mute": Fault("the arm sends nothing", {}, FOREVER),
        "stop": Fault("the arm stands still, and says so", {}, FOREVER),
    }
}


class Arm:
    """An arm that reports each cycle, and follows the set point that it is answered with: an `EmulatedRobot`."""

    def __init__(self, profile: FollowedProfile, start: StartPose, now: float) -> None:
        self._arm = FollowedArm(profile, Pose(start.position, start.quaternion), now)
        self._number = 0
        self._report_at: float | None = None
        self._out: list[bytes] = []
        self.endpoint = self
        self.path: ArmPath = self._arm.path
        self._faults = OwnFaults()
        self.handlers: Handlers = {"arm": self._faults.held(ARM_FAULTS["arm"])}

    @property
    def accepted(self) -> int:
        return self._arm.path.accepted

    def begun_at(self, target: int) -> float | None:
        return self._arm.path.begun_at(target)

    def joints_holding(self, pose: Pose, at: float) -> Joints | None:
        return None

    def receive(self, data: Sequence[bytes], now: float) -> None:
        for datagram in data:
            if datagram == HELLO:
                self._report_at = now
            elif len(datagram) == TARGET.size and datagram.startswith(b"AT"):
                _, _, x, y, z, w, i, j, k = TARGET.unpack(datagram)
                if self._faults.under_way("stop", now) is not None:
                    continue
                if all(map(math.isfinite, (x, y, z, w, i, j, k))) and any((w, i, j, k)):
                    self._arm.follow(Pose((x, y, z), (w, i, j, k)), now)

    def next_event(self) -> None:
        return None

    def data_to_send(self, now: float) -> Sequence[bytes]:
        out, self._out = self._out, []
        return out

    def next_deadline(self) -> float | None:
        return self._report_at

    def handle_deadline(self, now: float) -> None:
        while self._report_at is not None and self._report_at <= now:
            pose, stopped = self._arm.pose(now), self._faults.under_way("stop", now) is not None
            self._number += 1
            if stopped:
                self._arm.follow(pose, now)
            if self._faults.under_way("mute", now) is None:
                self._out.append(REPORT.pack(b"AR", self._number, *pose.position, *pose.quaternion, stopped))
            self._report_at += CYCLE_S
