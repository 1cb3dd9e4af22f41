"""Evidence about a client from an emulated robot: its orders, and the motion of the tool. Its size is bounded."""

import math
from collections import deque
from dataclasses import dataclass, field
from typing import NamedTuple

from emulators.orders import Act, Hindrance, ReceivedOrder
from hil_bridge.lab.conform.ending import Ending
from hil_bridge.lab.conform.robots.scenarios import MOVED_M, MOVED_RAD, Rules
from hil_bridge.lab.conform.robots.strides import Stride, Strides
from protocol.geometry import Pose, Quaternion, Vector, angle_between

_WINDOW_S = 0.05
"""Chosen: shortest time over which a rotation of the tool, and a change of its speed, is measured."""
_FIRST = 10
"""Chosen: number of first texts of one kind that are kept."""


@dataclass(slots=True)
class RobotEvidence(Ending):
    """Evidence of one scenario of a robot. Times are seconds since its start; lengths m, speeds m/s."""

    contact_at: float | None = None
    """First contact of the client: a connection, a request or an order."""
    unreadable: int = 0
    """Packets that the robot cannot parse."""
    first_unreadable: str = ""
    orders: int = 0
    """Motion orders."""
    taken: int = 0
    """Orders that the robot accepted."""
    moving: int = 0
    """Accepted orders that lead to another pose than the previous one."""
    refusals: list[str] = field(default_factory=list)
    """Requests that this emulated robot does not support, the first ten."""
    breaches: int = 0
    """Orders with a protocol violation that the robot tolerates."""
    first_breach: str = ""
    first_order_at: float | None = None
    last_order_at: float | None = None
    largest_step_m: float = 0.0
    """Largest distance of an order from the previous one, or from the tool if that is nearer."""
    largest_turn_rad: float = 0.0
    """The same for the rotation."""
    largest_speed_m_s: float = 0.0
    """Largest ordered speed: explicit, or the step over the time since the previous order."""
    leaps: int = 0
    """Orders farther from the previous one than the robot moves in one cycle."""
    turns: int = 0
    """The same for the rotation."""
    w_misplaced: bool = False
    """Whether one of these has the w of its quaternion at the wrong end, judged by the tool's orientation."""
    rushes: int = 0
    """Orders of a speed above the robot's."""
    robot_speed_m_s: float | None = None
    """Top speed of the robot's tool; None if it is unknown, or orders contain a speed."""
    longest_pause_s: float = 0.0
    """Longest time between two orders."""
    moved_at: float | None = None
    moved_m: float = 0.0
    """Largest distance of the tool from its start."""
    turned_rad: float = 0.0
    """Largest rotation of the tool from its start."""
    fastest_m_s: float = 0.0
    """Largest speed of the tool, sampled every few milliseconds."""
    fastest_rad_s: float = 0.0
    """The same for its rotation, over 50 ms or more."""
    largest_gain_m_s: float = 0.0
    """Largest change of the tool's velocity within `speed_up_s`, before the fault and by orders."""
    fault_at: float | None = None
    """Time of the fault; in a scenario without one, time of the first order."""
    last_motion_s: float | None = None
    """Time from the fault to the last order that would have moved the tool."""
    after_stop: int = 0
    """Orders that would have moved the tool, later than `react_s` after the fault."""
    after_stop_step_m: float = 0.0
    """Largest step of those."""
    moved_after_m: float = 0.0
    """Distance that the tool moved later than `react_s` after the fault."""
    turned_after_rad: float = 0.0
    """Angle that it rotated then."""
    releases: list[str] = field(default_factory=list)
    """Actions after the fault that are reserved for an operator at the robot, the first ten."""
    returned_at: float | None = None
    """End of the cut."""
    back_at: float | None = None
    """First order accepted after the cut."""
    hindrance: str = ""
    """First state after the first order in which the robot did not follow orders."""
    own_stop: str = ""
    """First such state that an order of the client caused."""
    left_m_s: float = 0.0
    """Speed of the tool at the end."""
    left_rad_s: float = 0.0
    """The same for its rotation."""
    last_pose: tuple[Vector, tuple[float, ...]] | None = None
    """Position, m, and quaternion w x y z of the tool at the end."""


class ToolSample(NamedTuple):
    """Sample of the tool's pose, m, and velocity, m/s, in the base frame."""

    position: Vector
    quaternion: Quaternion
    velocity: Vector


