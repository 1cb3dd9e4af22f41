"""Summary of a run, computed only from its recording: figures of merit, durations, times and counters."""

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
from hil_bridge.record.analysis.response import response_figures
from hil_bridge.record.analysis.steps import StepOutcome, step_outcomes
from hil_bridge.record.analysis.strokes import TRACK, merit_of, strokes_of
from hil_bridge.record.analysis.times import Times, times_of
from hil_bridge.record.device_facts import devices_of, json_or_none
from hil_bridge.record.ending import Outcome, RunEnd, followed_of, reason_of
from hil_bridge.record.files import write_atomically
from hil_bridge.record.reader import Recording
from hil_bridge.record.recorder import DROPPED_PREFIX
from hil_bridge.record.records import CycleRecord
from hil_bridge.record.topics import SENSOR, TOPICS

RETRACT = "retract"
"""Name of the phase in which the tool is retracted."""
UNKNOWN_OUTCOME = "not told"
"""Outcome of a recording that does not state one, such as a ROS 2 bag."""


@dataclass(frozen=True, slots=True)
class PhaseSpan:
    """Interval of a run in one phase, with times in s on the run's clock."""

    name: str
    begin: float
    end: float


@dataclass(frozen=True, slots=True)
class Summary:
    """Results of a run. None means that the run did not provide the value."""

    outcome: str
    cause: str
    """Row of the table of causes; empty for a completed run."""
    text: str
    """Description of the cause."""
    late_s: float
    """Largest delay of the computer in the last second before the cause, s; 0 if the computer was on time."""
    followed: tuple[str, ...]
    """Events after the cause, in order."""
    left: str
    """Description of the final position of the tool; empty if the tool never moved or the recording was cut off
    earlier.
    """
    truncated: bool
    """Whether the recording ends early; the figures then cover the part that was read."""
    checks: tuple[str, ...]
    """Findings about the sensor before contact, as text, and the reading used as zero."""
    controller: str
    seed: str
    force_reference_n: float | None
    """Target force, N; None if it varied."""
    force_references_n: tuple[float, float] | None
    """Smallest and largest target force, N."""
    force_mean_steady_n: float | None
    """Mean force over the last 40 samples of tracking, N; None with fewer samples since the rise, or if the target
    force varied.
    """
    strokes: int
    """Number of tracking intervals; each lasts from contact to retraction."""
    figures: Mapping[str, float | None]
    """Figures of merit of the tracking phase, by the keys of `analysis.figures`.

    The largest force and the overshoot include the sample that ended the phase. A run with several strokes has the
    slowest rise, the steady state of the last stroke, and all other figures over all strokes.
    """
    response: Mapping[str, float | None]
    """Response figures of the first stroke, by the keys of `analysis.figures`."""
    contact: Mapping[str, float | None]
    """Contact figures of the samples whose force is above the contact threshold, by the keys of `analysis.figures`.

    The threshold is 1 N. For a bag, it is the value given when the bag is read.
    """
    phases_s: Mapping[str, float]
    """Duration of each phase, s, in order of first appearance."""
    cycles: int
    cycles_clamped: int
    cycles_held: int
    cycle_rate_hz: float | None
    cycle_time: Times | None
    """Duration of a cycle, from its start until the robot has accepted the order."""
    line_floor_s: float | None
    sensor_frames_received: int
    sensor_frames_lost: int | None
    """Number of sensor frames that were never received; None if the recording was cut off."""
    recorder_dropped: Mapping[str, int]
    """Number of records missing from the file, by topic."""
    link: Mapping[str, float]
    """Counters of the links."""
    latency: Mapping[str, Mapping[str, float]]
    """Distribution of each hop between a force and the motion in response, ms; empty without time stamps."""
    latency_largest: str
    """Description of the largest hop."""
    latency_sentence: str
    """One-line description of the latency."""
    answers: Mapping[str, float]
    """Response times to a robot that drives the cycle, ms; empty for a polled robot."""
    answers_sentence: str
    """One-line description of the response times, with the number of late responses."""
    steps: tuple[StepOutcome, ...] = ()
    """Completed steps of a program, oldest first."""
    criteria_failed: tuple[str, ...] = ()
    """Labels of the steps whose criterion was not met."""

    def as_json(self) -> str:
        """Return the summary as strict JSON, in the order of the fields."""
        return msgspec.json.format(msgspec.json.encode(self), indent=2).decode() + "\n"

    def write_json(self, path: Path, overwrite: bool = False) -> None:
        """Write the file atomically, so that a reader never sees an incomplete file.

        Raises ConfigError as `write_atomically` does.
        """
        write_atomically(path, self.as_json().encode(), overwrite)


