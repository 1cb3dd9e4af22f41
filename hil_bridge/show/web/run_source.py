"""Page updates of a run. A live run is a growing recording, so live runs and recordings use the same messages."""

import dataclasses
import math
import time
from bisect import bisect_right
from collections import deque
from collections.abc import Mapping, MutableSequence, Sequence
from dataclasses import dataclass, field
from itertools import islice
from typing import Any

import msgspec

from hil_bridge.errors.causes import Cause, Reason
from hil_bridge.errors.event_kinds import EventKind
from hil_bridge.record.analysis.summary import read_end
from hil_bridge.record.ending import Outcome, RunEnd
from hil_bridge.record.records import CycleRecord, EventRecord, SensorRecord, StepRecord, TruthRecord
from hil_bridge.record.topics import Record
from hil_bridge.show.charts.catalogue import catalogue, layers, time_axis
from hil_bridge.show.charts.columns import ROW_S, TABLES, Columns, round_digits
from hil_bridge.show.charts.end_panel import end_panel
from hil_bridge.show.charts.events import fault_spans, mark_of, mark_of_step, phases_in, spans_of
from hil_bridge.show.charts.facts import ChartFacts
from hil_bridge.show.pages.description import Charts, Mark
from hil_bridge.show.terminal import Health, Scene, ViewModel
from hil_bridge.show.terminal.model import HISTORY_CYCLES
from hil_bridge.show.web.page_values import (
    event_values,
    is_zero,
    now_values,
    scene_values,
)
from hil_bridge.show.web.wire import Begin, End, Pulse

EVENTS = 200
"""Maximum number of events, of marks and of steps that are kept of a live run, and of events on a page."""
SILENT_S = 2.0
"""Time without messages from the run after which the page displays a warning, s. Chosen: ten pulses."""
REST_S = 0.5
"""Time without cycles after which a stopped run's chart continues with the sensor's frames, s. Chosen."""
ROWS_MOST = 8000
"""Maximum number of rows of a recording. Chosen: more than any screen has columns."""
GONE = "gone"
"""Outcome of a run that ended without sending its end."""


@dataclass(slots=True)
class Cursor:
    """Position of one page: the data that it has received, and the time that it displays."""

    rows: Mapping[str, int] = field(default_factory=dict)
    events: int = 0
    marks: int = 0
    version: int = -1
    at: float | None = None
    """Displayed time of a recording, s since its start; None for the newest time of a live run."""
    moved: bool = True
    """Whether the page still needs the values at the time `at`."""
    panel: tuple[int, int] = (0, 0)
    """Versions of the panel and of the panel's state that the page has received."""


class RunHistory:
    """Records of a run so far.

    For a live run, only the newest records and the records that a page always displays are kept.
    """

    def __init__(self, bounded: bool) -> None:
        def kept(most: int) -> MutableSequence[Any]:
            return deque(maxlen=most) if bounded else []

        self.cycles: MutableSequence[CycleRecord] = kept(HISTORY_CYCLES)
        self.sensors: MutableSequence[SensorRecord] = kept(1)
        self.events: MutableSequence[EventRecord] = kept(EVENTS)
        self.steps: MutableSequence[StepRecord] = kept(EVENTS)
        self.marks: MutableSequence[Mark] = kept(EVENTS)
        self.phases: MutableSequence[EventRecord] = kept(EVENTS)
        self.faults: MutableSequence[EventRecord] = kept(EVENTS)
        self.zeros: MutableSequence[EventRecord] = kept(1)
        self.track: CycleRecord | None = None
        """First tracking cycle."""
        self.stop: EventRecord | None = None
        self.event_count = self.mark_count = 0

    def take(self, record: Record, began: float) -> None:
        """Add a record; `began` is the time at x = 0."""
        match record:
            case CycleRecord():
                self.cycles.append(record)
                if self.track is None and record.phase == "track":
                    self.track = record
            case SensorRecord():
                self.sensors.append(record)
            case EventRecord():
                self._event(record)
                self._mark(mark_of(record, began))
            case StepRecord():
                self.steps.append(record)
                self._mark(mark_of_step(record, began))
            case _:
                pass

    def _event(self, event: EventRecord) -> None:
        self.events.append(event)
        self.event_count += 1
        if event.kind == EventKind.PHASE:
            self.phases.append(event)
        elif event.fault is not None:
            self.faults.append(event)
        elif event.kind == EventKind.STOP and self.stop is None:
            self.stop = event
        elif is_zero(event):
            self.zeros.append(event)

    def _mark(self, mark: Mark | None) -> None:
        if mark is not None:
            self.marks.append(mark)
            self.mark_count += 1

    def model(self, scene: Scene, began: float, until: float) -> ViewModel:
        """Return the view model built from the records up to a given time."""
        model = ViewModel(scene)
        model.snapshot(began, Health())
        if self.track is not None and self.track.controlled_at <= until:
            model.update(self.track)
        for cycle in _until(self.cycles, until, "controlled_at", HISTORY_CYCLES):
            model.update(cycle)
        if self.stop is not None and self.stop.at <= until and self.stop not in self.events:
            model.event(self.stop)
        for event in _until(self.events, until, "at", EVENTS):
            model.event(event)
        return model


