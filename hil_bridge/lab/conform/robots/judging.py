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


def judge(scenario: str, seen: RobotEvidence, rules: Rules) -> Verdict:
    """Return the verdict on this evidence."""
    faults = _find_faults(scenario, seen, rules)
    return decide(_explain_skip(scenario, seen), faults, lambda: _SUMMARIES[scenario](seen))


def _explain_skip(scenario: str, seen: RobotEvidence) -> str:
    """Return why the scenario did not reach its fault; empty if it did."""
    if (
        scenario != REFUSED
        and seen.moved_at is None
        and not seen.moving
        and seen.refusals
        and not seen.crashed
    ):
        return (
            f"the client ordered no motion that can be judged; this emulated robot does not support: "
            f"{'; '.join(seen.refusals[:3])}"
        )
    if scenario in (NOMINAL, REFUSED) or seen.fault_at is not None or _failed_early(seen):
        return ""
    if seen.moved_at is None:
        return f"the tool did not move, so the fault could not occur during motion; {describe_end(seen)}"
    return f"the client ended after {seen.ended_at or 0.0:.1f} s, before the fault; let it move longer"


def _failed_early(seen: RobotEvidence) -> bool:
    """Return whether the client failed by itself before the fault, which is no reason to skip."""
    return seen.fault_at is None and not seen.told_to_end and seen.exit_code not in (0, None)


def _find_faults(scenario: str, seen: RobotEvidence, rules: Rules) -> Iterator[str]:
    """Yield all problems, the most serious first."""
    if scenario not in (NOMINAL, REFUSED) and _failed_early(seen) and not seen.crashed:
        yield f"failed by itself before the fault: {describe_end(seen)}"
    yield from _OWN[scenario](seen, rules)
    if seen.own_stop and scenario not in (NOMINAL, LATE):
        yield f"its orders stopped the robot: {seen.own_stop}"
    yield from _find_haste(seen, rules)
    if scenario != NOMINAL and seen.crashed:
        yield f"crashed: {describe_end(seen)}"
    if seen.left_m_s > 0.0:
        yield f"left the tool moving at {seen.left_m_s * 1e3:.1f} mm/s"
    elif seen.left_rad_s > 0.0:
        yield f"left the tool rotating at {math.degrees(seen.left_rad_s):.1f} °/s"
    if seen.killed:
        yield f"did not terminate within {rules.end_s:g} s of the request, and was killed"


def _find_haste(seen: RobotEvidence, rules: Rules) -> Iterator[str]:
    """Yield steps, rotations, speeds and accelerations beyond the rules; if a rule is 0, beyond the robot's limits."""
    step_mm, turn_deg = seen.largest_step_m * 1e3, math.degrees(seen.largest_turn_rad)
    if rules.max_step_mm:
        if step_mm > rules.max_step_mm:
            yield f"a step of {step_mm:.2f} mm between two orders, allowed: {rules.max_step_mm:g} mm"
    elif seen.leaps:
        yield f"{seen.leaps} of its orders leap, by up to {step_mm:.1f} mm"
    if rules.max_turn_deg:
        if turn_deg > rules.max_turn_deg:
            yield f"a rotation of {turn_deg:.2f}° between two orders, allowed: {rules.max_turn_deg:g}°"
    elif seen.turns:
        why = "; the w of its quaternion seems to be at the wrong end" if seen.w_misplaced else ""
        yield f"{seen.turns} of its orders rotate the tool abruptly, by up to {turn_deg:.1f}°{why}"
    ordered, gone = seen.largest_speed_m_s * 1e3, seen.fastest_m_s * 1e3
    if rules.max_speed_mm_s:
        if gone > rules.max_speed_mm_s:
            yield f"the tool moved at {gone:.1f} mm/s, allowed: {rules.max_speed_mm_s:g} mm/s"
    elif seen.rushes:
        yield f"{seen.rushes} of its orders exceed the robot's speed, with up to {ordered:.1f} mm/s"
    limit = seen.robot_speed_m_s
    if rules.speed_up_s and limit is not None and seen.largest_gain_m_s > limit:
        yield (
            f"the tool's speed changed by {seen.largest_gain_m_s * 1e3:.0f} mm/s within {rules.speed_up_s * 1e3:g} ms, "
            f"more than the robot's top speed of {limit * 1e3:g} mm/s"
        )


