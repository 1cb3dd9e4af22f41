"""A run as a page shows it. A run that continues is a recording that grows; both are told by the same words."""

import math
import time
from bisect import bisect_right
from collections import deque
from collections.abc import Mapping, MutableSequence, Sequence
from dataclasses import dataclass, field
from itertools import islice
from typing import Any

import msgspec

from hil_bridge.errors.event_kinds import EventKind
from hil_bridge.record.records import CycleRecord, EventRecord, SensorRecord, StepRecord, TruthRecord
from hil_bridge.record.topics import Record
from hil_bridge.show.charts.catalogue import catalogue, layers, time_axis
from hil_bridge.show.charts.columns import ROW_S, TABLES, Columns, tidy
from hil_bridge.show.charts.events import fault_spans, mark_of, mark_of_step, phases_in, spans_of
from hil_bridge.show.charts.facts import ChartFacts
from hil_bridge.show.pages.description import Charts, Mark
from hil_bridge.show.terminal import Health, Scene, ViewModel
from hil_bridge.show.terminal.model import HISTORY_CYCLES
from hil_bridge.show.web.telling import (
    end_values,
    event_values,
    is_zero,
    now_values,
    scene_values,
    truth_values,
)
from hil_bridge.show.web.wire import Begin, End, Pulse

EVENTS = 200
"""Events, marks and steps that are kept of a run that continues, and events that a page shows."""
SILENT_S = 2.0
"""Time without news of the run from which the page says so. Chosen: ten pulses."""
ROWS_MOST = 8000
"""Rows of a whole recording. Chosen: more than any screen has columns."""
GONE = "gone"
"""Outcome of a run that ended without a word."""


@dataclass(slots=True)
class Cursor:
    """How far one page has been told, and where it looks."""

    rows: Mapping[str, int] = field(default_factory=dict)
    events: int = 0
    marks: int = 0
    version: int = -1
    at: float | None = None
    """Moment of a recording, s since its start; None: the newest of a run that continues."""
    moved: bool = True
    """It looks at a moment that it has not been told."""
    panel: tuple[int, int] = (0, 0)
    """Versions of the panel and of its state that it has been told."""


class Grown:
    """The records of a run so far. Of one that continues the newest are kept, and what a page never forgets."""

    def __init__(self, bounded: bool) -> None:
        def kept(most: int) -> MutableSequence[Any]:
            return deque(maxlen=most) if bounded else []

        self.cycles: MutableSequence[CycleRecord] = kept(HISTORY_CYCLES)
        self.truths: MutableSequence[TruthRecord] = kept(1)
        self.sensors: MutableSequence[SensorRecord] = kept(1)
        self.events: MutableSequence[EventRecord] = kept(EVENTS)
        self.steps: MutableSequence[StepRecord] = kept(EVENTS)
        self.marks: MutableSequence[Mark] = kept(EVENTS)
        self.phases: MutableSequence[EventRecord] = kept(EVENTS)
        self.faults: MutableSequence[EventRecord] = kept(EVENTS)
        self.zeros: MutableSequence[EventRecord] = kept(1)
        self.track: CycleRecord | None = None
        """The first cycle that tracked."""
        self.stop: EventRecord | None = None
        self.event_count = self.mark_count = 0

    def take(self, record: Record, began: float) -> None:
        """Take a record; `began` is the time at x = 0."""
        match record:
            case CycleRecord():
                self.cycles.append(record)
                if self.track is None and record.phase == "track":
                    self.track = record
            case TruthRecord():
                self.truths.append(record)
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
        """The view's values by the records until a moment."""
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


