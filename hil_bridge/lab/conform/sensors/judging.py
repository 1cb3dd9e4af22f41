"""Verdicts on a sensor client: pure functions of its readings."""

from collections.abc import Callable, Iterator, Mapping

from hil_bridge.lab.conform.ending import describe_end
from hil_bridge.lab.conform.sensors.readings import SensorEvidence, difference, units
from hil_bridge.lab.conform.sensors.scenarios import LOST, RESTART, STATUS, SensorRules
from hil_bridge.lab.conform.trial import CUT, NOMINAL
from hil_bridge.lab.conform.verdict import Verdict, decide
from protocol.geometry import Wrench
from protocol.wrench import AXES

_FORCES = 3


def judge(scenario: str, evidence: SensorEvidence, rules: SensorRules) -> Verdict:
    """Return the verdict on this evidence."""
    skipped = ""
    if evidence.first_at is not None and scenario != NOMINAL and evidence.fault_at is None:
        skipped = (
            f"the client ended after {evidence.ended_at or 0.0:.1f} s, before the fault; let it read longer"
        )
    return decide(skipped, _find_faults(scenario, evidence, rules), lambda: _SUMMARIES[scenario](evidence))


def is_near(one: Wrench, other: Wrench, rules: SensorRules, times: float = 1.0) -> bool:
    """Return whether two wrenches agree within `times` times the tolerance of an unloaded reading."""
    return off_by(one, other, rules) <= times


def off_by(one: Wrench, other: Wrench, rules: SensorRules) -> float:
    """Return the largest difference of any axis, as a multiple of the tolerance of an unloaded reading."""
    force, moment = max(rules.tolerance_n, 1e-12), max(rules.tolerance_nm, 1e-12)
    apart = [abs(part) for part in difference(one, other)]
    return max(max(apart[:_FORCES]) / force, max(apart[_FORCES:]) / moment)


def _find_faults(scenario: str, evidence: SensorEvidence, rules: SensorRules) -> Iterator[str]:
    """Yield all problems of the client, most serious first."""
    if evidence.first_at is None:
        crashed = not evidence.end_requested and evidence.exit_code is not None
        yield f"reported no reading: {describe_end(evidence) if crashed else f'nothing in {rules.start_s:g} s'}"
        return
    yield from _OWN[scenario](evidence, rules)
    if evidence.no_numbers:
        yield f"reported {evidence.no_numbers} readings that are not numbers"
    if evidence.crashed:
        yield f"crashed: {describe_end(evidence)}"
    if evidence.killed:
        yield f"did not terminate within {rules.end_s:g} s of the request, and was killed"


def _of_nominal(evidence: SensorEvidence, rules: SensorRules) -> Iterator[str]:
    if not evidence.end_requested:
        yield f"ended before it was asked to: {describe_end(evidence)}"
    at_rest, truth = evidence.at_rest, evidence.truth
    if at_rest is not None and truth is not None:
        zero: Wrench = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        if rules.takes_zero:
            if not is_near(at_rest, zero, rules):
                yield f"its unloaded reading is not zero, as declared: {_format(at_rest)}"
        elif not is_near(at_rest, truth, rules) and not is_near(at_rest, zero, rules):
            yield f"its unloaded reading is neither the load nor zero: {_format(at_rest)} instead of {_format(truth)}"
    for axis, change in evidence.loads:
        if fault := judge_load(axis, change, rules):
            yield fault


def judge_load(axis: str, change: Wrench | None, rules: SensorRules) -> str:
    """Describe the error in the reading of a load on an axis; empty if the reading is correct."""
    number = AXES.index(axis)
    loads = (rules.force_n,) * _FORCES + (rules.moment_nm,) * _FORCES
    load, unit = loads[number], dict(units())[axis]
    if change is None:
        return f"reported no reading while {axis} was loaded with {load:g} {unit}"
    bounds = [
        max(one * rules.tolerance_percent / 100.0, tolerance)
        for one, tolerance in zip(
            loads, (rules.tolerance_n,) * _FORCES + (rules.tolerance_nm,) * _FORCES, strict=True
        )
    ]
    meant = [load if k == number else 0.0 for k in range(len(AXES))]
    if all(abs(a - b) <= bound for a, b, bound in zip(change, meant, bounds, strict=True)):
        return ""
    return f"{load:g} {unit} on {axis} were reported as {_format_changes(change, bounds) or 'nothing'}"


