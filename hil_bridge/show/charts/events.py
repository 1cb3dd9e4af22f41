"""Marks and spans of a run's charts, from its events and steps."""

import math
from collections.abc import Iterable, Sequence

from hil_bridge.errors.event_kinds import ALARMS, CAUTIONS, EventKind
from hil_bridge.errors.text_files import harmless
from hil_bridge.record.analysis.summary import RETRACT
from hil_bridge.record.records import CycleRecord, EventRecord, StepRecord
from hil_bridge.show.pages.description import Mark, Span
from protocol.faults import FaultStage

MARKS_MOST = 400
"""Maximum number of marks on a page; stops and faults take precedence. Chosen: more marks would cover the lines."""
SPANS_MOST = 200
"""Maximum number of shaded steps. Chosen: as many as marks."""
LONGEST = 160
"""Maximum number of characters in the text of a mark. Chosen: one line on the page."""
Phase = tuple[float, str]
"""Start of a phase on the run's clock, s, and its name."""


def mark_of(event: EventRecord, began: float) -> Mark | None:
    """Return the mark of an event, or None if it has none. `began` is the time at x = 0."""
    if event.kind in (EventKind.PHASE, EventKind.STEP) or not math.isfinite(event.at):
        return None
    if event.fault is not None and event.fault.is_injected:
        return Mark(event.at - began, _lead(event.kind, event.fault.phrase), "fault")
    text = _lead(event.kind, line_of(event))
    return _stop(event.at - began, text) if event.kind == EventKind.STOP else Mark(event.at - began, text)


def _stop(x: float, text: str) -> Mark:
    return Mark(x, text, "stop", short="stop")


def mark_of_step(step: StepRecord, began: float) -> Mark:
    """Return the mark at the end of a program step."""
    return Mark(step.at - began, _lead(step.label, line_of(step)), "step")


def marks_of(
    events: Iterable[EventRecord],
    steps: Iterable[StepRecord],
    cycles: Sequence[CycleRecord],
    began: float,
) -> list[Mark]:
    """Return the marks of a run; if there are too many, stops and faults take precedence.

    If no event reports the stop, the first cycle with the verdict stop gets the mark.
    """
    marks = [mark for event in events if (mark := mark_of(event, began)) is not None]
    if not any(mark.kind == "stop" for mark in marks):
        stops = [cycle for cycle in cycles if cycle.verdict == "stop"][:1]
        marks += [
            _stop(one.controlled_at - began, _lead(EventKind.STOP, harmless(", ".join(one.reasons))))
            for one in stops
        ]
    marks += [mark_of_step(step, began) for step in steps]
    marks.sort(key=lambda mark: mark.kind in ("event", "step"))
    return sorted(marks[:MARKS_MOST], key=lambda mark: mark.x)


def line_of(record: EventRecord | StepRecord) -> str:
    """Return the most informative line of a record's text, safe for a page."""
    return harmless(record.line if isinstance(record, EventRecord) else record.text)


def _lead(lead: str, line: str) -> str:
    return (f"{lead}: {line}" if line else lead)[:LONGEST]


def weight_of(event: EventRecord) -> str:
    """Return the severity of an event in a list: `alarm`, `caution` or an empty text."""
    return "alarm" if event.kind in ALARMS else "caution" if event.kind in CAUTIONS else ""


def phases_in(events: Iterable[EventRecord]) -> list[Phase]:
    """Return the phases that begin with these events."""
    return [(event.at, event.text) for event in events if event.kind == EventKind.PHASE]


def label_phases(names: Sequence[str], retracted: bool | None) -> list[str]:
    """Return the labels of the phases; a retraction at the end that did not retract the tool is labelled as failed."""
    labels = list(names)
    if retracted is False and RETRACT in labels[-2:]:  # the phase `end` may follow
        labels[-1 if labels[-1] == RETRACT else -2] = f"{RETRACT}, failed"
    return labels


def spans_of(
    phases: Sequence[Phase],
    steps: Sequence[StepRecord],
    began: float,
    until: float,
    retracted: bool | None = None,
) -> list[Span]:
    """Return the completed steps of a program, and the phases before and after the program.

    The last phase extends to `until`. `began` and `until` are on the run's clock. `retracted` is that of `RunEnd`.
    """
    ends = [*(begin for begin, _ in phases[1:]), until][: len(phases)]
    first = steps[0].began_at if steps else math.inf
    last = steps[-1].at if steps else math.inf
    spans = []
    labels = label_phases([name for _, name in phases], retracted)
    for (begin, name), label, after in zip(phases, labels, ends, strict=True):
        end = max(begin, after)
        if begin < first:
            spans.append(Span(begin - began, min(end, first) - began, label, name))
        if begin >= last or end > last:
            spans.append(Span(max(begin, last) - began, end - began, label, name))
    spans += [
        Span(step.began_at - began, step.at - began, step.label, step.word, short=step.number)
        for step in steps[:SPANS_MOST]
    ]
    return sorted(spans, key=lambda span: span.begin)


def fault_spans(events: Iterable[EventRecord], began: float, until: float) -> list[Span]:
    """Return a span for each injected fault; a fault that has not ended extends to `until`."""
    begun: dict[str, float] = {}
    spans = []
    for event in events:
        if event.fault is None:
            continue
        name = event.fault.phrase
        if event.fault.stage is FaultStage.BEGINS:
            begun[name] = event.at
        elif event.fault.stage is FaultStage.ENDS and name in begun:
            spans.append(Span(begun.pop(name) - began, event.at - began, name, "fault"))
    spans += [Span(at - began, max(until, at) - began, name, "fault") for name, at in begun.items()]
    return spans[:SPANS_MOST]