class Teller:
    """Tells pages of one run. Times of a page are seconds since the run's first record."""

    def __init__(
        self,
        begin: Begin,
        heard_at: float = 0.0,
        length_s: float | None = None,
        facts: ChartFacts | None = None,
    ) -> None:
        """`heard_at` is the present time of this process's own clock, s. `length_s` is that of a whole recording, whose
        moments a page may ask for; its memory is not bounded.
        """
        self._begin, self._facts = begin, facts or begin.scene.chart_facts
        self._length_s = length_s
        self._version = 0
        self._grown = Grown(bounded=length_s is None)
        self._began: float | None = None
        self._columns: Columns | None = None
        self._pulse = Pulse(0.0, Health())
        self._heard_at = heard_at
        self._end: Mapping[str, Any] | None = None
        self.counters: Mapping[str, Any] = {}
        """Counters of a whole recording, which has none of a moment."""
        self.over = False
        """The run has gone, and nothing more will come."""

    # --- what the run tells

    def begin(self, begin: Begin) -> None:
        """More is known of the run: every page restarts."""
        self._begin, self._facts = begin, begin.scene.chart_facts
        self._version += 1

    def take(self, record: Record) -> None:
        """Take a record."""
        match record:
            case CycleRecord():
                self._since(record.started_at).cycle(record)
            case TruthRecord() if self._columns is not None:
                self._columns.truth(record)
            case EventRecord() | StepRecord():
                self._since(record.at)
            case _:
                pass
        self._grown.take(record, self._began or 0.0)

    def _since(self, at: float) -> Columns:
        """The columns; the first record begins the time of the page."""
        if self._columns is None:
            self._began = at
            if self._length_s is None:
                self._columns = Columns(at, self._facts)
            else:
                self._columns = Columns(at, self._facts, max(ROW_S, self._length_s / ROWS_MOST), None)
        return self._columns

    def pulse(self, pulse: Pulse, heard_at: float) -> None:
        """Take a pulse of the run."""
        self._since(pulse.now)
        self._pulse, self._heard_at = pulse, heard_at

    def end(self, end: End) -> None:
        """The run has ended."""
        self._end = end_values(end.facts)

    def lost(self, cause: str = "the run's process ended without a word") -> None:
        """The run has gone without a word."""
        if self._end is None:
            self._end = {"outcome": GONE, "cause": cause, "left": "", "retracted": None, "followed": []}

    # --- what pages ask

    def first(self) -> Cursor:
        """A page that knows nothing; of a recording it looks at the end."""
        return Cursor(at=self._length_s)

    def asked(self, state: Any, message: Mapping[str, Any]) -> None:
        """Go to a moment of a recording: `{"at": seconds}`. Raises ValueError."""
        if self._length_s is None:
            raise ValueError("a page of a run asks for nothing")
        at = message.get("at")
        if set(message) != {"at"} or isinstance(at, bool) or not isinstance(at, (int, float)):
            raise ValueError("a page of a recording asks for a moment")
        if not math.isfinite(at):
            raise ValueError("a moment must be a number")
        state.at, state.moved = min(max(0.0, float(at)), self._length_s), True

    def news(self, state: Any) -> Mapping[str, Any] | None:
        """News since the last call for this state; None for none."""
        if state.at is not None and not state.moved:
            return None
        return self.tell(state, time.monotonic())

    def tell(self, cursor: Cursor, present: float) -> dict[str, Any]:
        """News for a page since its cursor, which moves on. `present` is the time of this process's own clock, s."""
        began = self._began or 0.0
        passed = 0.0 if self._end is not None else max(0.0, present - self._heard_at)
        now = self._pulse.now + passed if cursor.at is None else began + cursor.at
        news: dict[str, Any] = {}
        if cursor.version != self._version:
            news |= self._whole(cursor)
        news |= self._moment(now, math.inf if cursor.at is None else now, passed)
        news |= self._news_of(cursor, now)
        if cursor.at is not None:
            news["at"] = tidy(cursor.at)
        cursor.moved = False
        if self._end is not None:
            news["end"] = self._end
        return news

    def _whole(self, cursor: Cursor) -> dict[str, Any]:
        """Begin a page from nothing."""
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
        news = {"scene": scene_values(scene), "charts": msgspec.to_builtins(charts)}
        return news if self._length_s is None else news | {"playback": {"begin": 0.0, "end": self._length_s}}

    def _moment(self, now: float, until: float, silent_s: float) -> dict[str, Any]:
        """The values of a moment, by the records until then."""
        grown, health = self._grown, self._pulse.health
        if self._length_s is not None:
            frame = _newest(grown.sensors, until)
            health = Health(sensor_at=None if frame is None else frame.at)
        snapshot = grown.model(self._begin.scene, self._began or 0.0, until).snapshot(now, health)
        zero, pulse = _newest(grown.zeros, until), self._pulse
        news = now_values(snapshot) | {
            "zero": "" if zero is None else zero.text,
            "dropped": pulse.dropped,
            "silent_s": tidy(silent_s) if silent_s > SILENT_S else 0,
            "warning": pulse.warning,
        }
        news["check"] = news["check"] or pulse.check
        moment: dict[str, Any] = {"now": news | dict(self.counters)}
        if (truth := _newest(grown.truths, until)) is not None:
            moment["truth"] = truth_values(truth)
        return moment

    def _news_of(self, cursor: Cursor, now: float) -> dict[str, Any]:
        """Rows, events, marks and spans that the page was not told yet."""
        grown, began = self._grown, self._began or 0.0
        news: dict[str, Any] = {"events": [], "marks": []}
        if self._columns is not None:
            if rows := self._columns.since(cursor.rows):
                news["rows"] = rows
            cursor.rows = self._columns.counts
            news["approach"] = self._columns.approach
        news["marks"] = msgspec.to_builtins(_last(grown.marks, grown.mark_count - cursor.marks))
        cursor.marks = grown.mark_count
        if cursor.at is None:
            events = _last(grown.events, grown.event_count - max(cursor.events, 0))
            cursor.events = grown.event_count
        else:
            events = _until(grown.events, now, "at", EVENTS)
            news["events_whole"] = True
        news["events"] = [event_values(event, began) for event in events]
        until = now if self._length_s is None else began + self._length_s
        spans = spans_of(phases_in(grown.phases), list(grown.steps), began, until)
        news["spans"] = msgspec.to_builtins([*spans, *fault_spans(grown.faults, began, until)])
        return news


def _until(records: Sequence[Any], now: float, name: str, most: int) -> list[Any]:
    """The newest records at a moment, oldest first."""
    count = bisect_right(records, now, key=lambda record: getattr(record, name))
    return list(islice(records, max(0, count - most), count))


def _newest(records: Sequence[Any], now: float) -> Any:
    number = bisect_right(records, now, key=lambda record: record.at)
    return records[number - 1] if number else None


def _last(items: Sequence[Any], count: int) -> list[Any]:
    return [] if count <= 0 else list(items)[-count:]
