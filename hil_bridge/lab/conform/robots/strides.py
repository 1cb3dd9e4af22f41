"""Steps and rotations between successive orders, judged by the speed of the robot and the client's own pace."""

import math
from collections import deque
from statistics import median
from typing import NamedTuple

from emulators.orders import Reach, ReceivedOrder
from hil_bridge.lab.conform.robots.scenarios import SAME_PLACE_M, SAME_TURN_RAD
from protocol.geometry import Pose, angle_between

_KEPT = 50
"""Number of most recent intervals and speeds that define the pace of a client. Chosen."""
_KNOWN = 5
"""Number of intervals after which the pace of a client is known. Chosen."""
_STREAM = 10
"""Number of orders after which a client of a path-planning robot counts as streaming. Chosen."""
_FIRST_CYCLES = 5
"""Robot cycles allowed for the motion from the tool to the position of the first order. Chosen."""
_NEAR_RAD = 0.02
"""Largest angle at which a reordered quaternion matches the tool's orientation, rad, which reveals that its
components are in the wrong order. Chosen.
"""


class Stride(NamedTuple):
    """Motion of an order from the previous order or from the tool, whichever is nearer."""

    step_m: float = 0.0
    turn_rad: float = 0.0
    speed_m_s: float = 0.0
    """Speed of the order, m/s."""
    leaps: bool = False
    """Whether the step is larger than the speed of the robot and the client's own pace allow."""
    turns: bool = False
    """Whether the rotation is larger than the speed of the robot and the client's own pace allow."""
    rushes: bool = False
    """Whether the ordered speed exceeds the top speed of the robot."""
    elsewhere: bool = True
    """Whether the order leads to another pose than the previous order."""
    w_misplaced: bool = False
    """Whether the order rotates the tool abruptly, but would not if the w of its quaternion were at the other end."""


class Strides:
    """Judge of one client's motion orders, in the sequence in which they arrive."""

    def __init__(self, pause_s: float) -> None:
        """Create a judge. `pause_s` is the tolerated delay of this computer, s."""
        self._pause = pause_s
        self._last: Pose | None = None
        self._at = 0.0
        self._intervals: deque[float] = deque(maxlen=_KEPT)
        self._speeds: deque[tuple[float, float]] = deque(maxlen=_KEPT)
        """Most recent speeds of the client's path, m/s and rad/s."""
        self._first: Stride | None = None
        """First stride for a path-planning robot; None for other robots, and once the client counts as streaming."""

    def take(self, order: ReceivedOrder, tool: Pose | None) -> Stride:
        """Return the stride of a motion order; `tool` is the present pose of the robot's tool."""
        if order.pose is None:
            speed, turning = order.speed
            return Stride(
                speed_m_s=speed, rushes=_is_beyond(order.reach, speed, turning), elsewhere=order.moves
            )
        if not all(map(math.isfinite, (*order.pose.position, *order.pose.quaternion))):
            return Stride(elsewhere=order.moves)
        before, interval = self._last, order.at - self._at
        self._last, self._at = order.pose, order.at
        distances = [_distance(order.pose, place) for place in (before, tool) if place is not None]
        if not distances:
            return Stride()
        step, turn = (min(part) for part in zip(*distances, strict=True))
        far, away = distances[0]
        elsewhere = far > SAME_PLACE_M or away > SAME_TURN_RAD
        if order.reach is None:
            return Stride(step, turn, elsewhere=elsewhere)
        stride = self._judge(order.reach, (step, turn), None if before is None else interval, elsewhere)
        misplaced = stride.turns and tool is not None and _has_w_misplaced(order.pose, tool)
        return stride._replace(w_misplaced=misplaced)

    def _judge(
        self, reach: Reach, distance: tuple[float, float], interval: float | None, elsewhere: bool
    ) -> Stride:
        step, turn = distance
        if interval is None:
            allowed = self._limits(reach, _FIRST_CYCLES * reach.cycle_s, 0.0)
        else:
            usual = self._usual(reach, interval)
            allowed = self._limits(reach, usual, min(interval, usual + self._pause))
        known = not reach.plans_own_path or len(self._intervals) >= _STREAM
        far, turns = step > allowed[0] + SAME_PLACE_M, turn > allowed[1] + SAME_TURN_RAD
        stride = Stride(step, turn, 0.0, known and far, known and turns, elsewhere=elsewhere)
        if interval is None:
            self._first = stride if reach.plans_own_path else None
            return stride
        if interval > 0.0:
            self._intervals.append(interval)
        span = max(interval, usual)
        if not (far or turns) or not known:
            self._speeds.append((step / span, turn / span))
        stride = stride._replace(speed_m_s=step / span)
        return self._judge_first(reach, usual, stride)

    def _judge_first(self, reach: Reach, usual: float, stride: Stride) -> Stride:
        """Judge the first rotation once the client counts as streaming, since a first order often leads to the
        start of a path.
        """
        first = self._first
        if first is None or len(self._intervals) < _STREAM:
            return stride
        self._first = None
        _, most = self._limits(reach, usual, usual)
        if first.turn_rad <= most + SAME_TURN_RAD:
            return stride
        return stride._replace(turn_rad=max(first.turn_rad, stride.turn_rad), turns=True)

    def _usual(self, reach: Reach, interval: float) -> float:
        """Return the usual time between two orders, s, which is at least one cycle of the robot."""
        known = len(self._intervals) >= _KNOWN
        usual = median(self._intervals) if known else min(max(interval, *self._intervals, 0.0), self._pause)
        return max(usual, reach.cycle_s)

    def _limits(self, reach: Reach, usual: float, interval: float) -> tuple[float, float]:
        """Return the largest allowed step, m, and rotation, rad, from the speed of the robot and the speed of the
        client's path.
        """
        speed = max((speed for speed, _ in self._speeds), default=0.0)
        turning = max((turning for _, turning in self._speeds), default=0.0)
        if not reach.plans_own_path:
            speed, turning = min(speed, reach.speed_m_s), min(turning, reach.turn_rad_s)
        return (
            max(reach.speed_m_s * usual, speed * interval),
            max(reach.turn_rad_s * usual, turning * interval),
        )


def _distance(pose: Pose, place: Pose) -> tuple[float, float]:
    """Return the distance, m, and the angle, rad, between two poses."""
    turn = angle_between(pose.quaternion, place.quaternion)
    return math.dist(pose.position, place.position), turn if math.isfinite(turn) else 0.0


def _has_w_misplaced(pose: Pose, tool: Pose) -> bool:
    """Return whether the quaternion of a pose is ordered x y z w instead of w x y z, or the reverse: only the
    reordered quaternion matches the tool's.
    """
    w, x, y, z = pose.quaternion
    return any(angle_between(other, tool.quaternion) < _NEAR_RAD for other in ((z, w, x, y), (x, y, z, w)))


def _is_beyond(reach: Reach | None, speed: float, turning: float) -> bool:
    return reach is not None and (speed > reach.speed_m_s or turning > reach.turn_rad_s)