class RunSource:
    """Source of page updates for one run. Page times are seconds since the run's first record."""

    def __init__(
        self,
        begin: Begin,
        received_at: float = 0.0,
        length_s: float | None = None,
        facts: ChartFacts | None = None,
    ) -> None:
        """`received_at` is the time on this process's clock, s; `length_s` is the length of a complete recording.

        A page may request any time of a complete recording, for which memory use is not bounded.
        """
        self._begin, self._facts = begin, facts or begin.scene.chart_facts
        self._length_s = length_s
        self._version = 0
        self._history = RunHistory(bounded=length_s is None)
        self._began: float | None = None
        self._columns: Columns | None = None
        self._pulse = Pulse(0.0, Health())
        self._received_at = received_at
        self._end: RunEnd | None = None
        self._panel: Mapping[str, Any] = {}
        self.counters: Mapping[str, Any] = {}
        """Counters of a complete recording, which has no counters for a particular time."""
        self.over = False
        """Whether the run has ended and sends no more messages."""

    # --- messages of the run

    def begin(self, begin: Begin) -> None:
        """Restart every page with new facts of the run."""
        self._begin, self._facts = begin, begin.scene.chart_facts
        self._version += 1

    def take(self, record: Record) -> None:
        """Add a record."""
        match record:
            case CycleRecord():
                self._since(record.started_at).cycle(record)
            case TruthRecord() if self._columns is not None:
                self._columns.truth(record)
            case EventRecord() | StepRecord():
                self._since(record.at)
            case _:
                pass
        self._history.take(record, self._began or 0.0)

    def _since(self, at: float) -> Columns:
        """Return the columns. The first record sets the zero of the page's time."""
        if self._columns is None:
            self._began = at
            if self._length_s is None:
                self._columns = Columns(at, self._facts)
            else:
                self._columns = Columns(at, self._facts, max(ROW_S, self._length_s / ROWS_MOST), None)
        return self._columns

    def pulse(self, pulse: Pulse, received_at: float) -> None:
        """Store a pulse of the run."""
        columns, history = self._since(pulse.now), self._history
        at, force = pulse.health.sensor_at, pulse.health.force
        if history.stop is not None and history.cycles and at is not None and force is not None:
            columns.frame(at, force, after=history.cycles[-1].answered_at + REST_S)
        self._pulse, self._received_at = pulse, received_at

    def end(self, end: End) -> None:
        """Store the end of the run."""
        self._end = read_end(end.facts)
        self._panel = self._end_panel(self._end)

    def lost(self, cause: str = "the run's process ended unexpectedly") -> None:
        """Record that the run ended without sending its end."""
        if self._end is None:
            self._end = RunEnd(Outcome.INTERRUPTED, Reason(Cause.CUT, cause))
            self._panel = self._end_panel(self._end) | {"outcome": GONE, "style": "alarm"}

    def _end_panel(self, end: RunEnd) -> dict[str, Any]:
        """Return how the run ended, with the commands that make sense now."""
        history, places, when = self._history, self._begin.scene.places, ""
        at = math.inf
        if history.stop is not None:
            at = history.stop.at
            phases = [cycle.phase for cycle in _until(history.cycles, at, "answered_at", 1)]
            when = f"{end.outcome} after {at - (self._began or 0.0):.1f} s{''.join(f' in {one}' for one in phases)}"
        faults = [event for event in history.faults if event.at <= at]
        commands = places.next_commands(end.outcome, bool(history.cycles), end.retracted)
        return {**msgspec.to_builtins(end_panel(end, faults, when)), "next": commands}

    # --- requests of pages

    def first(self) -> Cursor:
        """Return the cursor of a new page. For a recording, the cursor is at the end."""
        return Cursor(at=self._length_s)

    def handle_request(self, state: Any, message: Mapping[str, Any]) -> None:
        """Go to a given time of a recording: `{"at": seconds}`. Raises ValueError for an invalid request."""
        if self._length_s is None:
            raise ValueError("the page of a live run accepts no requests")
        at = message.get("at")
        if set(message) != {"at"} or isinstance(at, bool) or not isinstance(at, (int, float)):
            raise ValueError('invalid request: expected {"at": seconds}')
        if not math.isfinite(at):
            raise ValueError("`at` must be a finite number of seconds")
        state.at, state.moved = min(max(0.0, float(at)), self._length_s), True

    def updates(self, state: Any) -> Mapping[str, Any] | None:
        """Return the changes since the last call for this state, or None."""
        if state.at is not None and not state.moved:
            return None
        return self.update_for(state, time.monotonic())

    def update_for(self, cursor: Cursor, present: float) -> dict[str, Any]:
        """Return the changes since a page's cursor, and advance the cursor.

        `present` is the time on this process's clock, s.
        """
        began = self._began or 0.0
        passed = 0.0 if self._end is not None else max(0.0, present - self._received_at)
        now = self._pulse.now + passed if cursor.at is None else began + cursor.at
        update: dict[str, Any] = {}
        if cursor.version != self._version:
            update |= self._initial_update(cursor)
        update |= self._moment(now, math.inf if cursor.at is None else now, passed)
        update |= self._changes(cursor, now)
        if cursor.at is not None:
            update["at"] = round_digits(cursor.at)
        cursor.moved = False
        if self._end is not None:
            update["end"] = self._panel
        return update

    def _initial_update(self, cursor: Cursor) -> dict[str, Any]:
        """Reset a page: return its scene and charts."""
        cursor.rows, cursor.events, cursor.marks, cursor.version = {}, -1, 0, self._version
        scene, zero_ns = self._begin.scene, self._begin.unix_zero_ns
        start = None if self._began is None or not zero_ns else zero_ns * 1e-9 + self._began
        empty: Mapping[str, Any] = {table: {"x": []} for table in TABLES}
        charts = Charts(
            {"time": time_axis(start)},
            catalogue(self._facts),
            empty,
            layers=layers(scene.robot.emulated, False),
        )
        update = {
            "scene": scene_values(scene),
            "charts": msgspec.to_builtins(charts),
            "model": msgspec.to_builtins(self._begin.model),
        }
        return (
            update if self._length_s is None else update | {"playback": {"begin": 0.0, "end": self._length_s}}
        )

    def _moment(self, now: float, until: float, silent_s: float) -> dict[str, Any]:
        """Return the values at a given time, from the records up to it."""
        history, health = self._history, self._pulse.health
        if self._length_s is not None:
            frame = _newest(history.sensors, until)
            health = Health(sensor_at=None if frame is None else frame.at)
        elif health.sensor_at is not None and silent_s <= SILENT_S:
            # the age at the pulse, which is the newest known
            health = dataclasses.replace(health, sensor_at=health.sensor_at + silent_s)
        snapshot = history.model(self._begin.scene, self._began or 0.0, until).snapshot(now, health)
        zero, pulse, stop = _newest(history.zeros, until), self._pulse, history.stop
        update = now_values(snapshot) | {
            "stopped_s": None if stop is None or stop.at > until else stop.at - (self._began or 0.0),
            "zero": "" if zero is None else zero.text,
            "dropped": pulse.dropped,
            "silent_s": round_digits(silent_s) if silent_s > SILENT_S else 0,
            "warning": pulse.warning,
        }
        update["check"] = update["check"] or pulse.check
        return {"now": update | dict(self.counters)}

    def _changes(self, cursor: Cursor, now: float) -> dict[str, Any]:
        """Return the rows, events, marks and spans that the page has not received."""
        history, began = self._history, self._began or 0.0
        update: dict[str, Any] = {"events": [], "marks": []}
        if self._columns is not None:
            if rows := self._columns.since(cursor.rows):
                update["rows"] = rows
            cursor.rows = self._columns.counts
            update["start"] = self._columns.start
        update["marks"] = msgspec.to_builtins(_last(history.marks, history.mark_count - cursor.marks))
        cursor.marks = history.mark_count
        if cursor.at is None:
            events = _last(history.events, history.event_count - max(cursor.events, 0))
            cursor.events = history.event_count
        else:
            events = _until(history.events, now, "at", EVENTS)
            update["events_whole"] = True
        update["events"] = [event_values(event, began) for event in events]
        until = now if self._length_s is None else began + self._length_s
        retracted = None if self._end is None else self._end.retracted
        spans = spans_of(phases_in(history.phases), list(history.steps), began, until, retracted)
        update["spans"] = msgspec.to_builtins([*spans, *fault_spans(history.faults, began, until)])
        return update


def _until(records: Sequence[Any], now: float, name: str, most: int) -> list[Any]:
    """Return the newest records at a given time, oldest first."""
    count = bisect_right(records, now, key=lambda record: getattr(record, name))
    return list(islice(records, max(0, count - most), count))


def _newest(records: Sequence[Any], now: float) -> Any:
    number = bisect_right(records, now, key=lambda record: record.at)
    return records[number - 1] if number else None


def _last(items: Sequence[Any], count: int) -> list[Any]:
    return [] if count <= 0 else list(items)[-count:]