class Watch:
    """Collector of evidence from a robot's orders and the motion of its tool."""

    def __init__(self, begun_at: float, rules: Rules, *, stops: bool, from_start: bool) -> None:
        """Watch a trial. `stops`: the fault stops the robot. `from_start`: it may not move from the start."""
        self.seen = RobotEvidence()
        self._begun_at, self._react, self._speed_up = begun_at, rules.react_s, rules.speed_up_s
        self._stops, self._from_start = stops, from_start
        self._strides = Strides(rules.pause_s)
        self._start: ToolSample | None = None
        """First sample of the tool."""
        self._tool: Pose | None = None
        """Present pose of the tool."""
        self._samples: deque[tuple[float, ToolSample]] = deque()
        """Newest samples, from which speeds are measured."""
        self._stood: ToolSample | None = None
        """Sample of the tool at `react_s` after the fault."""
        self._hindered = False

    # --- orders

    def receive(self, order: ReceivedOrder) -> None:
        """Evaluate an order received by the robot."""
        at, seen = order.at - self._begun_at, self.seen
        if seen.contact_at is None:
            seen.contact_at = at
        match order.act:
            case Act.UNREADABLE:
                seen.unreadable += 1
                seen.first_unreadable = seen.first_unreadable or order.words
            case Act.RELEASE:
                behind = self._from_start or (seen.fault_at is not None and at > seen.fault_at)
                if behind:
                    _keep(seen.releases, order.words)
            case Act.REFUSED:
                _keep(seen.refusals, order.words)
            case Act.PROGRAM if order.moves:
                self._ordered(at, order, Stride())
            case Act.MOTION:
                self._ordered(at, order, self._strides.take(order, order.tool or self._tool))
            case _:
                pass

    def _ordered(self, at: float, order: ReceivedOrder, stride: Stride) -> None:
        seen, moving = self.seen, stride.elsewhere
        seen.orders += 1
        seen.taken += order.taken
        seen.moving += order.taken and moving and order.act is Act.MOTION
        if order.breach:
            seen.breaches += 1
            seen.first_breach = seen.first_breach or order.breach
        if seen.last_order_at is not None:
            seen.longest_pause_s = max(seen.longest_pause_s, at - seen.last_order_at)
        seen.last_order_at = at
        seen.largest_step_m = max(seen.largest_step_m, stride.step_m)
        seen.largest_turn_rad = max(seen.largest_turn_rad, stride.turn_rad)
        seen.largest_speed_m_s = max(seen.largest_speed_m_s, stride.speed_m_s)
        seen.leaps += stride.leaps
        seen.turns += stride.turns
        seen.w_misplaced |= stride.w_misplaced
        seen.rushes += stride.rushes
        if order.reach is not None and not order.reach.own_way:
            seen.robot_speed_m_s = order.reach.speed_m_s
        if seen.first_order_at is None:
            seen.first_order_at = at
        if self._from_start and moving and seen.fault_at is None:
            seen.fault_at = at
        if self._stops and seen.fault_at is not None and moving and at >= seen.fault_at:
            since = at - seen.fault_at
            seen.last_motion_s = since
            if since > self._react and not (self._from_start and order.taken):
                seen.after_stop += 1
                seen.after_stop_step_m = max(seen.after_stop_step_m, stride.step_m)
        if order.taken and seen.returned_at is not None and seen.back_at is None and at >= seen.returned_at:
            seen.back_at = at

    # --- the robot

    def update(self, now: float, tool: ToolSample, hindrance: Hindrance | None) -> None:
        """Evaluate a sample of the tool, and what keeps it from moving."""
        at, seen, position = now - self._begun_at, self.seen, tool.position
        if self._start is None:
            self._start = tool
        self._tool = Pose(position, tool.quaternion)
        seen.fastest_m_s = max(seen.fastest_m_s, math.hypot(*tool.velocity))
        away = math.dist(position, self._start.position)
        seen.moved_m = max(seen.moved_m, away)
        turned = angle_between(tool.quaternion, self._start.quaternion)
        seen.turned_rad = max(seen.turned_rad, turned)
        self._measure(
            at, tool, by_orders=hindrance is None and seen.fault_at is None and not seen.told_to_end
        )
        if seen.moved_at is None and (away >= MOVED_M or turned >= MOVED_RAD):
            seen.moved_at = at
        if self._stops and seen.fault_at is not None and at >= seen.fault_at + self._react:
            stood = self._stood = self._stood or tool
            seen.moved_after_m = max(seen.moved_after_m, math.dist(position, stood.position))
            turned = angle_between(tool.quaternion, stood.quaternion)
            seen.turned_after_rad = max(seen.turned_after_rad, turned)
        self._hinder(hindrance)

    def _measure(self, at: float, tool: ToolSample, by_orders: bool) -> None:
        """Measure the change of speed and the angular speed of the tool."""
        seen, samples = self.seen, self._samples
        samples.append((at, tool))
        while len(samples) > 1 and at - samples[1][0] >= _WINDOW_S:
            samples.popleft()
        since, before = samples[0]
        if (span := at - since) >= _WINDOW_S:
            turn = angle_between(tool.quaternion, before.quaternion)
            seen.fastest_rad_s = max(seen.fastest_rad_s, turn / span)
        if not by_orders:
            return
        gains = [
            math.dist(tool.velocity, sample.velocity)
            for then, sample in samples
            if at - then <= self._speed_up
        ]
        seen.largest_gain_m_s = max(seen.largest_gain_m_s, *gains)

    def _hinder(self, hindrance: Hindrance | None) -> None:
        seen, before = self.seen, self._hindered
        self._hindered = hindrance is not None
        if hindrance is None or before or seen.first_order_at is None:
            return
        leaving = seen.told_to_end or seen.ended_at is not None
        if not seen.hindrance and (
            hindrance.by_order or not leaving
        ):  # a robot may stop when its client has gone
            seen.hindrance = hindrance.words
        if hindrance.by_order and not seen.own_stop:
            seen.own_stop = hindrance.words


def _keep(words: list[str], more: str) -> None:
    """Keep the first texts, without duplicates."""
    if more not in words and len(words) < _FIRST:
        words.append(more)
