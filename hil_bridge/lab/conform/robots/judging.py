"""Verdicts on a robot client: pure functions of the evidence."""

import math
from collections.abc import Callable, Iterator, Mapping

from hil_bridge.lab.conform.ending import describe_end
from hil_bridge.lab.conform.robots.scenarios import (
    EMERGENCY,
    LATE,
    MOVED_M,
    MOVED_RAD,
    REFUSED,
    STOPPED,
    Rules,
)
from hil_bridge.lab.conform.robots.watching import RobotEvidence
from hil_bridge.lab.conform.trial import CUT, NOMINAL
from hil_bridge.lab.conform.verdict import Verdict, decide
from hil_bridge.record.analysis.definition import concise


def judge(scenario: str, evidence: RobotEvidence, rules: Rules) -> Verdict:
    """Return the verdict on this evidence."""
    faults = _find_faults(scenario, evidence, rules)
    return decide(_explain_skip(scenario, evidence), faults, lambda: _SUMMARIES[scenario](evidence))


def _explain_skip(scenario: str, evidence: RobotEvidence) -> str:
    """Return the reason why the scenario did not reach its fault; empty if it did."""
    if (
        scenario != REFUSED
        and evidence.moved_at is None
        and not evidence.moving
        and evidence.refusals
        and not evidence.crashed
    ):
        return (
            f"the client ordered no motion that can be judged; this emulated robot does not support: "
            f"{'; '.join(evidence.refusals[:3])}"
        )
    if scenario in (NOMINAL, REFUSED) or evidence.fault_at is not None or _has_failed_early(evidence):
        return ""
    if evidence.moved_at is None:
        return f"the tool did not move, so the fault could not occur during motion; {describe_end(evidence)}"
    return f"the client ended after {evidence.ended_at or 0.0:.1f} s, before the fault; let it move longer"


def _has_failed_early(evidence: RobotEvidence) -> bool:
    """Return whether the client failed by itself before the fault. Such a scenario fails instead of being skipped."""
    return evidence.fault_at is None and not evidence.end_requested and evidence.exit_code not in (0, None)


def _find_faults(scenario: str, evidence: RobotEvidence, rules: Rules) -> Iterator[str]:
    """Yield all problems of the client, most serious first."""
    if scenario not in (NOMINAL, REFUSED) and _has_failed_early(evidence) and not evidence.crashed:
        yield f"failed by itself before the fault: {describe_end(evidence)}"
    yield from _OWN[scenario](evidence, rules)
    if evidence.own_stop and scenario not in (NOMINAL, LATE):
        yield f"its orders stopped the robot: {evidence.own_stop}"
    yield from _find_haste(evidence, rules)
    if scenario != NOMINAL and evidence.crashed:
        yield f"crashed: {describe_end(evidence)}"
    if evidence.left_m_s > 0.0:
        yield f"left the tool moving at {concise(evidence.left_m_s, 1e3, '.1f', 'mm/s')}"
    elif evidence.left_rad_s > 0.0:
        yield f"left the tool rotating at {math.degrees(evidence.left_rad_s):.1f} °/s"
    if evidence.killed:
        yield f"did not terminate within {rules.end_s:g} s of the request, and was killed"


def _find_haste(evidence: RobotEvidence, rules: Rules) -> Iterator[str]:
    """Yield steps, rotations, speeds and accelerations beyond the rules. If a rule is 0, the limit of the robot
    applies.
    """
    step_mm, turn_deg = evidence.largest_step_m * 1e3, math.degrees(evidence.largest_turn_rad)
    if rules.max_step_mm:
        if step_mm > rules.max_step_mm:
            yield f"a step of {concise(step_mm, 1, '.2f', 'mm')} between two orders, allowed: {rules.max_step_mm:g} mm"
    elif evidence.leaps:
        yield f"{evidence.leaps} of its orders leap, by up to {concise(step_mm, 1, '.1f', 'mm')}"
    if rules.max_turn_deg:
        if turn_deg > rules.max_turn_deg:
            yield f"a rotation of {turn_deg:.2f}° between two orders, allowed: {rules.max_turn_deg:g}°"
    elif evidence.turns:
        why = "; the w of its quaternion seems to be at the wrong end" if evidence.w_misplaced else ""
        yield f"{evidence.turns} of its orders rotate the tool abruptly, by up to {turn_deg:.1f}°{why}"
    if rules.max_speed_mm_s:
        if evidence.fastest_m_s * 1e3 > rules.max_speed_mm_s:
            speed = concise(evidence.fastest_m_s, 1e3, ".1f", "mm/s")
            yield f"the tool moved at {speed}, allowed: {rules.max_speed_mm_s:g} mm/s"
    elif evidence.rushes:
        speed = concise(evidence.largest_speed_m_s, 1e3, ".1f", "mm/s")
        yield f"{evidence.rushes} of its orders exceed the robot's speed, with up to {speed}"
    if gains_speed(evidence, rules):
        limit_mm_s = (evidence.robot_speed_m_s or 0.0) * 1e3
        yield (
            f"the tool's speed changed by {evidence.largest_gain_m_s * 1e3:.0f} mm/s within "
            f"{rules.speed_up_s * 1e3:g} ms, more than the robot's top speed of {limit_mm_s:g} mm/s"
        )


def gains_speed(evidence: RobotEvidence, rules: Rules) -> bool:
    """Return whether the tool's speed changed within `speed_up_s` by more than the robot's top speed."""
    limit = evidence.robot_speed_m_s
    return bool(rules.speed_up_s) and limit is not None and evidence.largest_gain_m_s > limit


