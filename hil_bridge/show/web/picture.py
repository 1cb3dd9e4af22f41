"""What the page shows of a run that goes on, made from its records in the order in which they come."""

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import msgspec

from hil_bridge.record.ending import PHASE_EVENT, words_of
from hil_bridge.record.records import CycleRecord, EventRecord, StepRecord, TruthRecord
from hil_bridge.record.topics import Record
from hil_bridge.show.pages.description import Span
from hil_bridge.show.run_marks import (
    MARKS_MOST,
    SPANS_MOST,
    event_mark,
    fault_spans,
    step_mark,
    stretches,
)
from hil_bridge.show.terminal import Health, ViewModel
from hil_bridge.show.web.columns import Columns, tidy
from hil_bridge.show.web.telling import (
    charts_of,
    is_zero,
    spans_of,
    told_event,
    told_now,
    told_scene,
)
from hil_bridge.show.web.wire import Begin, End, Pulse

EVENTS = 200
"""Events that are kept."""
SILENT_S = 2.0
"""Time without news of the run from which the page says so. Chosen: ten pulses."""


@dataclass(slots=True)
class Cursor:
    """How far one page has been told."""

    rows: Mapping[str, int] = field(default_factory=dict)
    events: int = 0
    marks: int = 0
    phases: int = 0
    scene: int = -1


class Picture:
    """State of one run for its pages. Its memory is bounded."""

    def __init__(self, begin: Begin, heard_at: float) -> None:
        """`heard_at` is the present time of this process's own clock, s."""
        self._begin = begin
        self._scene_number = 0
        self._model = ViewModel(begin.scene)
        self._began: float | None = None
        self._columns: Columns | None = None
        self._events: deque[dict[str, Any]] = deque(maxlen=EVENTS)
        self._event_count = 0
        self._marks: deque[Any] = deque(maxlen=MARKS_MOST)
        self._mark_count = 0
        self._phases: deque[tuple[float, str]] = deque(maxlen=EVENTS)
        self._steps: deque[StepRecord] = deque(maxlen=SPANS_MOST)
        self._faults: deque[EventRecord] = deque(maxlen=EVENTS)
        self._pulse = Pulse(0.0, Health())
        self._heard_at = heard_at
        self._zero = ""
        self._truth: TruthRecord | None = None
        self._end: Mapping[str, Any] | None = None

    def begin(self, begin: Begin) -> None:
        """More is known of the run."""
        self._begin = begin
        self._scene_number += 1
        self._model.renew(begin.scene)

    def take(self, record: Record) -> None:
        """Take a record."""
        match record:
            case CycleRecord():
                self._since(record.started_at).cycle(record)
                self._model.update(record)
            case TruthRecord():
                if self._columns is not None:
                    self._columns.truth(record)
                    self._truth = record
            case EventRecord():
                self._since(record.at)
                self._event(record)
            case StepRecord():
                self._since(record.at)
                self._steps.append(record)
                self._mark(step_mark(record, self._began or 0.0))
            case _:
                pass

    def _since(self, at: float) -> Columns:
        """The columns; the first record begins the time of the page."""
        if self._columns is None:
            self._began = at
            self._model.snapshot(at, Health())
            self._columns = Columns(at)
        return self._columns

    def _event(self, event: EventRecord) -> None:
        began = self._began or 0.0
        self._model.event(event)
        if event.kind == PHASE_EVENT:
            self._phases.append((event.at - began, event.text))
        if event.fault is not None:
            self._faults.append(event)
        if is_zero(event):
            self._zero = event.text
        self._events.append(told_event(event, began))
        self._event_count += 1
        if (mark := event_mark(event, began)) is not None:
            self._mark(mark)

    def _mark(self, mark: Any) -> None:
        self._marks.append(msgspec.to_builtins(mark))
        self._mark_count += 1

    def pulse(self, pulse: Pulse, heard_at: float) -> None:
        """Take a pulse of the run."""
        self._since(pulse.now)
        self._pulse, self._heard_at = pulse, heard_at

    def end(self, end: End) -> None:
        """The run has ended."""
        self._end = words_of(end.facts)

    def lost(self) -> None:
        """The run's process has gone without a word."""
        if self._end is None:
            self._end = {
                "outcome": "gone",
                "cause": "the run's process ended without a word",
                "left": "",
                "followed": [],
            }

    @property
    def ended(self) -> bool:
        """The run has ended."""
        return self._end is not None

    def told(self, cursor: Cursor, present: float) -> dict[str, Any]:
        """News for a page since its cursor, which moves on. `present` is the time of this process's own clock, s."""
        passed = 0.0 if self.ended else max(0.0, present - self._heard_at)
        now = self._pulse.now + passed
        snapshot = self._model.snapshot(now, self._pulse.health)
        told: dict[str, Any] = {"now": told_now(snapshot)}
        told["now"] |= {
            "zero": self._zero,
            "dropped": self._pulse.dropped,
            "silent_s": tidy(passed) if passed > SILENT_S else 0,
        }
        if not told["now"]["check"]:
            told["now"]["check"] = self._pulse.check
        told["now"]["warning"] = self._pulse.warning
        if cursor.scene != self._scene_number:
            self._whole(cursor, told)
        if self._columns is not None:
            if rows := self._columns.since(cursor.rows):
                told["rows"] = rows
            cursor.rows = self._columns.counts
            told["approach"] = self._columns.approach
        told["events"] = _newest(self._events, self._event_count - cursor.events)
        told["marks"] = _newest(self._marks, self._mark_count - cursor.marks)
        cursor.events, cursor.marks = self._event_count, self._mark_count
        if len(self._phases):
            told["spans"] = msgspec.to_builtins(self._spans(now))
        if self._truth is not None:
            told["truth"] = _truth(self._truth)
        if self._end is not None:
            told["end"] = self._end
        return told

    def _spans(self, now: float) -> list[Span]:
        began = self._began or 0.0
        phases = spans_of(list(self._phases), now - began)
        return [*stretches(phases, list(self._steps), began), *fault_spans(self._faults, began, now - began)]

    def _whole(self, cursor: Cursor, told: dict[str, Any]) -> None:
        """Begin a page from nothing."""
        cursor.rows, cursor.events, cursor.marks, cursor.scene = {}, 0, 0, self._scene_number
        scene = self._begin.scene
        start = None if self._began is None else self._begin.unix_zero_ns * 1e-9 + self._began
        told["scene"] = told_scene(scene)
        told["charts"] = msgspec.to_builtins(charts_of(scene, start))


def _truth(truth: TruthRecord) -> dict[str, Any]:
    return {
        "quaternion": [tidy(value) for value in truth.quaternion],
        "normal": [tidy(value) for value in truth.normal],
        "force": [tidy(value) for value in truth.force],
        "faults": list(truth.faults),
    }


def _newest(items: deque[Any], count: int) -> list[Any]:
    return [] if count <= 0 else list(items)[-count:]