def _format_changes(change: Wrench, bounds: list[float]) -> str:
    """Format the axes that changed by more than their bounds, largest change first."""
    changes = [
        (abs(part) / bound if bound else abs(part), f"{axis} {part:+.3g} {unit}")
        for (axis, unit), part, bound in zip(units(), change, bounds, strict=True)
        if abs(part) > bound
    ]
    return ", ".join(text for _, text in sorted(changes, reverse=True)[:_FORCES])


def _of_lost(evidence: SensorEvidence, rules: SensorRules) -> Iterator[str]:
    if not evidence.end_requested:
        yield f"ended when some data were lost: {describe_end(evidence)}"
    if not evidence.behind_fault:
        yield "reported no reading while some data were lost"
    at_rest = evidence.at_rest
    if (
        at_rest is not None
        and evidence.worst is not None
        and not is_near(evidence.worst, at_rest, rules, rules.outlier)
    ):
        yield f"reported a reading that was never sent: {_format(evidence.worst)} instead of {_format(at_rest)}"


def _of_status(evidence: SensorEvidence, rules: SensorRules) -> Iterator[str]:
    if evidence.behind_fault:
        yield f"reported {evidence.behind_fault} readings as valid while the sensor reported them as invalid"


def _of_cut(evidence: SensorEvidence, rules: SensorRules) -> Iterator[str]:
    if evidence.behind_fault:
        same = (
            f", {evidence.same_behind_fault} of them equal to the last one"
            if evidence.same_behind_fault
            else ""
        )
        yield f"reported {evidence.behind_fault} readings while the link was cut{same}"
    yield from _back(evidence, rules)


def _back(evidence: SensorEvidence, rules: SensorRules) -> Iterator[str]:
    if rules.comes_back and evidence.back_at is None:
        yield f"did not reconnect within {rules.back_s:g} s, as declared: {describe_end(evidence)}"
    at_rest = evidence.at_rest
    if evidence.at_end is not None and at_rest is not None and not is_near(evidence.at_end, at_rest, rules):
        yield f"reconnected with another zero: {_format(evidence.at_end)} instead of {_format(at_rest)}"


_OWN: Mapping[str, Callable[[SensorEvidence, SensorRules], Iterator[str]]] = {
    NOMINAL: _of_nominal,
    LOST: _of_lost,
    STATUS: _of_status,
    CUT: _of_cut,
    RESTART: _back,
}
"""Checks that are specific to a scenario, by its name."""


def _describe_readings(evidence: SensorEvidence) -> str:
    span = (evidence.last_at or 0.0) - (evidence.first_at or 0.0)
    rate = f", {(evidence.readings - 1) / span:.0f} a second" if span > 0.0 else ""
    return f"{evidence.readings} readings{rate}; {describe_end(evidence)}"


def _describe_return(evidence: SensorEvidence) -> str:
    if evidence.back_at is None or evidence.returned_at is None:
        return f"reported no reading after it; {describe_end(evidence)}"
    return f"resumed {max(evidence.back_at - evidence.returned_at, 0.0):.2f} s after its end; {describe_end(evidence)}"


_SUMMARIES: Mapping[str, Callable[[SensorEvidence], str]] = {
    NOMINAL: _describe_readings,
    LOST: _describe_readings,
    STATUS: lambda heard: f"reported no reading as valid; {describe_end(heard)}",
    CUT: _describe_return,
    RESTART: _describe_return,
}
"""Functions that summarise a passed scenario, by its name."""


def _format(wrench: Wrench) -> str:
    fx, fy, fz, mx, my, mz = wrench
    return f"({fx:.2f}, {fy:.2f}, {fz:.2f}) N ({mx:.3f}, {my:.3f}, {mz:.3f}) N·m"