def _of_nominal(evidence: RobotEvidence, rules: Rules) -> Iterator[str]:
    if evidence.contact_at is None:
        crashed = not evidence.end_requested and evidence.exit_code is not None
        yield f"never connected: {describe_end(evidence) if crashed else f'nothing in {rules.start_s:g} s'}"
        return
    if not evidence.end_requested and evidence.exit_code not in (0, None):
        yield f"failed by itself: {describe_end(evidence)}"
    if evidence.unreadable:
        yield f"sent unreadable data {_times(evidence.unreadable)}; first {evidence.first_unreadable}"
    if evidence.breaches > evidence.orders * rules.breaches_percent / 100.0:
        yield (
            f"{evidence.breaches} of its {evidence.orders} orders violate the protocol, "
            f"such as {evidence.first_breach}"
        )
    if evidence.moved_at is None:
        yield (
            f"none of its {evidence.orders} orders moved the tool"
            if evidence.orders
            else "it ordered no motion"
        )
    if evidence.hindrance:
        yield f"the robot stopped: {evidence.hindrance}"
    if rules.ends and evidence.end_requested:
        yield f"did not end by itself within {rules.run_s:g} s, as declared"


def _of_late(evidence: RobotEvidence, rules: Rules) -> Iterator[str]:
    if evidence.own_stop:
        yield f"its orders stopped the robot: {evidence.own_stop}"


def _of_refused(evidence: RobotEvidence, rules: Rules) -> Iterator[str]:
    yield from _orders_after_stop(evidence, rules, "to a robot that could not move, after", "the first")
    if not evidence.releases and (motion := _describe_motion(evidence.moved_m, evidence.turned_rad)):
        yield motion


def _of_stop(evidence: RobotEvidence, rules: Rules) -> Iterator[str]:
    yield from _orders_after_stop(evidence, rules, "after the stop and", "the stop")
    if evidence.releases:
        yield f"released the stop without an operator: {', '.join(dict.fromkeys(evidence.releases))}"
    if motion := _describe_motion(evidence.moved_after_m, evidence.turned_after_rad):
        yield f"{motion} after the stop"


def _describe_motion(moved_m: float, turned_rad: float) -> str:
    """Describe how far the tool moved and rotated; empty if it did not move."""
    parts = [f"moved by {concise(moved_m, 1e3, '.1f', 'mm')}"] if moved_m >= MOVED_M else []
    parts += [f"rotated by {math.degrees(turned_rad):.1f}°"] if turned_rad >= MOVED_RAD else []
    return f"the tool {' and '.join(parts)}" if parts else ""


def _of_cut(evidence: RobotEvidence, rules: Rules) -> Iterator[str]:
    if rules.comes_back and evidence.back_at is None:
        yield f"did not reconnect within {rules.back_s:g} s, as declared: {describe_end(evidence)}"


def _orders_after_stop(evidence: RobotEvidence, rules: Rules, where: str, begin: str) -> Iterator[str]:
    if evidence.after_stop:
        yield (
            f"sent {evidence.after_stop} motion orders {where} the {rules.react_s * 1e3:g} ms allowed to react: "
            f"the last {evidence.last_motion_s or 0.0:.2f} s after {begin}, "
            f"steps of up to {concise(evidence.after_stop_step_m, 1e3, '.2f', 'mm')}"
        )


_OWN: Mapping[str, Callable[[RobotEvidence, Rules], Iterator[str]]] = {
    NOMINAL: _of_nominal,
    LATE: _of_late,
    REFUSED: _of_refused,
    STOPPED: _of_stop,
    EMERGENCY: _of_stop,
    CUT: _of_cut,
}
"""Checks that are specific to a scenario, by its name."""


def _describe_result(evidence: RobotEvidence) -> str:
    return (
        f"moved {concise(evidence.moved_m, 1e3, '.1f', 'mm')} and rotated {math.degrees(evidence.turned_rad):.1f}° "
        f"in {evidence.orders} orders{_pace(evidence)}, at most {concise(evidence.fastest_m_s, 1e3, '.1f', 'mm/s')}; "
        f"longest pause {evidence.longest_pause_s * 1e3:.0f} ms; {describe_end(evidence)}"
    )


def _pace(evidence: RobotEvidence) -> str:
    """Describe the period of the orders; empty if the period is unknown."""
    if evidence.orders < 2 or evidence.first_order_at is None or evidence.last_order_at is None:
        return ""
    return f", one every {(evidence.last_order_at - evidence.first_order_at) / (evidence.orders - 1) * 1e3:.1f} ms"


def _describe_reaction(evidence: RobotEvidence, begin: str = "stop") -> str:
    if evidence.orders == 0:
        return f"ordered no motion; {describe_end(evidence)}"
    last = (
        ""
        if evidence.last_motion_s is None
        else f", the last with motion {evidence.last_motion_s * 1e3:.0f} ms after the {begin}"
    )
    return f"{evidence.orders} orders{last}; {describe_end(evidence)}"


def _describe_reconnection(evidence: RobotEvidence) -> str:
    if evidence.back_at is None or evidence.returned_at is None:
        return f"did not reconnect, and left the tool stationary; {describe_end(evidence)}"
    return (
        f"resumed its orders {evidence.back_at - evidence.returned_at:.2f} s after the end of the cut; "
        f"{describe_end(evidence)}"
    )


_SUMMARIES: Mapping[str, Callable[[RobotEvidence], str]] = {
    NOMINAL: _describe_result,
    LATE: _describe_result,
    REFUSED: lambda seen: _describe_reaction(seen, "first"),
    STOPPED: _describe_reaction,
    EMERGENCY: _describe_reaction,
    CUT: _describe_reconnection,
}
"""Functions that summarise a passed scenario, by its name."""


def _times(count: int) -> str:
    return "once" if count == 1 else f"{count} times"
