"""Marks, stretches, limits and scales of a run's charts: the same in its report as on its live page."""

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

from hil_bridge.errors.text_files import harmless
from hil_bridge.record.ending import PHASE_EVENT, STOP_EVENT
from hil_bridge.record.reader import Recording
from hil_bridge.record.records import EventRecord, StepRecord
from hil_bridge.show.pages.description import Limit, Mark, Span
from protocol.faults import FaultStage

MARKS_MOST = 400
"""Marks of a page: stops and faults first. Chosen: more would cover the lines."""
SPANS_MOST = 200
"""Steps that are shaded. Chosen as the marks."""
MARK_LENGTH = 120
"""Characters of a mark's text at most. Chosen: a line at the cursor."""
_STEP_EVENT = "step"


class Scale(NamedTuple):
    """The values that a chart makes room for by itself."""

    zero: bool = False
    """0 is always in the picture."""
    least_span: float = 0.0
    """The picture shows at least so much, in the chart's unit."""
    log: bool = False


FORCE = Scale(zero=True, least_span=2.0)
LATERAL = Scale(zero=True, least_span=1.0)
MOMENTS = Scale(zero=True, least_span=0.1)
DEPTH = Scale(least_span=0.5)
STIFFNESS = Scale(log=True)
TIMES = Scale(zero=True)

_LIMITS = (
    ("force", "force_limit_n", 1.0, "force limit"),
    ("force", "pull_limit_n", -1.0, "pull limit"),
    ("lateral", "resultant_limit_n", 1.0, "limit of the magnitude"),
    ("moments", "moment_limit_nm", 1.0, "limit of the magnitude"),
    ("depth", "correction_total_mm", 1.0, "deepest command"),
    ("times", "stale_after_ms", 1.0, "sensor too old at"),
)
"""Chart, setting of the limits, its sign in the chart, words."""


def limits_of(chart: str, settings: Mapping[str, float], floor_s: float | None = None) -> list[Limit]:
    """Limits of a chart by the run's `[limits]`, those that are not 0. `floor_s` is the line's, s, for the times."""
    limits = [
        Limit(sign * settings[key], words)
        for name, key, sign, words in _LIMITS
        if name == chart and settings.get(key)
    ]
    if chart == "times" and floor_s is not None:
        limits.append(Limit(1e3 * floor_s, "line floor", "target", shown=True))
    return limits


def line_of(event: EventRecord) -> str:
    """The line of an event that tells most, fit for a page: the last one of a traceback, else the first."""
    text = event.text.strip()
    return harmless(
        text.rpartition("\n")[2] if event.kind in ("traceback", "bug") else text.partition("\n")[0]
    )


def event_mark(event: EventRecord, began: float) -> Mark | None:
    """The mark of an event; None where it has none, as the begin of a phase."""
    if event.kind in (PHASE_EVENT, _STEP_EVENT) or not math.isfinite(event.at):
        return None
    struck = event.fault is not None and event.fault.is_injected
    kind = "stop" if event.kind == STOP_EVENT else "fault" if struck else "event"
    return Mark(event.at - began, f"{event.kind}: {line_of(event)}"[:MARK_LENGTH], kind)


def step_mark(step: StepRecord, began: float) -> Mark:
    """The mark at the end of a program's step."""
    return Mark(step.at - began, harmless(f"{step.label}: {step.text}")[:MARK_LENGTH], "step")


def marks(recording: Recording, began: float) -> list[Mark]:
    """All marks of a recording; if there are too many, stops and faults before others."""
    made = [mark for event in recording.events if (mark := event_mark(event, began)) is not None]
    made += [step_mark(step, began) for step in recording.steps if math.isfinite(step.at)]
    if not any(mark.kind == "stop" for mark in made):
        stops = [cycle for cycle in recording.cycles if cycle.verdict == "stop"][:1]
        made += [
            Mark(cycle.controlled_at - began, f"stop: {', '.join(cycle.reasons)}"[:MARK_LENGTH], "stop")
            for cycle in stops
        ]
    made.sort(key=lambda mark: mark.kind == "event")
    return sorted(made[:MARKS_MOST], key=lambda mark: mark.x)


def stretches(phases: Iterable[Span], steps: Sequence[StepRecord], began: float) -> list[Span]:
    """The steps of a program that have ended, then the phases since; without a step all phases."""
    made = [
        Span(step.began_at - began, step.at - began, step.label, step.word) for step in steps[:SPANS_MOST]
    ]
    last = made[-1].end if made else -math.inf
    return [*made, *(phase for phase in phases if phase.begin >= last)]


def fault_spans(events: Iterable[EventRecord], began: float, until: float) -> list[Span]:
    """From the begin to the end of each injected fault; of one under way to `until`, s since the begin."""
    begun: dict[str, float] = {}
    made = []
    for event in events:
        if event.fault is None:
            continue
        name = event.fault.title
        if event.fault.stage is FaultStage.BEGINS:
            begun[name] = event.at
        elif event.fault.stage is FaultStage.ENDS and name in begun:
            made.append(Span(begun.pop(name) - began, event.at - began, name, "fault"))
    made += [Span(at - began, max(until, at - began), name, "fault") for name, at in begun.items()]
    return made[:SPANS_MOST]
