"""Answers to a robot that drives the cycle: a bounded next set point for each packet, with a dead-man's switch.

The responder has no I/O and no clock: like every endpoint, it is given the time. It wraps the robot's `StreamClient`
and answers each packet inside the call that delivered it, so that no task lies between packet and answer.

An answer moves the set point towards the newest target by at most speed × cycle, and never by more than speed × the
time since the last step. Packets that were delayed and arrive together therefore do not add up to a jump.
Acceleration, and deceleration at a target, are limited; see `robots.ramp`. Every stop is immediate. The set point does
not move

- if there has been no new target for `hold_after`; it continues with the next target;
- after a packet that reports a fault or an invalid pose, until the robot reports that it is ready and at the set point,
  and there is a new target, because the robot's motion in between is unknown;
- for a duplicate packet, or a packet that arrives after a later one;
- if the last gate stops it, which is a fault of this side, until there is a new target.

If there has been no new target for `give_up_after`, the movement is ended, even if the robot no longer sends.
"""

import math
from collections import Counter, deque
from dataclasses import replace
from typing import Generic

from hil_bridge.devices.facts import ANSWERS, LATE, MISSING, PACKETS
from hil_bridge.devices.robots.gate import Bounds, Gate, depth_of
from hil_bridge.devices.robots.motion_faults import MotionFaults
from hil_bridge.devices.robots.ramp import Pace, Ramp
from hil_bridge.devices.robots.seam import ANSWER, PACKET, MotionLimits
from hil_bridge.errors.event_kinds import EventKind
from hil_bridge.transports.pump import Data
from protocol.endpoint import NO_TROUBLE, Trouble
from protocol.geometry import Pose
from protocol.robot import (
    ReportReceived,
    RobotReport,
    StreamClient,
    StreamEvent,
    StreamLost,
    StreamNotice,
    pose_fault,
)

EVENTS_MAX = 1024
"""Maximum number of queued events. Chosen: four times the datagrams that a wire delivers at once."""
CONFIRMED_AFTER = 3
"""Number of answers with a target after which the target counts as delivered. A single answer may be lost. Chosen:
at a loss of 5 %, 1 target in 8000 remains undelivered.
"""


