"""Time line of a scenario with a robot: fault, orders, and what robot and tool did."""

from collections.abc import Iterator, Mapping

from hil_bridge.lab.conform.ending import allowed_time, end_moments
from hil_bridge.lab.conform.robots.judging import gains_speed
from hil_bridge.lab.conform.robots.offences import Offence, Offender
from hil_bridge.lab.conform.robots.scenarios import EMERGENCY, LATE, MOVED_M, REFUSED, STOPPED, Rules
from hil_bridge.lab.conform.robots.watching import RobotEvidence
from hil_bridge.lab.conform.trial import CUT, NOMINAL
from hil_bridge.record.analysis.definition import concise
from hil_bridge.show.pages.timeline import Interval, Moment, TimeLine, Tone

_ORDERS, _ROBOT, _TOOL = "orders of the client", "robot", "motion of the tool"
_ZEROS = {LATE: "the delay", REFUSED: "the first order", CUT: "the cut", NOMINAL: "the start of the client"}
"""Name of the event at 0 s by scenario, if it is not the stop."""
_FAULTS = {
    LATE: "the robot's messages are delayed",
    REFUSED: "first order, to a robot that may not move",
    STOPPED: "the robot stops and reports it",
    EMERGENCY: "the emergency stop is pressed",
    CUT: "the link is cut",
}
_OFFENCES: Mapping[Offence, str] = {
    Offence.UNREADABLE: "first data that the robot cannot decode",
    Offence.BREACH: "first order that violates the protocol",
    Offence.LEAP: "first order that leaps",
    Offence.TURN: "first order that rotates the tool abruptly",
    Offence.RUSH: "first order that exceeds the robot's speed",
    Offence.AFTER_STOP: "first motion order after the time to react",
    Offence.RELEASE: "first release of the stop without an operator",
}
_STREAMED = (Offence.BREACH, Offence.LEAP, Offence.TURN, Offence.RUSH)
"""Offences whose last good order is the previous order."""
_BEFORE = 0.4
"""Displayed time before the fault, as a share of the time after it. Chosen."""


def robot_timeline(scenario: str, evidence: RobotEvidence, rules: Rules) -> TimeLine:
    """Return the time line of a scenario, relative to its fault; without a fault, to the start of the client."""
    line = _RobotLine(scenario, evidence, rules)
    return TimeLine([*line.moments()], [*line.intervals()], line.zero)


