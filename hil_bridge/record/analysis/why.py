"""Why a run ended, in one paragraph of plain words, from its recording alone."""

import math
from collections.abc import Iterator
from itertools import pairwise

from msgspec import Struct

from hil_bridge.errors.cause_row import LOOK
from hil_bridge.errors.cause_table import ROWS
from hil_bridge.errors.causes import Cause, Part, describe_lateness
from hil_bridge.errors.event_kinds import EventKind
from hil_bridge.record.analysis.steps import failed_criteria, step_outcomes
from hil_bridge.record.analysis.summary import RETRACT, end_of, phases
from hil_bridge.record.device_facts import devices_of
from hil_bridge.record.ending import (
    Outcome,
    RunEnd,
)
from hil_bridge.record.reader import Recording
from hil_bridge.record.records import CycleRecord, EventRecord, FaultNote, SensorRecord

CALM_S = 3.0
"""Events before the last good cycle, and before so long a calm, belong to no trouble of the end, s. Chosen: a
line of 9600 baud waits 2 s for an answer before it tells that none came.
"""
SILENT_FRAMES = 20
"""Frames that did not come, or did not change, before a sensor counts as silent or as stuck. Chosen: one or two are
lost on a wire now and then.
"""
_MISLED_BY_LATENESS = frozenset((Part.ROBOT, Part.ROBOT_LINK, Part.POSE, Part.SENSOR))
"""Parts that look at fault where the computer was late: their orders, reports and samples came late."""
_SYMPTOM_FREE = frozenset(
    (
        EventKind.PHASE,
        EventKind.CHECK,
        EventKind.STOP,
        EventKind.TRACEBACK,
        EventKind.BUG,
        EventKind.THEN,
        EventKind.FAULT,
        EventKind.SIGNAL,
        EventKind.OPERATOR,
        EventKind.STEP,
    )
)
"""Kinds of events that tell of the course or of the end, not of trouble before it."""


def why(recording: Recording, file: object = "FILE") -> str:
    """How the run ended: last good cycle, first symptom, cause, what followed, where the tool is, what to look at.

    One sentence for a run that completed. `file` names the recording for commands to give next. Times count from the
    start of the recording.
    """
    if recording.foreign is not None:
        return "It is a bag of ROS 2: no end and no cause is told in it."
    end = end_of(recording)
    if end.outcome is Outcome.COMPLETED:
        return _describe_completed(recording, end)
    return _Ending(recording, end, file).text


class LastCycle(Struct, frozen=True):
    """The last good cycle of a run."""

    cycle: int
    before_s: float
    """Time before the end, s."""
    force_n: float
    depth_mm: float


class Symptom(Struct, frozen=True):
    """The first symptom of the trouble that ended a run."""

    kind: str
    text: str
    before_s: float
    """Time before the end, s."""


class Why(Struct, frozen=True):
    """How a run ended, as values; those of the end have the names of the recording's metadata."""

    outcome: Outcome
    text: str
    """The paragraph."""
    after_s: float
    """Time of the end from the start of the recording, s."""
    phase: str
    """Phase in which it ended; empty before the first."""
    step: str
    """Label of the program's step in which it ended; empty without one."""
    cycles: int
    cause: Cause | None
    """Row of the table of causes."""
    fact: str
    """The cause in words; empty without one."""
    remedy: str
    last_good: LastCycle | None
    first_symptom: Symptom | None
    followed: tuple[str, ...]
    """Causes after the first one, in words."""
    left: str
    """Place at which the tool was left, in words."""
    retracted: bool | None
    truncated: bool
    """The recording is cut short or damaged."""
    tracebacks: tuple[str, ...]


def why_values(recording: Recording, file: object = "FILE") -> Why:
    """Return the explanation of `why` as values."""
    end, ending = end_of(recording), _Ending(recording, end_of(recording), file)
    reason, good, symptom = end.reason, ending.last_good(), ending.symptom
    return Why(
        end.outcome,
        why(recording, file),
        ending.after_s,
        ending.phase,
        ending.step,
        len(recording.cycles),
        end.cause,
        "" if reason is None else reason.fact,
        "" if reason is None else reason.remedy,
        None
        if good is None
        else LastCycle(good.cycle, ending.before_s(good.answered_at), good.force, good.depth * 1e3),
        None if symptom is None else Symptom(symptom.kind, symptom.text, ending.before_s(symptom.at)),
        tuple(one.fact for one in end.followed),
        end.left,
        end.retracted,
        recording.truncated,
        tracebacks(recording),
    )


def tracebacks(recording: Recording) -> tuple[str, ...]:
    """Tracebacks of code that failed in a run, oldest first."""
    return tuple(
        event.text for event in recording.events if event.kind in (EventKind.TRACEBACK, EventKind.BUG)
    )


def _describe_completed(recording: Recording, end: RunEnd) -> str:
    seconds = sum(span.end - span.begin for span in phases(recording))
    text = f"The run completed after {seconds:.1f} s and {len(recording.cycles)} cycles"
    text += f", ended by its task: {end.text}" if end.text else ", as it was meant to"
    unmet = failed_criteria(step_outcomes(recording.steps))
    left = f"; the tool was left {end.left}" if end.left else ""
    return f"{text}{left}{unmet and f'; but {unmet}'}."


