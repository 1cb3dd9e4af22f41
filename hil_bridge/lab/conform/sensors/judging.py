"""Verdicts on a sensor's client, by its readings alone: pure functions."""

from collections.abc import Callable, Iterator, Mapping

from hil_bridge.lab.conform.ending import describe_end
from hil_bridge.lab.conform.sensors.readings import Heard, difference, units
from hil_bridge.lab.conform.sensors.scenarios import LOST, RESTART, STATUS, SensorRules
from hil_bridge.lab.conform.trial import CUT, NOMINAL
from hil_bridge.lab.conform.verdict import Verdict, decide
from protocol.geometry import Wrench
from protocol.wrench import AXES

_FORCES = 3


def judge(scenario: str, heard: Heard, rules: SensorRules) -> Verdict:
    """The verdict on this evidence."""
    skipped = ""
    if heard.first_at is not None and scenario != NOMINAL and heard.fault_at is None:
        skipped = f"the client had ended after {heard.ended_at or 0.0:.1f} s, before the fault came; let it read longer"
    return decide(skipped, _find_faults(scenario, heard, rules), lambda: _WELL[scenario](heard))


def is_near(one: Wrench, other: Wrench, rules: SensorRules, times: float = 1.0) -> bool:
    """Whether two wrenches are the same by `times` the tolerance at rest."""
    return off_by(one, other, rules) <= times


def off_by(one: Wrench, other: Wrench, rules: SensorRules) -> float:
    """Largest difference of an axis, in tolerances at rest."""
    force, moment = max(rules.tolerance_n, 1e-12), max(rules.tolerance_nm, 1e-12)
    apart = [abs(part) for part in difference(one, other)]
    return max(max(apart[:_FORCES]) / force, max(apart[_FORCES:]) / moment)


def _find_faults(scenario: str, heard: Heard, rules: SensorRules) -> Iterator[str]:
    """All that is wrong, the gravest first."""
    if heard.first_at is None:
        crashed = not heard.told_to_end and heard.exit_code is not None
        yield f"told no reading: {describe_end(heard) if crashed else f'nothing in {rules.start_s:g} s'}"
        return
    yield from _OWN[scenario](heard, rules)
    if heard.no_numbers:
        yield f"told {heard.no_numbers} readings that are not numbers"
    if heard.crashed:
        yield f"crashed: {describe_end(heard)}"
    if heard.killed:
        yield f"did not end within {rules.end_s:g} s of being told to, and was killed"


def _of_nominal(heard: Heard, rules: SensorRules) -> Iterator[str]:
    if not heard.told_to_end:
        yield f"ended while it was to read: {describe_end(heard)}"
    at_rest, truth = heard.at_rest, heard.truth
    if at_rest is not None and truth is not None:
        zero: Wrench = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        if rules.takes_zero:
            if not is_near(at_rest, zero, rules):
                yield f"its reading at rest is no zero, as it declares: {_tell(at_rest)}"
        elif not is_near(at_rest, truth, rules) and not is_near(at_rest, zero, rules):
            yield f"its reading at rest is neither the load nor zero: {_tell(at_rest)} instead of {_tell(truth)}"
    for axis, change in heard.loads:
        if fault := _judge_load(axis, change, rules):
            yield fault


def _judge_load(axis: str, change: Wrench | None, rules: SensorRules) -> str:
    """The fault in how the load of an axis was read; empty for none."""
    number = AXES.index(axis)
    loads = (rules.force_n,) * _FORCES + (rules.moment_nm,) * _FORCES
    load, unit = loads[number], dict(units())[axis]
    if change is None:
        return f"told no reading while {axis} was loaded with {load:g} {unit}"
    bounds = [
        max(one * rules.tolerance_percent / 100.0, tolerance)
        for one, tolerance in zip(
            loads, (rules.tolerance_n,) * _FORCES + (rules.tolerance_nm,) * _FORCES, strict=True
        )
    ]
    meant = [load if k == number else 0.0 for k in range(len(AXES))]
    if all(abs(a - b) <= bound for a, b, bound in zip(change, meant, bounds, strict=True)):
        return ""
    return f"{load:g} {unit} on {axis} were told as {_tell_moved(change, bounds) or 'nothing'}"


def _tell_moved(change: Wrench, bounds: list[float]) -> str:
    """The axes that moved by more than their bounds, the farthest first."""
    moved = [
        (abs(part) / bound if bound else abs(part), f"{axis} {part:+.3g} {unit}")
        for (axis, unit), part, bound in zip(units(), change, bounds, strict=True)
        if abs(part) > bound
    ]
    return ", ".join(text for _, text in sorted(moved, reverse=True)[:_FORCES])


def _of_lost(heard: Heard, rules: SensorRules) -> Iterator[str]:
    if not heard.told_to_end:
        yield f"ended when some data were lost: {describe_end(heard)}"
    if not heard.behind_fault:
        yield "told no reading while some data were lost"
    at_rest = heard.at_rest
    if (
        at_rest is not None
        and heard.worst is not None
        and not is_near(heard.worst, at_rest, rules, rules.outlier)
    ):
        yield f"told a reading that was never sent: {_tell(heard.worst)} instead of {_tell(at_rest)}"


def _of_status(heard: Heard, rules: SensorRules) -> Iterator[str]:
    if heard.behind_fault:
        yield f"told {heard.behind_fault} readings as good while the sensor said that they are wrong"


def _of_cut(heard: Heard, rules: SensorRules) -> Iterator[str]:
    if heard.behind_fault:
        same = f", {heard.same_behind_fault} of them the last one before" if heard.same_behind_fault else ""
        yield f"told {heard.behind_fault} readings while the wire was cut{same}"
    yield from _back(heard, rules)


def _back(heard: Heard, rules: SensorRules) -> Iterator[str]:
    if rules.comes_back and heard.back_at is None:
        yield f"did not come back within {rules.back_s:g} s, as it declares: {describe_end(heard)}"
    at_rest = heard.at_rest
    if heard.at_end is not None and at_rest is not None and not is_near(heard.at_end, at_rest, rules):
        yield f"came back with another zero: {_tell(heard.at_end)} instead of {_tell(at_rest)}"


_OWN: Mapping[str, Callable[[Heard, SensorRules], Iterator[str]]] = {
    NOMINAL: _of_nominal,
    LOST: _of_lost,
    STATUS: _of_status,
    CUT: _of_cut,
    RESTART: _back,
}
"""Judges of what is a scenario's own."""


def _tell_readings(heard: Heard) -> str:
    span = (heard.last_at or 0.0) - (heard.first_at or 0.0)
    rate = f", {(heard.readings - 1) / span:.0f} a second" if span > 0.0 else ""
    return f"{heard.readings} readings{rate}; {describe_end(heard)}"


def _tell_return(heard: Heard) -> str:
    if heard.back_at is None or heard.returned_at is None:
        return f"told no reading behind it; {describe_end(heard)}"
    return f"read again {max(heard.back_at - heard.returned_at, 0.0):.2f} s behind its end; {describe_end(heard)}"


_WELL: Mapping[str, Callable[[Heard], str]] = {
    NOMINAL: _tell_readings,
    LOST: _tell_readings,
    STATUS: lambda heard: f"told no reading as good; {describe_end(heard)}",
    CUT: _tell_return,
    RESTART: _tell_return,
}
"""Reasons of those that passed."""


def _tell(wrench: Wrench) -> str:
    fx, fy, fz, mx, my, mz = wrench
    return f"({fx:.2f}, {fy:.2f}, {fz:.2f}) N ({mx:.3f}, {my:.3f}, {mz:.3f}) N·m"