class _RobotLine:
    """Time line of a scenario with a robot."""

    def __init__(self, scenario: str, evidence: RobotEvidence, rules: Rules) -> None:
        self._scenario, self._evidence, self._rules = scenario, evidence, rules
        self._stops = scenario in (REFUSED, STOPPED, EMERGENCY) and evidence.fault_at is not None
        self._fault_at = evidence.fault_at
        self._zero_at = evidence.fault_at or 0.0
        self.zero = _ZEROS[NOMINAL] if evidence.fault_at is None else _ZEROS.get(scenario, "the stop")
        ends = (evidence.ended_at, evidence.end_requested_at, evidence.last_order_at, evidence.moved_last_at)
        self._end_at = max(at for at in (*ends, self._zero_at) if at is not None)
        self._begin_at = 0.0 if self._fault_at is None else self._begin(self._fault_at)

    def _begin(self, fault_at: float) -> float:
        return max(0.0, fault_at - _BEFORE * max(self._end_at - fault_at, self._rules.react_s))

    def moments(self) -> Iterator[Moment]:
        """Yield the moments, in any order."""
        for at, text, tone in (*self._course(), *self._offences(), *self._reactions()):
            if at is not None and at >= self._begin_at:
                yield Moment(at - self._zero_at, text, tone)
        for moment in end_moments(self._evidence, self._rules.end_s):
            yield Moment(moment.at - self._zero_at, moment.text, moment.tone)

    def _course(self) -> Iterator[tuple[float | None, str, Tone]]:
        evidence = self._evidence
        if self._fault_at is None:
            yield evidence.contact_at, "first contact of the client", Tone.PLAIN
            yield evidence.first_order_at, "first order", Tone.GOOD
            yield evidence.moved_at, "the tool moves", Tone.PLAIN
            return
        yield self._fault_at, _FAULTS.get(self._scenario, "the fault"), Tone.FAULT
        is_good = all(one.at > self._fault_at for one in self._judged())
        last = "last good order" if is_good else "last order"
        yield evidence.last_before_fault_at, f"{last} before {self.zero}", Tone.GOOD
        yield evidence.returned_at, "the link is restored", Tone.PLAIN
        yield evidence.back_at, "first order that the robot accepts after the cut", Tone.GOOD

    def _offences(self) -> Iterator[tuple[float | None, str, Tone]]:
        """Yield the first order of each offence, and the order before the first of them."""
        evidence = self._evidence
        listed = evidence.last_before_fault_at, evidence.first_order_at
        for number, one in enumerate(self._judged()):
            if not number and one.offence in _STREAMED and one.before_at not in listed:
                yield one.before_at, "last good order", Tone.GOOD
            yield one.at, _describe(one), Tone.BAD
            if one.offence is Offence.AFTER_STOP and evidence.after_stop > 1:
                last = self._zero_at + (evidence.last_motion_s or 0.0)
                yield last, f"last of {evidence.after_stop} such orders", Tone.BAD

    def _judged(self) -> list[Offender]:
        """Return the offenders that are mistakes in this scenario."""
        evidence = self._evidence
        excused = set() if self._scenario == NOMINAL else {Offence.UNREADABLE, Offence.BREACH}
        if evidence.breaches <= evidence.orders * self._rules.breaches_percent / 100.0:
            excused.add(Offence.BREACH)
        return [one for one in evidence.offences if one.offence not in excused]

    def _reactions(self) -> Iterator[tuple[float | None, str, Tone]]:
        """Yield what the robot and its tool did."""
        evidence = self._evidence
        if evidence.own_stop:
            yield evidence.own_stop_at, f"the robot stops because of an order: {evidence.own_stop}", Tone.BAD
        elif evidence.hindrance and not self._stops:
            yield evidence.hindered_at, f"the robot stops: {evidence.hindrance}", Tone.WARN
        if gains_speed(evidence, self._rules):
            text = f"the tool's speed changes by {evidence.largest_gain_m_s * 1e3:.0f} mm/s"
            yield evidence.largest_gain_at, text, Tone.BAD
        if evidence.left_m_s:
            speed = concise(evidence.left_m_s, 1e3, ".1f", "mm/s")
            yield self._end_at, f"the tool is left moving at {speed}", Tone.BAD
        if not self._stops:
            return
        if evidence.moved_after_m >= MOVED_M:
            moved = concise(evidence.moved_after_m, 1e3, ".1f", "mm")
            yield (
                evidence.moved_last_at,
                f"last motion of the tool: {moved} after the time to react",
                Tone.BAD,
            )
        elif evidence.moved_last_at is not None:
            coasted = concise(evidence.coasted_m, 1e3, ".1f", "mm")
            yield evidence.moved_last_at, f"the tool stands, after {coasted}", Tone.PLAIN

    def intervals(self) -> Iterator[Interval]:
        """Yield the intervals of each lane."""
        if self._stops:
            yield allowed_time(0.0, self._rules.react_s)
        for lane, begin, end, tone in (*self._order_bars(), *self._robot_bars(), *self._tool_bars()):
            if begin is not None and end is not None and end >= max(begin, self._begin_at):
                begin = max(begin, self._begin_at)
                yield Interval(lane, begin - self._zero_at, end - self._zero_at, tone)

    def _order_bars(self) -> Iterator[tuple[str, float | None, float | None, Tone]]:
        evidence, zero = self._evidence, self._zero_at
        if self._stops:
            late = zero + self._rules.react_s
            last = zero + (evidence.last_motion_s or 0.0)
            yield _ORDERS, evidence.first_order_at, evidence.last_before_fault_at, Tone.GOOD
            yield _ORDERS, zero, min(late, last), Tone.WARN
        elif self._scenario == CUT:
            yield _ORDERS, evidence.first_order_at, evidence.last_before_fault_at, Tone.GOOD
            yield _ORDERS, evidence.back_at, evidence.last_order_at, Tone.GOOD
        else:
            yield _ORDERS, evidence.first_order_at, evidence.last_order_at, Tone.GOOD
        for one in self._judged():
            is_late = one.offence is Offence.AFTER_STOP
            yield _ORDERS, one.at, zero + (evidence.last_motion_s or 0.0) if is_late else one.at, Tone.BAD

    def _robot_bars(self) -> Iterator[tuple[str, float | None, float | None, Tone]]:
        evidence = self._evidence
        stopped = self._fault_at if self._stops else evidence.own_stop_at or evidence.hindered_at
        if self._scenario != REFUSED:
            yield _ROBOT, evidence.contact_at, self._end_at if stopped is None else stopped, Tone.GOOD
        again = self._end_at if evidence.back_at is None else evidence.back_at
        yield _ROBOT, evidence.back_at, self._end_at, Tone.GOOD
        yield _ROBOT, stopped, again, Tone.BAD if evidence.own_stop and not self._stops else Tone.FAULT

    def _tool_bars(self) -> Iterator[tuple[str, float | None, float | None, Tone]]:
        evidence = self._evidence
        if not self._stops:
            last = self._end_at if evidence.moved_last_at is None else evidence.moved_last_at
            yield _TOOL, evidence.moved_at, last, Tone.GOOD
            return
        yield _TOOL, evidence.moved_at, self._zero_at, Tone.GOOD
        yield _TOOL, self._zero_at, evidence.moved_last_at, Tone.WARN
        if evidence.moved_after_m >= MOVED_M:
            yield _TOOL, self._zero_at + self._rules.react_s, evidence.moved_last_at, Tone.BAD


def _describe(one: Offender) -> str:
    """Describe an order, and what the robot did with it."""
    if one.offence is Offence.UNREADABLE:
        return f"{_OFFENCES[one.offence]}: {one.text}"
    step = f", a step of {concise(one.step_m, 1e3, '.2f', 'mm')}" if one.step_m else ""
    reaction = "accepts" if one.is_accepted else "does not execute"
    return f"{_OFFENCES[one.offence]}: {one.text}{step}; the robot {reaction} it"
