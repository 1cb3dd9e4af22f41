"""Trajectory of orders for an emulated robot, and the reports of the robot during the trajectory.

This is the interface between a device package and the comparison with a real robot. A package with a
`RobotEmulation.play` sends a trajectory over its own protocol. Time is virtual and begins with the first order.
Column names are the names in `FAMILIES`.
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
"""Columns of a robot by family. Order: values that a client sends; target: the set point that the robot reports;
others: its actual state. Joints in rad and rad/s, positions in m, forces in N, moments in N·m.
"""
_STALLED_S = 60.0
"""Time-out for a robot that reports nothing or does not start, s. Chosen."""
SETTLE_S = 0.5
"""Time for which the robot is held at its position before the trajectory, s. Chosen: RSI drops the corrections of
its first cycles.
"""
_ROUNDING_S = 1e-9
_PERIODS = 4.0
"""Number of order periods for which reports are read after the last order. Chosen."""


@dataclass(frozen=True, slots=True)
class Trajectory:
    """Orders of one family over time."""

    family: str
    """Family of the orders: `order_q`, `order_qd` or `order_position`."""
    times: Sequence[float]
    """Times of the orders, s, ascending from 0."""
    values: Sequence[tuple[float, ...]]
    """Values of the family at each time, in the unit of the family."""
    start: tuple[float, ...] = ()
    """Joint positions at which a trajectory of speeds begins, rad; empty for the present position of the robot."""
    at_arrival: bool = False
    """Whether reports are stamped with their arrival time instead of the time of the robot's clock."""

    @property
    def end(self) -> float:
        """Time of the last order, s."""
        return self.times[-1]

    @property
    def period(self) -> float:
        """Mean time between two orders, s."""
        return self.end / (len(self.times) - 1)

    def at(self, time: float) -> tuple[float, ...]:
        """Return the order at a time, s, linearly interpolated. Before the start it is the first order, after the
        end the last one.
        """
        place = bisect_right(self.times, time)
        if place == 0:
            return self.values[0]
        if place == len(self.times):
            return self.values[-1]
        share = (time - self.times[place - 1]) / (self.times[place] - self.times[place - 1])
        before, after = self.values[place - 1], self.values[place]
        return tuple([a + share * (b - a) for a, b in zip(before, after, strict=True)])


class TrajectoryResult(NamedTuple):
    """Reports of a robot during a trajectory."""

    times: list[float]
    """Time of each report since the first order, s, by the robot's clock if it reports one, unless arrival times
    are requested.
    """
    columns: dict[str, list[float]]
    """Values by column. Positions are relative to the start of the trajectory, regardless of the position of the
    emulated arm.
    """


PlayTrajectory = Callable[[Any, Trajectory, Any, float], TrajectoryResult]
"""Function that runs a trajectory. Its arguments are the emulated robot, the trajectory, the `KindSettings` and the
time at which the robot was powered up, s. Raises ConfigError for a family that the protocol cannot order, and if
the robot stops.
"""


@dataclass(slots=True)
class _Log:
    times: list[float] = field(default_factory=list)
    orders: list[tuple[float, ...]] = field(default_factory=list)
    """Order sent in answer to each report."""
    targets: list[tuple[float, ...]] = field(default_factory=list)
    """Order in effect at each report, which is the order sent in answer to the previous report."""
    places: list[Vector] = field(default_factory=list)

    def note(self, time: float, order: tuple[float, ...], place: Vector) -> None:
        """Record a report and the answer to it."""
        self.times.append(time)
        self.targets.append(self.orders[-1] if self.orders else order)
        self.orders.append(order)
        self.places.append(place)

    def result(self) -> TrajectoryResult:
        """Return all records."""
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
    endpoint: Any, client: StreamClient[Any], trajectory: Trajectory, now: float
) -> TrajectoryResult:
    """Run a trajectory of positions on a robot that sends first and expects an answer to each packet, with the
    client of a run.

    The trajectory begins at the robot's present position. Errors as for `PlayTrajectory`.
    """
    if trajectory.family != "order_position":
        raise ConfigError(f"this robot accepts order_position or target_position, not {trajectory.family}")
    log = _Log()
    start: Pose | None = None
    settled_at = began = math.nan
    patience = now + _STALLED_S
    while math.isnan(began) or now - began <= trajectory.end + _PERIODS * trajectory.period:
        due = endpoint.next_deadline()
        if due is None or due > patience:
            raise ConfigError("the emulated robot has ended the connection")
        now = max(now, due)
        endpoint.handle_deadline(now)
        client.receive(endpoint.data_to_send(now), now)
        for report in _reports(client):
            if start is None:
                client.hold(now)
                if not report.fault:
                    start, settled_at = report.pose, now + SETTLE_S
                    client.begin(start)
                continue
            if report.fault:
                raise ConfigError(f"the emulated robot has stopped: {report.fault}")
            if math.isnan(began) and now >= settled_at - _ROUNDING_S:
                began, patience = now, math.inf
            if math.isnan(began):
                client.target(start, now)
                continue
            order = trajectory.at(now - began)
            client.target(Pose(_moved(order, trajectory.values[0], start.position), start.quaternion), now)
            log.note(now - began, order, _moved(report.pose.position, start.position, trajectory.values[0]))
        endpoint.receive(client.data_to_send(now), now)
    return log.result()


def _reports(client: StreamClient[Any]) -> Iterator[RobotReport]:
    """Yield the received reports. Raises ConfigError if the movement has ended."""
    while (event := client.next_event()) is not None:
        if isinstance(event, StreamLost):
            raise ConfigError(f"the emulated robot has stopped: {event.text}")
        if isinstance(event, ReportReceived):
            yield event.report


def _moved(place: Sequence[float], source: Sequence[float], goal: Sequence[float]) -> Vector:
    """Return `goal`, displaced by the difference between `place` and `source`."""
    x, y, z = (part - begin + end for part, begin, end in zip(place, source, goal, strict=True))
    return x, y, z
