"""A course of orders for an emulated robot, and its reports meanwhile: the seam between a room and its judges.

A room with a `RobotEmulation.play` plays a course over the bytes of its protocol. Time begins with the first order and
is virtual: the player tells it to the robot. Names of columns are those of `FAMILIES`.
"""

import math
from bisect import bisect_right
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from hil_bridge.errors import ConfigError
from protocol.geometry import Pose, Vector
from protocol.robot import ReportReceived, RobotReport, StreamClient, StreamLost

_JOINTS = tuple(range(1, 7))
_PLACE = ("x", "y", "z")
FAMILIES: Mapping[str, tuple[str, ...]] = {
    "order_q": tuple(f"order_q{k}" for k in _JOINTS),
    "order_qd": tuple(f"order_qd{k}" for k in _JOINTS),
    "order_position": tuple(f"order_{axis}" for axis in _PLACE),
    "target_q": tuple(f"target_q{k}" for k in _JOINTS),
    "target_qd": tuple(f"target_qd{k}" for k in _JOINTS),
    "target_position": tuple(f"target_{axis}" for axis in _PLACE),
    "q": tuple(f"q{k}" for k in _JOINTS),
    "qd": tuple(f"qd{k}" for k in _JOINTS),
    "position": _PLACE,
    "force": ("fx", "fy", "fz"),
    "moment": ("mx", "my", "mz"),
}
"""Columns of a robot by family. Order: what a client sends; target: the set point that the robot tells; else: what it
is. Joints in rad and rad/s, places in m, forces in N, moments in N·m.
"""
_STALLED_S = 60.0
"""Chosen: a robot that tells nothing for so long, or does not begin, is given up."""
SETTLE_S = 0.5
"""Chosen: a robot is held at its place for so long first. RSI drops the corrections of its first moments."""
_ROUNDING_S = 1e-9
_PERIODS = 4.0
"""Chosen: periods of its orders for which a robot is listened to behind the last one."""


@dataclass(frozen=True, slots=True)
class Trajectory:
    """Orders of one family over time."""

    family: str
    """`order_q`, `order_qd` or `order_position`."""
    times: Sequence[float]
    """s, ascending from 0."""
    values: Sequence[tuple[float, ...]]
    """Parts of the family at each time, in its unit."""
    start: tuple[float, ...] = ()
    """Joints at which a course of speeds begins, rad; empty where the robot stands."""
    at_arrival: bool = False
    """Reports are wanted with the times at which they come, and not with those of the robot's own clock."""

    @property
    def end(self) -> float:
        """Time of the last order, s."""
        return self.times[-1]

    @property
    def period(self) -> float:
        """Mean time between two orders, s."""
        return self.end / (len(self.times) - 1)

    def at(self, time: float) -> tuple[float, ...]:
        """The order at a time, s: on the straight line between two; the first before, the last behind."""
        place = bisect_right(self.times, time)
        if place == 0:
            return self.values[0]
        if place == len(self.times):
            return self.values[-1]
        share = (time - self.times[place - 1]) / (self.times[place] - self.times[place - 1])
        before, after = self.values[place - 1], self.values[place]
        return tuple([a + share * (b - a) for a, b in zip(before, after, strict=True)])


class TrajectoryResult(NamedTuple):
    """Reports of a robot while a course was played."""

    times: list[float]
    """s since the first order: by the robot's own clock where it tells one, unless arrivals are wanted."""
    columns: dict[str, list[float]]
    """Places count from where the course begins, wherever the emulated arm stands."""


PlayTrajectory = Callable[[Any, Trajectory, Any, float], TrajectoryResult]
"""Plays a course: from the emulated robot, the course, the `KindSettings` and the time at which the robot was powered
up, s. Raises ConfigError for a family that the protocol cannot order, and where the robot stops.
"""


@dataclass(slots=True)
class _Log:
    times: list[float] = field(default_factory=list)
    orders: list[tuple[float, ...]] = field(default_factory=list)
    """Answers to the reports."""
    targets: list[tuple[float, ...]] = field(default_factory=list)
    """Orders that the robot had when it reported: those before."""
    places: list[Vector] = field(default_factory=list)

    def note(self, time: float, order: tuple[float, ...], place: Vector) -> None:
        """A report and its answer."""
        self.times.append(time)
        self.targets.append(self.orders[-1] if self.orders else order)
        self.orders.append(order)
        self.places.append(place)

    def played(self) -> TrajectoryResult:
        """All of it."""
        families: dict[str, Sequence[tuple[float, ...]]] = {
            "order_position": self.orders,
            "target_position": self.targets,
            "position": self.places,
        }
        columns = {
            name: [row[k] for row in rows]
            for family, rows in families.items()
            for k, name in enumerate(FAMILIES[family])
        }
        return TrajectoryResult(self.times, columns)


def stream_trajectory(
    endpoint: Any, client: StreamClient[Any], course: Trajectory, now: float
) -> TrajectoryResult:
    """PlayTrajectory places to a robot that speaks first and is answered each time, with the client of a run.

    The course begins where the robot stands. Errors as of `PlayTrajectory`.
    """
    if course.family != "order_position":
        raise ConfigError(f"this robot is played order_position or target_position, not {course.family}")
    log = _Log()
    start: Pose | None = None
    settled = began = math.nan
    patience = now + _STALLED_S
    while math.isnan(began) or now - began <= course.end + _PERIODS * course.period:
        due = endpoint.next_deadline()
        if due is None or due > patience:
            raise ConfigError("the emulated robot has ended the conversation")
        now = max(now, due)
        endpoint.handle_deadline(now)
        client.receive(endpoint.data_to_send(now), now)
        for report in _reports(client):
            if start is None:
                client.hold(now)
                if not report.fault:
                    start, settled = report.pose, now + SETTLE_S
                    client.begin(start)
                continue
            if report.fault:
                raise ConfigError(f"the emulated robot has stopped: {report.fault}")
            if math.isnan(began) and now >= settled - _ROUNDING_S:
                began, patience = now, math.inf
            if math.isnan(began):
                client.target(start, now)
                continue
            order = course.at(now - began)
            client.target(Pose(_moved(order, course.values[0], start.position), start.quaternion), now)
            log.note(now - began, order, _moved(report.pose.position, start.position, course.values[0]))
        endpoint.receive(client.data_to_send(now), now)
    return log.played()


def _reports(client: StreamClient[Any]) -> Iterator[RobotReport]:
    """The reports that came. Raises ConfigError where the movement has ended."""
    while (event := client.next_event()) is not None:
        if isinstance(event, StreamLost):
            raise ConfigError(f"the emulated robot has stopped: {event.text}")
        if isinstance(event, ReportReceived):
            yield event.report


def _moved(place: Sequence[float], source: Sequence[float], goal: Sequence[float]) -> Vector:
    """A place as far from `goal` as it was from `source`."""
    x, y, z = (part - begin + end for part, begin, end in zip(place, source, goal, strict=True))
    return x, y, z