def _of_nominal(seen: RobotEvidence, rules: Rules) -> Iterator[str]:
    if seen.contact_at is None:
        crashed = not seen.told_to_end and seen.exit_code is not None
        yield f"never connected: {describe_end(seen) if crashed else f'nothing in {rules.start_s:g} s'}"
        return
    if not seen.told_to_end and seen.exit_code not in (0, None):
        yield f"failed by itself: {describe_end(seen)}"
    if seen.unreadable:
        yield f"sent unreadable data {_times(seen.unreadable)}; first {seen.first_unreadable}"
    if seen.breaches > seen.orders * rules.breaches_percent / 100.0:
        yield f"{seen.breaches} of its {seen.orders} orders violate the protocol, such as {seen.first_breach}"
    if seen.moved_at is None:
        yield f"none of its {seen.orders} orders moved the tool" if seen.orders else "it ordered no motion"
    if seen.hindrance:
        yield f"the robot stopped: {seen.hindrance}"
    if rules.ends and seen.told_to_end:
        yield f"did not end by itself within {rules.run_s:g} s, as declared"


def _of_late(seen: RobotEvidence, rules: Rules) -> Iterator[str]:
    if seen.own_stop:
        yield f"its orders stopped the robot: {seen.own_stop}"


def _of_refused(seen: RobotEvidence, rules: Rules) -> Iterator[str]:
    yield from _sent_on(seen, rules, "to a robot that could not move", "the first")
    if not seen.releases and (moved := _describe_motion(seen.moved_m, seen.turned_rad)):
        yield moved


def _of_stop(seen: RobotEvidence, rules: Rules) -> Iterator[str]:
    yield from _sent_on(seen, rules, "after the stop", "the stop")
    if seen.releases:
        yield f"released the stop without an operator: {', '.join(dict.fromkeys(seen.releases))}"
    if moved := _describe_motion(seen.moved_after_m, seen.turned_after_rad):
        yield f"{moved} after the stop"


def _describe_motion(moved_m: float, turned_rad: float) -> str:
    """Describe how far the tool moved and rotated; empty if it did neither."""
    parts = [f"moved by {moved_m * 1e3:.1f} mm"] if moved_m >= MOVED_M else []
    parts += [f"rotated by {math.degrees(turned_rad):.1f}°"] if turned_rad >= MOVED_RAD else []
    return f"the tool {' and '.join(parts)}" if parts else ""


def _of_cut(seen: RobotEvidence, rules: Rules) -> Iterator[str]:
    if rules.comes_back and seen.back_at is None:
        yield f"did not reconnect within {rules.back_s:g} s, as declared: {describe_end(seen)}"


def _sent_on(seen: RobotEvidence, rules: Rules, where: str, begin: str) -> Iterator[str]:
    if seen.after_stop:
        yield (
            f"sent {seen.after_stop} motion orders {where} and the {rules.react_s * 1e3:g} ms to react: "
            f"the last {seen.last_motion_s or 0.0:.2f} s after {begin}, "
            f"steps of up to {seen.after_stop_step_m * 1e3:.2f} mm"
        )


_OWN: Mapping[str, Callable[[RobotEvidence, Rules], Iterator[str]]] = {
    NOMINAL: _of_nominal,
    LATE: _of_late,
    REFUSED: _of_refused,
    STOPPED: _of_stop,
    EMERGENCY: _of_stop,
    CUT: _of_cut,
}
"""Scenario-specific checks."""


def _moved(seen: RobotEvidence) -> str:
    return (
        f"moved {seen.moved_m * 1e3:.1f} mm and rotated {math.degrees(seen.turned_rad):.1f}° "
        f"in {seen.orders} orders{_pace(seen)}, at most {seen.fastest_m_s * 1e3:.1f} mm/s; "
        f"longest pause {seen.longest_pause_s * 1e3:.0f} ms; {describe_end(seen)}"
    )


def _pace(seen: RobotEvidence) -> str:
    """Describe the period of the orders; empty if it is unknown."""
    if seen.orders < 2 or seen.first_order_at is None or seen.last_order_at is None:
        return ""
    return f", one every {(seen.last_order_at - seen.first_order_at) / (seen.orders - 1) * 1e3:.1f} ms"


def _held_back(seen: RobotEvidence, begin: str = "stop") -> str:
    if seen.orders == 0:
        return f"ordered no motion; {describe_end(seen)}"
    last = (
        ""
        if seen.last_motion_s is None
        else f", the last with motion {seen.last_motion_s * 1e3:.0f} ms after the {begin}"
    )
    return f"{seen.orders} orders{last}; {describe_end(seen)}"


def _came_back(seen: RobotEvidence) -> str:
    if seen.back_at is None or seen.returned_at is None:
        return f"did not reconnect, and left the tool stationary; {describe_end(seen)}"
    return f"resumed its orders {seen.back_at - seen.returned_at:.2f} s after the end of the cut; {describe_end(seen)}"


_SUMMARIES: Mapping[str, Callable[[RobotEvidence], str]] = {
    NOMINAL: _moved,
    LATE: _moved,
    REFUSED: lambda seen: _held_back(seen, "first"),
    STOPPED: _held_back,
    EMERGENCY: _held_back,
    CUT: _came_back,
}
"""Summaries of passed scenarios."""


def _times(count: int) -> str:
    return "once" if count == 1 else f"{count} times"
