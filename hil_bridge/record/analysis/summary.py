"""Summary of a run, from its record alone: figures of merit, durations, times and counters."""

import math
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import msgspec

from hil_bridge.control.analysis.merit import STEADY_SAMPLES
from hil_bridge.errors.causes import Cause, Reason
from hil_bridge.errors.event_kinds import EventKind
from hil_bridge.record.analysis.answers import answers_of
from hil_bridge.record.analysis.contact import contact_figures
from hil_bridge.record.analysis.figures import MERIT
from hil_bridge.record.analysis.latency import latency_of
from hil_bridge.record.analysis.steps import StepOutcome, step_outcomes
from hil_bridge.record.analysis.strokes import TRACK, merit_of, strokes_of
from hil_bridge.record.analysis.times import Times, times_of
from hil_bridge.record.device_facts import devices_of, json_or_none
from hil_bridge.record.ending import Outcome, RunEnd, followed_of, reason_of
from hil_bridge.record.files import write_whole
from hil_bridge.record.reader import Recording
from hil_bridge.record.recorder import DROPPED_PREFIX
from hil_bridge.record.records import CycleRecord
from hil_bridge.record.topics import SENSOR, TOPICS

RETRACT = "retract"
"""The phase in which the tool is pulled back."""
UNTOLD = "not told"
"""Outcome of a recording that tells none, as a bag of ROS 2."""


@dataclass(frozen=True, slots=True)
class PhaseSpan:
    """A stretch of a run; times in s on the run's clock."""

    name: str
    begin: float
    end: float


@dataclass(frozen=True, slots=True)
class Summary:
    """A run in figures. None stands for what the run did not show."""

    outcome: str
    cause: str
    """Row of the table of causes; empty for a run that went to its end."""
    text: str
    """The cause in words."""
    late_s: float
    """Longest time by which the computer was late in the second before the cause, s; 0 where it was in time."""
    followed: tuple[str, ...]
    """Events after the cause, in order."""
    left: str
    """Place at which the tool was left, in words; empty when it never moved or the record was cut off before."""
    truncated: bool
    """The record ends early: the figures cover what is there."""
    checks: tuple[str, ...]
    """Findings about the sensor before the touch, in words, and the reading that was taken for zero."""
    controller: str
    seed: str
    force_reference_n: float | None
    """None where it varied."""
    force_references_n: tuple[float, float] | None
    """The least and the largest."""
    force_mean_steady_n: float | None
    """Mean force over the last 40 samples of tracking; None when there are fewer since the rise, and where the wanted
    force varied in them.
    """
    strokes: int
    """Stretches of tracking, each from a touch until the tool is taken away."""
    figures: Mapping[str, float | None]
    """Figures of merit of the tracking phase, by the keys of `analysis.figures`. The sample that stopped it counts for
    the largest force and the overshoot. Of several strokes: the slowest rise, the steady state of the last, else over
    all.
    """
    contact: Mapping[str, float | None]
    """Figures of the contact, by the keys of `analysis.figures`: of the samples whose force is above 1 N, or above the
    threshold with which a bag was read.
    """
    phases_s: Mapping[str, float]
    """Duration by phase, in order of first appearance."""
    cycles: int
    cycles_clamped: int
    cycles_held: int
    cycle_rate_hz: float | None
    cycle_time: Times | None
    """Time of a cycle: from its begin until the robot has taken the order."""
    line_floor_s: float | None
    sensor_frames_received: int
    sensor_frames_lost: int | None
    """Frames that never came; None when the record was cut off before its end."""
    recorder_dropped: Mapping[str, int]
    """Records that did not reach the file, by topic."""
    link: Mapping[str, float]
    """Counters of the links."""
    latency: Mapping[str, Mapping[str, float]]
    """Distribution of each hop between a force and the motion that answers it, ms; empty when it was not stamped."""
    latency_largest: str
    """Which hop takes most of it, in words."""
    latency_sentence: str
    """The whole of it in one line."""
    answers: Mapping[str, float]
    """Time of the answers to a robot that drives the cycle, ms; empty for one that is asked."""
    answers_sentence: str
    """The same in one line, with the number of those that came late."""
    steps: tuple[StepOutcome, ...] = ()
    """Steps of a program that have ended, oldest first."""
    criteria_failed: tuple[str, ...] = ()
    """Labels of the steps whose criterion was not met."""

    def as_json(self) -> str:
        """Return the summary as JSON, strict and in the order of the fields."""
        return msgspec.json.format(msgspec.json.encode(self), indent=2).decode() + "\n"

    def write_json(self, path: Path, overwrite: bool = False) -> None:
        """Write the file at once, so that a reader never sees half of it. Raises ConfigError as `write_whole`."""
        write_whole(path, self.as_json().encode(), overwrite)