class _Ending:
    """The end of a run that did not complete, sentence by sentence."""

    def __init__(self, recording: Recording, end: RunEnd, file: object) -> None:
        self._recording, self._file = recording, file
        self._end = end
        self._cycles = recording.cycles
        times = [event.at for event in recording.events] + [cycle.started_at for cycle in self._cycles[:1]]
        self._zero = min(times, default=0.0)
        self._at = self._find_end()
        """When the reason of the end came up, s on the run's clock."""
        self.symptom = _first_symptom(recording, self._at)

    def _find_end(self) -> float:
        """When the run was stopped or asked to end; the last time of the recording where that is not told."""
        events, cause = self._recording.events, self._end.cause
        moments = [event.at for event in events if event.kind == EventKind.STOP]
        if not self._is_cut:
            moments += [cycle.sample.now for cycle in self._cycles if cycle.asked]
            moments += [event.at for event in events if event.cause is not None and event.cause is cause]
        lasts = [event.at for event in events]
        lasts += [cycle.answered_at for cycle in self._cycles[-1:] if math.isfinite(cycle.answered_at)]
        return moments[0] if moments else max(lasts, default=self._zero)

    @property
    def _is_cut(self) -> bool:
        """Whether the recording ends before the run does."""
        return self._recording.truncated or not self._recording.end

    @property
    def text(self) -> str:
        """The paragraph."""
        sentences = [
            self._how(),
            self._last_good(),
            self._first_symptom(),
            self._cause(),
            *self._beside(),
            self._left(),
            self._look(),
        ]
        return " ".join(sentence for sentence in sentences if sentence)

    @property
    def after_s(self) -> float:
        """Time of the end from the start of the recording, s."""
        return self._at - self._zero

    @property
    def phase(self) -> str:
        """Phase in which it ended; empty before the first. The retraction that the end began does not count."""
        spans = [span for span in phases(self._recording) if span.begin < self._at]
        if spans and spans[-1].name == RETRACT and not self._went_back(spans[-1].begin):
            spans.pop()
        return spans[-1].name if spans else ""

    def _went_back(self, begin: float) -> bool:
        """Whether a cycle of the retraction that began at this time was over before the end, s on the run's clock."""
        return any(
            cycle.phase == RETRACT and begin <= cycle.answered_at <= self._at for cycle in self._cycles
        )

    @property
    def step(self) -> str:
        """Label of the program's step in which it ended; empty without one."""
        if self._end.reason is not None and self._end.reason.step:
            return self._end.reason.step
        numbers = [cycle.step for cycle in self._cycles if cycle.asked]
        return next((step.label for step in self._recording.steps if step.step in numbers[:1]), "")

    def before_s(self, at: float) -> float:
        """Time of a moment before the end, s."""
        return self._at - at

    def last_good(self) -> CycleRecord | None:
        """Return the last cycle before the end and its first symptom; None if there is none."""
        limit = self._at if self.symptom is None else min(self._at, self.symptom.at)
        good = [
            cycle
            for cycle in self._cycles
            if cycle.answered_at <= limit and cycle.verdict != "stop" and not cycle.asked
        ]
        return good[-1] if good else None

    def _how(self) -> str:
        phase = f", in the phase {self.phase}" if self.phase else ""
        when = f"{self.after_s:.2f} s after its start{phase}"
        if self._is_cut:
            return (
                f"The recording ends {when}, before the run does: the process was killed, or the file is cut."
            )
        if self._end.outcome is Outcome.INTERRUPTED:
            step = f", in step {self.step}" if self.step else ""
            return f"The run was interrupted {when}{step}."
        return f"The run was stopped {when}."

    def _last_good(self) -> str:
        if not self._cycles:
            return "It had no control cycle: the tool had not gone towards the surface."
        last = self.last_good()
        if last is None:
            return "No cycle of it was good."
        return (
            f"The last good cycle was number {last.cycle}, {_before(self._at - last.answered_at)}: "
            f"{last.force:.1f} N at a depth of {last.depth * 1e3:.1f} mm."
        )

    def _first_symptom(self) -> str:
        if self.symptom is None:
            return ""
        return f"The first symptom came {_before(self._at - self.symptom.at)}: {self.symptom.text}."

    def _cause(self) -> str:
        reason = self._end.reason
        if self._recording.truncated:
            return ""
        if reason is None:
            return "The recording tells no cause."
        if self._end.outcome is Outcome.INTERRUPTED:
            asked = _ASKED.get(reason.cause, "").format(by=self._by(reason.cause))
            return f"It was ended by {asked}." if asked else _sentence(reason.text)
        row = ROWS[reason.cause]
        blamed = self._named(row.blames)
        if reason.late_s and row.part in _MISLED_BY_LATENESS:
            late = describe_lateness(reason.late_s)
            return f"{_sentence(late)[:-1]} just before. That, or {blamed}, ended it: {reason.fact}."
        return f"What ended it was {blamed}: {reason.fact}."

    def _by(self, cause: Cause) -> str:
        """Return the key, or the signal, that the operator used."""
        return next((event.by for event in self._recording.events if event.cause is cause), "")

    def _beside(self) -> Iterator[str]:
        reason = self._end.reason
        if reason is not None and reason.late_s and ROWS[reason.cause].part not in _MISLED_BY_LATENESS:
            yield f"{_sentence(describe_lateness(reason.late_s))[:-1]} just before."
        if self._end.followed:
            yield "Then: " + "; ".join(reason.fact for reason in self._end.followed) + "."
        for event in reversed(self._recording.events):
            if event.fault is not None and event.fault.is_injected and event.at <= self._at:
                when = _before(self._at - event.at)
                yield f"A fault had been injected on purpose {when}: {_fault_words(event.fault)}."
                break

    def _left(self) -> str:
        if not self._end.left:
            return "" if self._recording.truncated else "The tool had not been moved."
        return f"The tool was left {self._end.place}."

    def _look(self) -> str:
        reason = self._end.reason
        if reason is None or self._end.outcome is not Outcome.STOPPED:
            looks = []
        else:
            looks = [self._named(ROWS[reason.cause].look)]
            if reason.late_s:
                looks.insert(0, LOOK[Part.COMPUTER])
        if self._end.retracted is False:
            looks.append("lift the tool off with `hil-bridge free`")
        remedy = f"The message continues: {reason.remedy}. " if reason is not None and reason.remedy else ""
        return remedy + (f"Look at: {'; '.join(looks)}." if looks else "")

    def _named(self, words: str) -> str:
        """Words of the table with the kinds of robot and sensor of this run, and the name of its recording."""
        devices = devices_of(self._recording)
        robot, sensor = devices.robot.kind, devices.sensor.kind
        return words.format(
            robot=robot and f" ({robot})", sensor=sensor and f" ({sensor})", recording=self._file
        )