class SetpointResponder(Generic[Data]):
    """Endpoint that answers the packets that a robot's client decodes."""

    def __init__(self, client: StreamClient[Data], cycle: float) -> None:
        """Wrap a client. `cycle` is the time between two packets of the robot, s."""
        self._client = self.wrapped = client
        self._cycle = cycle
        self._events: deque[StreamEvent] = deque(maxlen=EVENTS_MAX)
        self.counters: Counter[str] = Counter()
        """Counts of packets, of answers and of their problems, by name."""
        self._arrived: list[float] = []
        """Arrival times of the packets whose answers have not been sent yet, s."""
        self._answered: tuple[tuple[str, float], ...] = ()
        """Stamps of the last answer that was sent."""
        self.newest: RobotReport | None = None
        """Report with the highest sequence number."""
        self.speed = 0.0
        """Speed of the set point, m/s; may be set at any time."""
        self.faults = MotionFaults()
        """Faults of the robot and of this side in this movement."""
        self.lost = NO_TROUBLE
        """Reason why the movement was ended, by the other side or because of a missing target."""
        self._limits = MotionLimits(0.0)
        self._ramp = Ramp(cycle)
        self._setpoint: Pose | None = None
        """Answer to the newest packet; None outside a movement."""
        self._goal: Pose | None = None
        self._targeted_at = self._stepped_at = -math.inf
        self._gate = Gate(Bounds(), 0.0)
        self._gate_speed = self._deepest = math.nan
        """Speed assumed by the gate, m/s, and larger depth of the two ends of the path to the target, m."""
        self._held = False
        self._sent_count = 0
        """Number of answers that have contained the target."""

    @property
    def moving(self) -> bool:
        """Whether a movement is in progress."""
        return self._setpoint is not None

    @property
    def arrived(self) -> bool:
        """Whether the robot has been sent the complete path to the target, or there is no movement."""
        return self._setpoint is None or self._sent_count >= CONFIRMED_AFTER

    def begin(self, pose: Pose, limits: MotionLimits, now: float) -> None:
        """Begin a movement at the present pose of the robot."""
        self._setpoint = self._goal = pose
        self._limits, self.speed = limits, limits.speed
        self._targeted_at = self._stepped_at = now
        self._held, self._sent_count, self.lost, self.faults = False, 0, NO_TROUBLE, MotionFaults()
        self._ramp.rest()
        self._open_gate(pose, now)
        self._client.begin(pose)

    def aim(self, target: Pose, now: float) -> None:
        """Move to this target from the next packet on. Does nothing outside a movement."""
        if self._setpoint is not None:
            self._goal, self._sent_count = target, 0
            bounds = self._gate.bounds
            self._deepest = max(depth_of(self._setpoint.position, bounds), depth_of(target.position, bounds))
            self.renew(now)

    def renew(self, now: float) -> None:
        """Confirm that the target is still valid."""
        self._targeted_at, self._held = now, False

    def stay(self) -> None:
        """Discard the rest of the path, so that the set point stays."""
        self._goal, self._sent_count = self._setpoint, 0
        self._ramp.rest()

    def end(self) -> None:
        """End the movement at the set point. Idempotent."""
        if self.moving:
            self._setpoint = self._goal = None
            self._client.end()

    # --- as an endpoint

    def receive(self, data: Data, now: float) -> None:
        self._client.receive(data, now)
        self._handle_events(now)

    def next_event(self) -> StreamEvent | None:
        return self._events.popleft() if self._events else None

    def data_to_send(self, now: float) -> Data:
        data = self._client.data_to_send(now)
        if self._arrived:
            for arrived in self._arrived:
                if now - arrived > self._cycle:
                    self.counters[LATE] += 1
            if len(data):
                self._answered = (PACKET, self._arrived[-1]), (ANSWER, now)
            self._arrived.clear()
        return data

    def next_deadline(self) -> float | None:
        own, client = self._targeted_at + self._limits.give_up_after, self._client.next_deadline()
        if not self.moving:
            return client
        return own if client is None else min(own, client)

    def handle_deadline(self, now: float) -> None:
        self._client.handle_deadline(now)
        self._handle_events(now)
        self._watch(now)

    # --- packets

    def _handle_events(self, now: float) -> None:
        while (event := self._client.next_event()) is not None:
            if isinstance(event, ReportReceived):
                self._watch(now)
                fresh = self._note(event.report, now)
                self._answer(event.report, fresh, now)
                continue
            self._events.append(event)
            if isinstance(event, StreamLost):
                self.lost = self.lost or Trouble(event.text, event.remedy)
                self.end()

    def _note(self, report: RobotReport, now: float) -> bool:
        """Store a report and queue it. Return False if it is older than the newest report."""
        self.counters[PACKETS] += 1
        if self.newest is not None:
            missing = report.sequence - self.newest.sequence - 1
            if missing < 0:
                self.counters["stale packets"] += 1
                return False
            if missing:
                self.counters[MISSING] += missing
        if wrong := pose_fault(report.pose):
            report = report._replace(fault=report.fault or f"reports {wrong}")
        if self._setpoint is not None:
            report = self._compare(report, self._setpoint, now)
        if self._answered:
            report = report._replace(stamps=(*report.stamps, *self._answered))
        self.newest = report
        self._events.append(ReportReceived(report))
        return True

    def _compare(self, report: RobotReport, setpoint: Pose, now: float) -> RobotReport:
        """Return a report of this movement, including any fault that has not been reported yet. A fault discards
        the rest of the path.
        """
        faults = self.faults
        if report.fault:
            faults.note(Trouble(report.fault, report.remedy), displaced=True)
            self.stay()
        elif faults.displaced and faults.is_back(report.pose, setpoint):
            self._setpoint = self._goal = (
                report.pose
            )  # after an operator's stop, continue from the robot's present pose
            self._open_gate(report.pose, now)
            self._client.begin(report.pose)
        if report.fault or not faults.first:
            return report
        return report._replace(fault=faults.first.fact, remedy=faults.first.remedy)

    def _answer(self, report: RobotReport, fresh: bool, now: float) -> None:
        self.counters[ANSWERS] += 1
        self._arrived.append(report.received_at)
        if self._setpoint is None:
            self._client.hold(now)
            return
        if fresh:
            self._step(self._setpoint, now)
        self._sent_count += self._setpoint == self._goal
        self._client.target(self._setpoint, now)

    def _step(self, setpoint: Pose, now: float) -> None:
        """Move the set point along its path."""
        passed, self._stepped_at = now - self._stepped_at, now
        if self._goal is None or self.faults.displaced or setpoint == self._goal:
            self._ramp.rest()
            return
        limits = self._limits
        if now - self._targeted_at > limits.hold_after:
            self._ramp.rest()
            if not self._held:
                self._held = True
                self.counters["holds"] += 1
                self._notify(f"no new target for {limits.hold_after:g} s: the robot is held on its path")
            return
        if self.speed != self._gate_speed:
            self._open_gate(setpoint, now - passed)
        pace = Pace(self.speed, limits.turn_speed, limits.acceleration, limits.turn_acceleration)
        after = self._ramp.step(setpoint, self._goal, pace, passed)
        if stopped := self._gate.judge(after, now, self._deepest):
            self.faults.note(Trouble(stopped), displaced=False)
            self.stay()
            self._notify(stopped)
            return
        self._setpoint = after

    def _open_gate(self, pose: Pose, now: float) -> None:
        """Start a gate at this pose: no set point may move farther than the speed allows in a cycle."""
        speed, limits = self.speed, self._limits
        bounds = replace(
            limits.bounds or Bounds(),
            deeper=speed,
            across=speed,
            away=speed,
            turn=limits.turn_speed,
            time=self._cycle,
        )
        self._gate, self._gate_speed = Gate(bounds, now, pose), speed

    def _watch(self, now: float) -> None:
        """End the movement if it no longer receives targets."""
        if self.moving and now - self._targeted_at >= self._limits.give_up_after:
            self.lost = Trouble(f"no new target for {self._limits.give_up_after:g} s: the movement was ended")
            self.end()
            self._events.append(StreamLost(*self.lost))

    def _notify(self, text: str) -> None:
        self._events.append(StreamNotice(EventKind.MOTION, text))