def summarise(recording: Recording, end: RunEnd | None = None) -> Summary:
    """Return the figures of a run. `end` is read from the record if it is not given."""
    end = end or end_of(recording)
    cycles = recording.cycles
    strokes = strokes_of(recording)
    dropped = _read_dropped(recording)
    robot = devices_of(recording).robot
    figures = _figures(
        strokes, _stopping(cycles) if end.outcome is Outcome.STOPPED else None, robot.position_step_m
    )
    steady = figures.get("steady_mean_error_n") is not None
    tracked = [cycle for stroke in strokes for cycle in stroke]
    references = [
        cycle.force_reference for cycle in tracked or cycles if not math.isnan(cycle.force_reference)
    ]
    tail = strokes[-1][-STEADY_SAMPLES:] if strokes else []
    steady = steady and len({cycle.force_reference for cycle in tail}) == 1
    spans = phases(recording)
    latency, answers = latency_of(recording), answers_of(cycles, robot, end.link)
    steps = step_outcomes(recording.steps)
    return Summary(
        outcome=end.outcome.value if recording.foreign is None else UNTOLD,
        cause="" if recording.foreign else end.cause or "",
        text="" if recording.foreign else end.text,
        late_s=end.reason.late_s if end.reason else 0.0,
        followed=tuple(map(str, end.followed)),
        left=end.left,
        truncated=recording.truncated,
        checks=tuple(event.text for event in recording.events if event.kind == EventKind.CHECK),
        controller=recording.metadata.get("controller", ""),
        seed=recording.metadata.get("seed", ""),
        force_reference_n=references[0] if len(set(references)) == 1 else None,
        force_references_n=(min(references), max(references)) if references else None,
        force_mean_steady_n=statistics.fmean(cycle.force for cycle in tail) if steady else None,
        strokes=len(strokes),
        figures=figures,
        contact=contact_figures(recording),
        phases_s={
            name: sum(span.end - span.begin for span in spans if span.name == name)
            for name in dict.fromkeys(span.name for span in spans)
        },
        cycles=len(cycles),
        cycles_clamped=sum(cycle.verdict == "clamp" for cycle in cycles),
        cycles_held=sum(cycle.held for cycle in cycles),
        cycle_rate_hz=_rate(cycles),
        cycle_time=times_of(cycle_times(cycles, robot.cycle_s is not None)),
        line_floor_s=end.line_floor_s,
        sensor_frames_received=len(recording.sensors) + dropped[SENSOR.name],
        sensor_frames_lost=end.sensor_lost,
        recorder_dropped=dropped,
        link=dict(end.link),
        latency=latency.as_ms() if latency else {},
        latency_largest=latency.largest_words if latency else "",
        latency_sentence=latency.sentence if latency else "",
        answers=answers.times.as_ms() if answers else {},
        answers_sentence=answers.sentence if answers else "",
        steps=steps,
        criteria_failed=tuple(step.label for step in steps if step.criterion_failed),
    )


def wanted_force(summary: Summary) -> str:
    """Describe the target force; empty if there was none."""
    if summary.force_references_n is None:
        return ""
    least, most = summary.force_references_n
    return f"{least:g} N" if least == most else f"{least:.4g} … {most:.4g} N"


