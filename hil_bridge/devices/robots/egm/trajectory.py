"""Trajectories for the emulated ABB robot. The client of a run sends positions; this module composes the datagrams
for joints.
"""

import math
from collections.abc import Sequence
from typing import Any

from hil_bridge.devices.robots.egm.settings import EgmSettings
from hil_bridge.devices.trajectory import FAMILIES, SETTLE_S, Trajectory, TrajectoryResult, stream_trajectory
from hil_bridge.errors import ConfigError
from protocol.devices.egm import EgmClient
from protocol.devices.egm.messages import Guidance, RobotMessage, SensorMessage, decode_robot, encode_answer

_BEGIN_S = 60.0
"""Time-out for the start of the guidance, s. Chosen."""


def play(robot: Any, trajectory: Trajectory, settings: Any, now: float) -> TrajectoryResult:
    """Run a trajectory; see `hil_bridge.devices.trajectory.PlayTrajectory`."""
    mode, needed = settings.emulated.mode, "joint" if trajectory.family == "order_q" else "pose"
    if mode != needed:
        raise ConfigError(f"cell.egm.mode is {mode}; set it to {needed} for {trajectory.family}")
    if trajectory.family == "order_q":
        return _Joints(robot.endpoint, trajectory, now, settings.emulated.joints_in).run()
    own: EgmSettings = settings.client
    client = EgmClient(own.sample_ms * 1e-3, own.feed_forward, own.force_axes)
    return stream_trajectory(robot.endpoint, client, trajectory, now)


class _Joints:
    """Joint trajectory in progress, which begins at the present position of the arm."""

    def __init__(self, endpoint: Any, trajectory: Trajectory, now: float, joints_in: str) -> None:
        self._unit = 1.0 if joints_in == "radians" else math.radians(1.0)
        """Unit of the joints in datagrams, rad."""
        self._endpoint, self._trajectory, self._now = endpoint, trajectory, now
        self._start: tuple[float, ...] = ()
        """Joint positions of the arm before the trajectory, rad."""
        self._begin = math.nan
        """Start time of the trajectory, s."""
        self._times: list[float] = []
        self._rows: dict[str, list[tuple[float, ...]]] = {"order_q": [], "target_q": [], "q": []}
        self._number = 0

    def run(self) -> TrajectoryResult:
        """Run the trajectory and return the reports. Raises ConfigError if the robot stops."""
        patience = self._now + _BEGIN_S
        end = self._trajectory.end + 2.0 * self._trajectory.period
        while math.isnan(self._begin) or self._now - self._begin <= end:
            due = self._endpoint.next_deadline()
            if due is None or (math.isnan(self._begin) and due > patience):
                raise ConfigError("the emulated robot has not started its guidance")
            self._now = max(self._now, due)
            self._endpoint.handle_deadline(self._now)
            for datagram in self._endpoint.data_to_send(self._now):
                self._answer(decode_robot(datagram))
        columns = {
            name: [row[k] for row in rows]
            for family, rows in self._rows.items()
            for k, name in enumerate(FAMILIES[family])
        }
        return TrajectoryResult(self._times, columns)

    def _answer(self, message: RobotMessage) -> None:
        feedback, planned = message.feedback, message.planned
        if feedback is None or planned is None:
            raise ConfigError("the emulated robot does not report its joints")
        joints = self._radians(feedback.joints_deg)
        self._start = self._start or joints
        if math.isnan(self._begin):
            if message.guidance is Guidance.RUNNING:
                self._begin = self._now + SETTLE_S
        elif message.guidance is not Guidance.RUNNING:
            raise ConfigError("the emulated robot has ended its guidance")
        first, time = self._trajectory.values[0], self._now - self._begin
        order = self._trajectory.at(time) if time >= 0.0 else first
        if time >= 0.0:
            self._times.append(time)
            self._rows["order_q"].append(order)
            self._rows["target_q"].append(_moved(self._radians(planned.joints_deg), self._start, first))
            self._rows["q"].append(_moved(joints, self._start, first))
        ordered = tuple(map(math.degrees, _moved(order, first, self._start)))
        self._number += 1
        answer = SensorMessage(self._number, message.tm_ms, joints_deg=ordered)
        self._endpoint.receive([encode_answer(answer)], self._now)

    def _radians(self, joints: Sequence[float]) -> tuple[float, ...]:
        return tuple(joint * self._unit for joint in joints)


def _moved(joints: Sequence[float], source: Sequence[float], goal: Sequence[float]) -> tuple[float, ...]:
    """Return `goal`, displaced by the difference between `joints` and `source`."""
    return tuple([part - begin + end for part, begin, end in zip(joints, source, goal, strict=True)])
