"""Evidence about a client, collected from an emulated robot: its orders, and the motion of the tool. The amount of
data is bounded.
"""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from emulators.orders import Act, Hindrance, ReceivedOrder
from hil_bridge.lab.conform.ending import Ending
from hil_bridge.lab.conform.robots.offences import Offence, Offender, find_offences
from hil_bridge.lab.conform.robots.scenarios import MOVED_M, MOVED_RAD, STILL_M, STILL_RAD, Rules
from hil_bridge.lab.conform.robots.strides import Stride, Strides
from protocol.geometry import Pose, Quaternion, Vector, angle_between

_WINDOW_S = 0.05
"""Shortest time over which a rotation of the tool, and a change of its speed, is measured, s. Chosen."""
_FIRST = 10
"""Maximum number of texts of one kind that are kept, earliest first. Chosen."""
_NO_STRIDE = Stride()


@dataclass(slots=True)
class RobotEvidence(Ending):
    """Evidence of one scenario with a robot. Times are in s since the start of the scenario, lengths in m, speeds
    in m/s.
    """

    contact_at: float | None = None
    """Time of the client's first contact: a connection, a request or an order."""
    unreadable: int = 0
    """Number of packets that the robot cannot parse."""
    first_unreadable: str = ""
    orders: int = 0
    """Number of motion orders."""
    taken: int = 0
    """Number of motion orders that the robot accepted."""
    moving: int = 0
    """Number of accepted orders that lead to another pose than the previous order."""
    refusals: list[str] = field(default_factory=list)
    """First ten requests that this emulated robot does not support."""
    breaches: int = 0
    """Number of orders that violate the protocol in a way that the robot tolerates."""
    first_breach: str = ""
    first_order_at: float | None = None
    last_order_at: float | None = None
    largest_step_m: float = 0.0
    """Largest distance of an order from the previous order, or from the tool if the tool is nearer, m."""
    largest_turn_rad: float = 0.0
    """Largest rotation of an order relative to the previous order, or to the tool if the tool is nearer, rad."""
    largest_speed_m_s: float = 0.0
    """Largest ordered speed, m/s: the speed in an order, or the step divided by the time since the previous order."""
    leaps: int = 0
    """Number of orders whose step is larger than the speed of the robot and the client's own pace allow."""
    turns: int = 0
    """Number of orders whose rotation is larger than the speed of the robot and the client's own pace allow."""
    w_misplaced: bool = False
    """Whether one of these rotations has the w of its quaternion at the wrong end, judged by the orientation of the
    tool.
    """
    rushes: int = 0
    """Number of orders with a speed above the top speed of the robot."""
    robot_speed_m_s: float | None = None
    """Top speed of the robot's tool, m/s; None if it is unknown, or if the robot plans its own path."""
    longest_pause_s: float = 0.0
    """Longest time between two orders, s."""
    moved_at: float | None = None
    moved_m: float = 0.0
    """Largest distance of the tool from its start, m."""
    turned_rad: float = 0.0
    """Largest rotation of the tool from its start, rad."""
    fastest_m_s: float = 0.0
    """Largest speed of the tool, sampled every few milliseconds, m/s."""
    fastest_rad_s: float = 0.0
    """Largest angular speed of the tool, measured over 50 ms or more, rad/s."""
    largest_gain_m_s: float = 0.0
    """Largest change of the tool's velocity within `speed_up_s`, before the fault and while the robot follows
    orders, m/s.
    """
    largest_gain_at: float | None = None
    offences: list[Offender] = field(default_factory=list)
    """First order with each offence, in order of time."""
    fault_at: float | None = None
    """Time of the fault, s. In a scenario in which the robot may not move from the start, time of the first order
    that would move the tool.
    """
    last_before_fault_at: float | None = None
    """Time of the last order before the fault."""
    last_motion_s: float | None = None
    """Time from the fault to the last order that would have moved the tool, s."""
    after_stop: int = 0
    """Number of orders later than `react_s` after the fault that would have moved the tool."""
    after_stop_step_m: float = 0.0
    """Largest step of these orders, m."""
    moved_after_m: float = 0.0
    """Distance that the tool moved later than `react_s` after the fault, m."""
    turned_after_rad: float = 0.0
    """Angle by which the tool rotated later than `react_s` after the fault, rad."""
    coasted_m: float = 0.0
    """Distance that the tool moved from the fault until `react_s` later, m."""
    moved_last_at: float | None = None
    """Time of the last motion of the tool after the fault, s; None if it did not move."""
    releases: list[str] = field(default_factory=list)
    """First ten actions after the fault that are reserved for an operator at the robot."""
    returned_at: float | None = None
    """Time at which the cut ended."""
    back_at: float | None = None
    """Time of the first order accepted after the cut."""
    hindrance: str = ""
    """Description of the first state after the first order in which the robot did not follow orders; empty if there
    was none.
    """
    hindered_at: float | None = None
    own_stop: str = ""
    """Description of the first state without response to orders that an order of the client caused; empty if there
    was none.
    """
    own_stop_at: float | None = None
    left_m_s: float = 0.0
    """Speed of the tool at the end of the scenario, m/s."""
    left_rad_s: float = 0.0
    """Angular speed of the tool at the end of the scenario, rad/s."""
    last_pose: tuple[Vector, tuple[float, ...]] | None = None
    """Position, m, and quaternion w x y z of the tool at the end of the scenario."""