def end_of(recording: Recording) -> RunEnd:
    """Return the recorded end; a record without one was cut off, which counts as interrupted."""
    told = recording.end
    outcome = told.get("outcome", "")
    floor, link = json_or_none(told.get("line_floor_s")), json_or_none(told.get("link"))
    lost, delay = json_or_none(told.get("sensor_lost")), json_or_none(told.get("sensor_delay_s"))
    reason = reason_of(told) if told else Reason(Cause.CUT, "the recording ends before the run does")
    rest = json_or_none(told.get("rest"))
    return RunEnd(
        Outcome(outcome) if outcome in set(Outcome) else Outcome.INTERRUPTED,
        reason,
        float(floor) if isinstance(floor, (int, float)) else None,
        {str(k): v for k, v in link.items() if isinstance(v, (int, float))} if isinstance(link, dict) else {},
        lost if isinstance(lost, int) else None,
        float(delay) if isinstance(delay, (int, float)) else None,
        told.get("left", ""),
        followed_of(told),
        rest if isinstance(rest, dict) else {},
        told.get("place", ""),
    )


def phases(recording: Recording) -> tuple[PhaseSpan, ...]:
    """Return the phases in order, from the events that begin them, or else from the cycles."""
    begins = [(event.at, event.text) for event in recording.events if event.kind == EventKind.PHASE]
    if not begins:
        before = ""
        for cycle in recording.cycles:
            if cycle.phase != before:
                begins.append((cycle.started_at, cycle.phase))
            before = cycle.phase
    last = [at for at in (cycle.answered_at for cycle in recording.cycles[-3:]) if math.isfinite(at)]
    last += [event.at for event in recording.events]
    ends = [*(at for at, _ in begins[1:]), max(last, default=math.nan)]
    return tuple(
        PhaseSpan(name, begin, end) for (begin, name), end in zip(begins, ends, strict=False) if end > begin
    )


def _stopping(cycles: Sequence[CycleRecord]) -> CycleRecord | None:
    """Return the cycle whose sample ended the tracking by itself: its answer was to retract already."""
    last = max((place for place, cycle in enumerate(cycles) if cycle.phase == TRACK), default=len(cycles))
    if last + 1 >= len(cycles):
        return None
    after = cycles[last + 1]
    cut = after.phase == RETRACT and not after.asked and after.step == cycles[last].step
    return after if cut and math.isfinite(after.force) else None


def _figures(
    strokes: list[list[CycleRecord]], stopping: CycleRecord | None, step_m: float | None
) -> dict[str, float | None]:
    """Figures of merit by name with unit; empty when nothing was tracked. The largest force and the overshoot count
    the sample that stopped the run, the others what was tracked. `step_m` is the resolution of the position; no steps
    are counted where it is not known.
    """
    if not strokes:
        return {}
    figures = merit_of(strokes, step_m)
    ended = [*strokes[:-1], [*strokes[-1], stopping]] if stopping else strokes
    largest = figures if stopping is None else merit_of(ended, step_m)
    return {one.key: getattr(figures, one.key) for one in MERIT} | {
        "overshoot_percent": largest.overshoot_percent,
        "steps_per_s": figures.steps_per_s if step_m else None,
        "largest_force_n": largest.largest_force_n,
    }


def cycle_times(cycles: Sequence[CycleRecord], driven_by_robot: bool) -> list[float]:
    """Time from the begin of each cycle to its answer, s; to the next begin for a robot that drives the cycle."""
    if driven_by_robot:
        return [after.started_at - before.started_at for before, after in pairwise(cycles)]
    return [cycle.answered_at - cycle.started_at for cycle in cycles]


def _rate(cycles: Sequence[CycleRecord]) -> float | None:
    span = cycles[-1].started_at - cycles[0].started_at if len(cycles) > 1 else 0.0
    return (len(cycles) - 1) / span if span > 0 else None


def _read_dropped(recording: Recording) -> dict[str, int]:
    counts = {}
    for topic in TOPICS:
        told = recording.end.get(DROPPED_PREFIX + topic.name, "0")
        counts[topic.name] = int(told) if told.isdecimal() else 0
    return counts