_ASKED = {Cause.KEY: "the key {by}", Cause.PAGE: "the page in the browser", Cause.SIGNAL: "{by}"}
"""How an operator asked for the end, in words."""


def _fault_words(fault: FaultNote) -> str:
    """Describe a fault and its parameters."""
    values = [f"{name} {value:g}" for name, value in fault.values.items()]
    values += [f"{name} {word}" for name, word in fault.words.items()]
    return f"{fault.title} ({', '.join(values)})" if values else fault.title


def _first_symptom(recording: Recording, stopped_at: float) -> EventRecord | None:
    """Return the earliest fault of the row that led to the stop; None if only the stop itself is known."""
    found: list[EventRecord] = []
    told = [event for event in recording.events if event.kind not in _SYMPTOM_FREE and event.at <= stopped_at]
    since = stopped_at
    last = max((c.answered_at for c in recording.cycles if c.answered_at <= stopped_at), default=-math.inf)
    for event in reversed(told):
        if event.at < last and since - event.at > CALM_S:
            break
        since = event.at
        found.append(event)
    first = (
        [EventRecord(found[-1].at, found[-1].kind, f"{found[-1].kind}: {found[-1].text}")] if found else []
    )
    first += _quiet_sensor(recording.sensors, stopped_at)
    first += _find_clamped(recording.cycles, stopped_at)
    return min(first, key=lambda event: event.at, default=None)


def _quiet_sensor(sensors: tuple[SensorRecord, ...], stopped_at: float) -> Iterator[EventRecord]:
    """Report that the sensor had fallen silent, or repeated its values."""
    before = [frame for frame in sensors if frame.at <= stopped_at]
    if len(before) <= SILENT_FRAMES:
        return
    steps = sorted(after.at - frame.at for frame, after in pairwise(before[-10 * SILENT_FRAMES :]))
    usual = steps[len(steps) // 2]
    last = before[-1]
    if stopped_at - last.at > SILENT_FRAMES * usual > 0.0:
        yield EventRecord(last.at, EventKind.SENSOR, "the last frame of the force sensor")
    place = len(before) - 1
    while place and before[place - 1].counts == last.counts:
        place -= 1
    if len(before) - place > SILENT_FRAMES:
        yield EventRecord(
            before[place].at, EventKind.SENSOR, "from here on the force sensor told the same values"
        )


def _find_clamped(cycles: tuple[CycleRecord, ...], stopped_at: float) -> Iterator[EventRecord]:
    """Report that the guard had clamped every order up to the stop."""
    first = None
    for cycle in reversed(cycles):
        if cycle.controlled_at >= stopped_at or cycle.verdict == "stop":
            continue
        if cycle.verdict != "clamp":
            break
        first = cycle
    if first is not None:
        yield EventRecord(
            first.controlled_at, "guard", f"the guard limited the order: {', '.join(first.reasons)}"
        )


def _before(seconds: float) -> str:
    return f"{seconds:.2f} s before that" if seconds >= 0.005 else "at that moment"


def _sentence(text: str) -> str:
    return f"{text[:1].upper()}{text[1:]}." if text else ""