class ToolSample(NamedTuple):
    """Sample of the tool's pose and velocity in the base frame: position, m, quaternion, and velocity, m/s."""

    position: Vector
    quaternion: Quaternion
    velocity: Vector


class Watch:
    """Collector of evidence from the orders of a client and the motion of the robot's tool."""

    def __init__(self, begun_at: float, rules: Rules, *, stops: bool, from_start: bool) -> None:
        """Create a collector. `stops` is whether the fault stops the robot, `from_start` whether the robot may not
        move from the start.
        """
        self.seen = RobotEvidence()
        self._begun_at, self._rules = begun_at, rules
        self._stops, self._from_start = stops, from_start
        self._strides = Strides(rules.pause_s)
        self._start: ToolSample | None = None
        """First sample of the tool."""
        self._tool: Pose | None = None
        """Present pose of the tool."""
        self._samples: deque[tuple[float, ToolSample]] = deque()
        """Most recent samples, from which speeds are measured."""
        self._stood: ToolSample | None = None
        """First sample of the tool at `react_s` after the fault or later."""
        self._at_fault: ToolSample | None = None
        """First sample of the tool after the fault."""
        self._rested: ToolSample | None = None
        """First sample of the tool at its present place."""
        self._hindered = False

    # --- orders

    def receive(self, order: ReceivedOrder) -> None:
        """Evaluate an order that the robot received."""
        at, evidence = order.at - self._begun_at, self.seen
        if evidence.contact_at is None:
            evidence.contact_at = at
        match order.act:
            case Act.UNREADABLE:
                self._offend([Offence.UNREADABLE], at, order)
                evidence.unreadable += 1
                evidence.first_unreadable = evidence.first_unreadable or order.words
            case Act.RELEASE:
                behind = self._from_start or (evidence.fault_at is not None and at > evidence.fault_at)
                if behind:
                    _keep(evidence.releases, order.words)
                if behind and self._stops and not self._from_start:
                    self._offend([Offence.RELEASE], at, order)
            case Act.REFUSED:
                _keep(evidence.refusals, order.words)
            case Act.PROGRAM if order.moves:
                self._ordered(at, order, _NO_STRIDE)
            case Act.MOTION:
                self._ordered(at, order, self._strides.take(order, order.tool or self._tool))
            case _:
                pass

    def _ordered(self, at: float, order: ReceivedOrder, stride: Stride) -> None:
        evidence, moving = self.seen, stride.elsewhere
        offences = [*find_offences(order, stride, self._rules)]
        if self._stops and moving and self._check_time(at, order, stride):
            offences.append(Offence.AFTER_STOP)
        self._offend(offences, at, order, stride)
        evidence.orders += 1
        evidence.taken += (is_accepted := order.taken)
        evidence.moving += is_accepted and moving and order.act is Act.MOTION
        if order.breach:
            evidence.breaches += 1
            evidence.first_breach = evidence.first_breach or order.breach
        if evidence.last_order_at is not None:
            evidence.longest_pause_s = max(evidence.longest_pause_s, at - evidence.last_order_at)
        evidence.last_order_at = at
        evidence.largest_step_m = max(evidence.largest_step_m, stride.step_m)
        evidence.largest_turn_rad = max(evidence.largest_turn_rad, stride.turn_rad)
        evidence.largest_speed_m_s = max(evidence.largest_speed_m_s, stride.speed_m_s)
        evidence.leaps += stride.leaps
        evidence.turns += stride.turns
        evidence.w_misplaced |= stride.w_misplaced
        evidence.rushes += stride.rushes
        if order.reach is not None and not order.reach.plans_own_path:
            evidence.robot_speed_m_s = order.reach.speed_m_s
        if evidence.first_order_at is None:
            evidence.first_order_at = at
        if (
            is_accepted
            and evidence.returned_at is not None
            and evidence.back_at is None
            and at >= evidence.returned_at
        ):
            evidence.back_at = at

    def _check_time(self, at: float, order: ReceivedOrder, stride: Stride) -> bool:
        """Record an order that would move the tool; return whether it is later than `react_s` after the fault."""
        evidence = self.seen
        if self._from_start and evidence.fault_at is None:
            evidence.fault_at = at
        if evidence.fault_at is None or at < evidence.fault_at:
            return False
        since = evidence.last_motion_s = at - evidence.fault_at
        if since <= self._rules.react_s or (self._from_start and order.taken):
            return False
        evidence.after_stop += 1
        evidence.after_stop_step_m = max(evidence.after_stop_step_m, stride.step_m)
        return True

    def _offend(
        self, offences: Sequence[Offence], at: float, order: ReceivedOrder, stride: Stride = _NO_STRIDE
    ) -> None:
        """Store the order for each offence that no earlier order had."""
        evidence = self.seen
        known, texts = {one.offence for one in evidence.offences}, {Offence.BREACH: order.breach}
        evidence.offences += [
            Offender(one, at, texts.get(one, order.words), stride.step_m, order.taken, evidence.last_order_at)
            for one in offences
            if one not in known
        ]

    # --- the robot

    def update(self, now: float, tool: ToolSample, hindrance: Hindrance | None) -> None:
        """Evaluate a sample of the tool, and the reason why the robot cannot move, if any."""
        at, evidence, position = now - self._begun_at, self.seen, tool.position
        if self._start is None:
            self._start = tool
        self._tool = Pose(position, tool.quaternion)
        evidence.fastest_m_s = max(evidence.fastest_m_s, math.hypot(*tool.velocity))
        away = math.dist(position, self._start.position)
        evidence.moved_m = max(evidence.moved_m, away)
        turned = angle_between(tool.quaternion, self._start.quaternion)
        evidence.turned_rad = max(evidence.turned_rad, turned)
        self._measure(
            at, tool, by_orders=hindrance is None and evidence.fault_at is None and not evidence.end_requested
        )
        if evidence.moved_at is None and (away >= MOVED_M or turned >= MOVED_RAD):
            evidence.moved_at = at
        if self._stops and evidence.fault_at is not None and at >= evidence.fault_at + self._rules.react_s:
            stood = self._stood = self._stood or tool
            evidence.moved_after_m = max(evidence.moved_after_m, math.dist(position, stood.position))
            turned = angle_between(tool.quaternion, stood.quaternion)
            evidence.turned_after_rad = max(evidence.turned_after_rad, turned)
        if evidence.fault_at is not None:
            self._coast(at, at - evidence.fault_at, tool)
        self._hinder(at, hindrance)

    def _coast(self, at: float, since: float, tool: ToolSample) -> None:
        """Measure how far the tool moves until the time `since` after the fault, and when it comes to rest."""
        evidence = self.seen
        begin, place = self._at_fault or tool, self._rested or tool
        self._at_fault, self._rested = begin, place
        if since <= self._rules.react_s:
            evidence.coasted_m = max(evidence.coasted_m, math.dist(tool.position, begin.position))
        gone = math.dist(tool.position, place.position)
        if gone > STILL_M or angle_between(tool.quaternion, place.quaternion) > STILL_RAD:
            self._rested, evidence.moved_last_at = tool, at

    def _measure(self, at: float, tool: ToolSample, by_orders: bool) -> None:
        """Measure the change of the tool's velocity, and its angular speed."""
        evidence, samples = self.seen, self._samples
        samples.append((at, tool))
        while len(samples) > 1 and at - samples[1][0] >= _WINDOW_S:
            samples.popleft()
        since, before = samples[0]
        if (span := at - since) >= _WINDOW_S:
            turn = angle_between(tool.quaternion, before.quaternion)
            evidence.fastest_rad_s = max(evidence.fastest_rad_s, turn / span)
        if not by_orders:
            return
        gains = [
            math.dist(tool.velocity, sample.velocity)
            for then, sample in samples
            if at - then <= self._rules.speed_up_s
        ]
        if (gain := max(gains)) > evidence.largest_gain_m_s:
            evidence.largest_gain_m_s, evidence.largest_gain_at = gain, at

    def _hinder(self, at: float, hindrance: Hindrance | None) -> None:
        evidence, before = self.seen, self._hindered
        self._hindered = hindrance is not None
        if hindrance is None or before or evidence.first_order_at is None:
            return
        leaving = evidence.end_requested or evidence.ended_at is not None
        if not evidence.hindrance and (
            hindrance.by_order or not leaving
        ):  # a robot may stop when its client has left
            evidence.hindrance, evidence.hindered_at = hindrance.words, at
        if hindrance.by_order and not evidence.own_stop:
            evidence.own_stop, evidence.own_stop_at = hindrance.words, at


def _keep(texts: list[str], more: str) -> None:
    """Append a text unless it is a duplicate, or the list is full."""
    if more not in texts and len(texts) < _FIRST:
        texts.append(more)
