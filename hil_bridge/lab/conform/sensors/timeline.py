"""Time line of a scenario with a sensor: fault or loads, and the client's readings."""

from collections.abc import Iterator

from hil_bridge.lab.conform.ending import allowed_time, end_moments
from hil_bridge.lab.conform.sensors.judging import is_near, judge_load
from hil_bridge.lab.conform.sensors.readings import SensorEvidence
from hil_bridge.lab.conform.sensors.scenarios import LOST, RESTART, STATUS, SensorRules
from hil_bridge.lab.conform.trial import CUT
from hil_bridge.show.pages.timeline import Interval, Moment, TimeLine, Tone

_READINGS, _SENSOR = "readings of the client", "sensor"
_FAULTS = {
    LOST: "the sensor's data begin to be lost",
    STATUS: "the sensor reports its values as invalid",
    CUT: "the link is cut",
    RESTART: "the sensor loses its supply",
}


def sensor_timeline(scenario: str, evidence: SensorEvidence, rules: SensorRules) -> TimeLine:
    """Return the time line of a scenario, relative to its fault; without a fault, to the first load or reading."""
    begins = (evidence.fault_at, *evidence.loaded_at, evidence.first_at)
    zero_at = next((at for at in begins if at is not None), 0.0)
    zero = "the fault" if evidence.fault_at is not None else "the first load"
    if evidence.fault_at is None and not evidence.loaded_at:
        zero = "the power-up" if evidence.first_at is None else "the first reading"
    moments = [
        Moment(at - zero_at, text, tone)
        for at, text, tone in (*_fault(scenario, evidence, rules), *_loads(evidence, rules))
        if at is not None
    ]
    moments += [Moment(one.at - zero_at, one.text, one.tone) for one in end_moments(evidence, rules.end_s)]
    intervals = [
        Interval(lane, begin - zero_at, end - zero_at, tone)
        for lane, begin, end, tone in _bars(scenario, evidence, rules)
        if begin is not None and end is not None and end >= begin
    ]
    if scenario in (STATUS, CUT) and evidence.fault_at is not None:
        intervals.append(allowed_time(evidence.fault_at - zero_at, rules.react_s))
    return TimeLine(moments, intervals, zero)


def _fault(
    scenario: str, evidence: SensorEvidence, rules: SensorRules
) -> Iterator[tuple[float | None, str, Tone]]:
    yield evidence.first_at, "first reading", Tone.GOOD
    yield evidence.fault_at, _FAULTS.get(scenario, "the fault"), Tone.FAULT
    yield evidence.last_before_fault_at, "last good reading before the fault", Tone.GOOD
    if scenario in (STATUS, CUT) and evidence.fault_at is not None:
        yield (
            evidence.behind_at,
            f"first of {evidence.behind_fault} readings after the time to react",
            Tone.BAD,
        )
    worst, at_rest = evidence.worst, evidence.at_rest
    if scenario == LOST and worst and at_rest and not is_near(worst, at_rest, rules, rules.outlier):
        yield evidence.worst_at, "reading that was never sent", Tone.BAD
    yield evidence.returned_at, "the fault ends", Tone.PLAIN
    yield evidence.back_at, "first reading after it", Tone.GOOD


def _loads(evidence: SensorEvidence, rules: SensorRules) -> Iterator[tuple[float | None, str, Tone]]:
    for at, (axis, change) in zip(evidence.loaded_at, evidence.loads, strict=False):
        fault = judge_load(axis, change, rules)
        yield at, fault or f"load on {axis}, reported correctly", Tone.BAD if fault else Tone.GOOD


def _bars(
    scenario: str, evidence: SensorEvidence, rules: SensorRules
) -> Iterator[tuple[str, float | None, float | None, Tone]]:
    """Yield lane, begin, end and tone of the intervals."""
    fault_at = evidence.fault_at
    is_silent = fault_at is not None and scenario in (STATUS, CUT)
    yield _READINGS, evidence.first_at, fault_at if is_silent else evidence.last_at, Tone.GOOD
    yield _READINGS, evidence.back_at, evidence.last_at, Tone.GOOD
    for at, (axis, change) in zip(evidence.loaded_at, evidence.loads, strict=False):
        yield _SENSOR, at, at + rules.load_s, Tone.BAD if judge_load(axis, change, rules) else Tone.GOOD
    if fault_at is None:
        return
    ends = (evidence.returned_at, evidence.ended_at, fault_at + rules.watch_s)
    end_at = min(at for at in ends if at is not None)
    yield _SENSOR, fault_at, end_at, Tone.FAULT
    if is_silent:
        yield _READINGS, evidence.behind_at, end_at, Tone.BAD