def summarise(recording: Recording, end: RunEnd | None = None) -> Summary:
    """Return the summary of a run. If `end` is omitted, it is read from the recording."""
    end = end or end_of(recording)
    cycles = recording.cycles
    strokes = strokes_of(recording)
    dropped = _read_dropped(recording)
    robot = devices_of(recording).robot
    figures = _figures(
        strokes,
        _find_stopping_cycle(cycles) if end.outcome is Outcome.STOPPED else None,
        robot.position_step_m,
    )
    steady = figures.get("steady_mean_error_n") is not None
    tracked = [cycle for stroke in strokes for cycle in stroke]
    references = [c.force_reference for c in tracked or cycles if not math.isnan(c.force_reference)]
    tail = strokes[-1][-STEADY_SAMPLES:] if strokes else []
    steady = steady and len({cycle.force_reference for cycle in tail}) == 1
    spans = phases(recording)
    latency, answers = latency_of(recording), answers_of(cycles, robot, end.link)
    steps = step_outcomes(recording.steps)
    return Summary(
        outcome=end.outcome.value if recording.foreign is None else UNKNOWN_OUTCOME,
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
        response=response_figures(recording, strokes),
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
        latency_largest=latency.largest_text if latency else "",
        latency_sentence=latency.sentence if latency else "",
        answers=answers.times.as_ms() if answers else {},
        answers_sentence=answers.sentence if answers else "",
        steps=steps,
        criteria_failed=tuple(step.label for step in steps if step.criterion_failed),
    )


def target_force_text(summary: Summary) -> str:
    """Describe the target force; return an empty text if there is none."""
    if summary.force_references_n is None:
        return ""
    least, most = summary.force_references_n
    return f"{least:g} N" if least == most else f"{least:.4g} … {most:.4g} N"


def end_of(recording: Recording) -> RunEnd:
    """Return the recorded end. A recording without an end was cut off and counts as interrupted."""
    return read_end(recording.end)


def read_end(metadata: Mapping[str, str]) -> RunEnd:
    """Return the end of a run from its metadata, which `RunEnd.as_metadata` makes; empty metadata count as
    interrupted.
    """
    outcome = metadata.get("outcome", "")
    floor, link = json_or_none(metadata.get("line_floor_s")), json_or_none(metadata.get("link"))
    lost, delay = json_or_none(metadata.get("sensor_lost")), json_or_none(metadata.get("sensor_delay_s"))
    reason = reason_of(metadata) if metadata else Reason(Cause.CUT, "the recording ends before the run does")
    rest = json_or_none(metadata.get("rest"))
    return RunEnd(
        Outcome(outcome) if outcome in set(Outcome) else Outcome.INTERRUPTED,
        reason,
        float(floor) if isinstance(floor, (int, float)) else None,
        {str(k): v for k, v in link.items() if isinstance(v, (int, float))} if isinstance(link, dict) else {},
        lost if isinstance(lost, int) else None,
        float(delay) if isinstance(delay, (int, float)) else None,
        metadata.get("left", ""),
        followed_of(metadata),
        rest if isinstance(rest, dict) else {},
        metadata.get("place", ""),
    )


def phases(recording: Recording) -> tuple[PhaseSpan, ...]:
    """Return the phases in order, from the events that begin them; without such events, from the cycles."""
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


def _find_stopping_cycle(cycles: Sequence[CycleRecord]) -> CycleRecord | None:
    """Return the cycle whose sample ended the tracking.

    In this cycle, the controller already ordered the retraction.
    """
    last = max((place for place, cycle in enumerate(cycles) if cycle.phase == TRACK), default=len(cycles))
    if last + 1 >= len(cycles):
        return None
    after = cycles[last + 1]
    cut = after.phase == RETRACT and not after.asked and after.step == cycles[last].step
    return after if cut and math.isfinite(after.force) else None


def _figures(
    strokes: list[list[CycleRecord]], stopping: CycleRecord | None, step_m: float | None
) -> dict[str, float | None]:
    """Return the figures of merit by name with unit; empty if no force was tracked.

    The largest force and the overshoot include the sample that ended the run; the other figures cover tracked
    samples only. `step_m` is the resolution of the position; steps are not counted if it is unknown.
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
    """Return the time from the start of each cycle to its response, s.

    If the robot drives the cycle, it is the time to the start of the next cycle.
    """
    if driven_by_robot:
        return [after.started_at - before.started_at for before, after in pairwise(cycles)]
    return [cycle.answered_at - cycle.started_at for cycle in cycles]


def _rate(cycles: Sequence[CycleRecord]) -> float | None:
    span = cycles[-1].started_at - cycles[0].started_at if len(cycles) > 1 else 0.0
    return (len(cycles) - 1) / span if span > 0 else None


def _read_dropped(recording: Recording) -> dict[str, int]:
    counts = {}
    for topic in TOPICS:
        count = recording.end.get(DROPPED_PREFIX + topic.name, "0")
        counts[topic.name] = int(count) if count.isdecimal() else 0
    return counts
