"""Explanation of why a run ended, as one paragraph, computed only from its recording."""

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
from hil_bridge.record.device_facts import devices_of, is_beyond_run
from hil_bridge.record.ending import (
    Outcome,
    RunEnd,
)
from hil_bridge.record.reader import Recording
from hil_bridge.record.records import CycleRecord, EventRecord, FaultNote, SensorRecord

CALM_S = 3.0
"""Length of the quiet interval that separates the events of the end from earlier events, s.

It lies before the last good cycle. Chosen: a link at 9600 baud waits 2 s for a response before it reports a
timeout.
"""
SILENT_FRAMES = 20
"""Number of missing or unchanged frames after which a sensor counts as silent or stuck. Chosen: one or two frames
may get lost on a wire.
"""
_MISLED_BY_LATENESS = frozenset((Part.ROBOT, Part.ROBOT_LINK, Part.POSE, Part.SENSOR))
"""Parts that appear to be at fault when the computer was late, because their orders, reports and samples came late."""
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
"""Kinds of events that report the progress or the end of a run, not trouble before the end."""


def why(recording: Recording, file: object = "FILE") -> str:
    """Explain how the run ended: last good cycle, first symptom, cause, consequences, tool position, what to check.

    Returns one sentence for a completed run. `file` names the recording in suggested commands. Times count from the
    start of the recording.
    """
    if recording.foreign is not None:
        return "It is a ROS 2 bag: it contains neither an end nor a cause."
    end = end_of(recording)
    if end.outcome is Outcome.COMPLETED:
        return _describe_completed(recording, end)
    return _Ending(recording, end, file).text


class LastCycle(Struct, frozen=True):
    """Last good cycle of a run."""

    cycle: int
    before_s: float
    """Time from the cycle to the end of the run, s."""
    force_n: float
    depth_mm: float


class Symptom(Struct, frozen=True):
    """First symptom of the trouble that ended a run."""

    kind: str
    text: str
    before_s: float
    """Time from the symptom to the end of the run, s."""


class Why(Struct, frozen=True):
    """Values that describe how a run ended.

    The values of the end have the same names as in the recording's metadata.
    """

    outcome: Outcome
    text: str
    """Complete paragraph of the explanation."""
    after_s: float
    """Time from the start of the recording to the end of the run, s."""
    phase: str
    """Phase in which the run ended; empty before the first phase."""
    step: str
    """Label of the program step in which the run ended; empty without a program."""
    cycles: int
    cause: Cause | None
    """Row of the table of causes."""
    fact: str
    """Description of the cause; empty without a cause."""
    facts: str
    """What else the device stated, such as its status; empty if there is nothing."""
    remedy: str
    last_good: LastCycle | None
    first_symptom: Symptom | None
    followed: tuple[str, ...]
    """Descriptions of the causes after the first one."""
    left: str
    """Description of the final position of the tool."""
    retracted: bool | None
    truncated: bool
    """Whether the recording is cut short or damaged."""
    tracebacks: tuple[str, ...]

    @property
    def point(self) -> str:
        """How the run ended and its cause, in one sentence; without a cause, the complete paragraph."""
        if not self.fact:
            return self.text
        phase = f" in {self.phase}" if self.phase else ""
        return f"{self.outcome.capitalize()} after {self.after_s:.1f} s{phase}: {self.fact}."


def why_values(recording: Recording, file: object = "FILE") -> Why:
    """Return the explanation of `why` as values."""
    end, ending = end_of(recording), _Ending(recording, end_of(recording), file)
    reason = end.reason if recording.foreign is None else None
    good, symptom = ending.last_good(), ending.symptom
    return Why(
        end.outcome,
        why(recording, file),
        ending.after_s,
        ending.phase,
        ending.step,
        len(recording.cycles),
        end.cause,
        "" if reason is None else reason.fact,
        "" if reason is None else reason.facts,
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
    """Return the tracebacks of all code that failed in a run, oldest first."""
    return tuple(
        event.text for event in recording.events if event.kind in (EventKind.TRACEBACK, EventKind.BUG)
    )


def _describe_completed(recording: Recording, end: RunEnd) -> str:
    seconds = sum(span.end - span.begin for span in phases(recording))
    count = len(recording.cycles)
    text = f"The run completed after {seconds:.1f} s and {count} cycle{'s' * (count != 1)}"
    text += f", ended by its task: {end.text}" if end.text else ", as planned"
    unmet = failed_criteria(step_outcomes(recording.steps))
    left = f"; the tool was {end.left}" if end.left else ""
    return f"{text}{left}{unmet and f'; but {unmet}'}."


class _Ending:
    """End of a run that did not complete, with a description of one sentence per aspect."""

    def __init__(self, recording: Recording, end: RunEnd, file: object) -> None:
        self._recording, self._file = recording, file
        self._end = end
        self._cycles = recording.cycles
        times = [event.at for event in recording.events] + [cycle.started_at for cycle in self._cycles[:1]]
        self._zero = min(times, default=0.0)
        self._at = self._find_end()
        """Time at which the cause of the end occurred, s on the run's clock."""
        self.symptom = _first_symptom(recording, self._at)

    def _find_end(self) -> float:
        """Return the time at which the run was stopped or requested to end.

        If that is unknown, it is the last time of the recording.
        """
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
        """Return whether the recording ends before the end of the run."""
        return self._recording.truncated or not self._recording.end

    @property
    def text(self) -> str:
        """Complete paragraph of the explanation."""
        sentences = [
            self._course(),
            self._last_good(),
            self._first_symptom(),
            self._cause(),
            *self._beside(),
            self._left(),
            self._advice(),
        ]
        return " ".join(sentence for sentence in sentences if sentence)

    @property
    def after_s(self) -> float:
        """Time from the start of the recording to the end of the run, s."""
        return self._at - self._zero

    @property
    def phase(self) -> str:
        """Phase in which the run ended; empty before the first phase.

        A retraction that the end itself started does not count.
        """
        spans = [span for span in phases(self._recording) if span.begin < self._at]
        if spans and spans[-1].name == RETRACT and not self._has_retracted(spans[-1].begin):
            spans.pop()
        return spans[-1].name if spans else ""

    def _has_retracted(self, begin: float) -> bool:
        """Return whether a cycle of the retraction completed before the end.

        `begin` is the start of the retraction, s on the run's clock.
        """
        return any(
            cycle.phase == RETRACT and begin <= cycle.answered_at <= self._at for cycle in self._cycles
        )

    @property
    def step(self) -> str:
        """Label of the program step in which the run ended; empty without a program."""
        if self._end.reason is not None and self._end.reason.step:
            return self._end.reason.step
        numbers = [cycle.step for cycle in self._cycles if cycle.asked]
        return next((step.label for step in self._recording.steps if step.step in numbers[:1]), "")

    def before_s(self, at: float) -> float:
        """Return the duration from this time to the end, s."""
        return self._at - at

    def last_good(self) -> CycleRecord | None:
        """Return the last good cycle before the end; None if there is no such cycle."""
        limit = self._at if self.symptom is None else min(self._at, self.symptom.at)
        good = [
            cycle
            for cycle in self._cycles
            if cycle.answered_at <= limit and cycle.verdict != "stop" and not cycle.asked
        ]
        return good[-1] if good else None

    def _course(self) -> str:
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
            return "There was no control cycle: the tool had not moved towards the surface."
        last = self.last_good()
        if last is None:
            return "It had no good cycle."
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
            return "The recording contains no cause."
        if self._end.outcome is Outcome.INTERRUPTED:
            request = _REQUESTS.get(reason.cause, "").format(by=self._operator_input(reason.cause))
            return f"It was ended by {request}." if request else sentence(reason.text)
        row = ROWS[reason.cause]
        blamed = self._fill_names(row.blames)
        if reason.late_s and row.part in _MISLED_BY_LATENESS:
            late = describe_lateness(reason.late_s)
            return f"{sentence(late)[:-1]} just before. That, or {blamed}, ended it: {reason.fact}."
        return f"The cause was {blamed}: {reason.fact}."

    def _operator_input(self, cause: Cause) -> str:
        """Return the key or signal that the operator used."""
        return next((event.by for event in self._recording.events if event.cause is cause), "")

    def _beside(self) -> Iterator[str]:
        reason = self._end.reason
        if reason is not None and reason.late_s and ROWS[reason.cause].part not in _MISLED_BY_LATENESS:
            yield f"{sentence(describe_lateness(reason.late_s))[:-1]} just before."
        if self._end.followed:
            yield "Then: " + "; ".join(reason.fact for reason in self._end.followed) + "."
        for event in reversed(self._recording.events):
            if event.fault is not None and event.fault.is_injected and event.at <= self._at:
                when = _before(self._at - event.at)
                yield f"A fault had been injected on purpose {when}: {_describe_fault(event.fault)}."
                break

    def _left(self) -> str:
        if not self._end.left:
            return "" if self._recording.truncated else "The tool had not been moved."
        return f"The tool was {self._end.place}."

    def _advice(self) -> str:
        reason = self._end.reason
        if reason is None or self._end.outcome is not Outcome.STOPPED:
            checks = []
        else:
            checks = [self._fill_names(ROWS[reason.cause].look)]
            if reason.late_s:
                checks.insert(0, LOOK[Part.COMPUTER])
        if self._end.retracted is False and is_beyond_run(self._recording):
            checks.append("lift the tool off with `hil-bridge free`")
        more = "" if reason is None else "; ".join(filter(None, (reason.facts, reason.remedy)))
        return f"The message continues: {more}. " * bool(more) + (
            f"Check: {'; '.join(checks)}." if checks else ""
        )

    def _fill_names(self, text: str) -> str:
        """Insert the kinds of robot and sensor of this run, and the name of its recording."""
        devices = devices_of(self._recording)
        robot, sensor = devices.robot.kind, devices.sensor.kind
        return text.format(
            robot=robot and f" ({robot})", sensor=sensor and f" ({sensor})", recording=self._file
        )


_REQUESTS = {Cause.KEY: "the key {by}", Cause.PAGE: "the page in the browser", Cause.SIGNAL: "{by}"}
"""Descriptions of how an operator requested the end."""


def _describe_fault(fault: FaultNote) -> str:
    """Describe a fault and its parameters."""
    values = [f"{name} {value:g}" for name, value in fault.values.items()]
    values += [f"{name} {word}" for name, word in fault.words.items()]
    return f"{fault.title} ({', '.join(values)})" if values else fault.title


def _first_symptom(recording: Recording, stopped_at: float) -> EventRecord | None:
    """Return the earliest event of the trouble that led to the stop; None if only the stop itself is known."""
    linked: list[EventRecord] = []
    candidates = [
        event for event in recording.events if event.kind not in _SYMPTOM_FREE and event.at <= stopped_at
    ]
    since = stopped_at
    last = max((c.answered_at for c in recording.cycles if c.answered_at <= stopped_at), default=-math.inf)
    for event in reversed(candidates):
        if event.at < last and since - event.at > CALM_S:
            break
        since = event.at
        linked.append(event)
    first = (
        [EventRecord(linked[-1].at, linked[-1].kind, f"{linked[-1].kind}: {linked[-1].text}")]
        if linked
        else []
    )
    first += _quiet_sensor(recording.sensors, stopped_at)
    first += _find_clamped(recording.cycles, stopped_at)
    return min(first, key=lambda event: event.at, default=None)


def _quiet_sensor(sensors: tuple[SensorRecord, ...], stopped_at: float) -> Iterator[EventRecord]:
    """Return an event for a sensor that became silent or repeated its values."""
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
            before[place].at, EventKind.SENSOR, "from here on the force sensor repeated the same values"
        )


def _find_clamped(cycles: tuple[CycleRecord, ...], stopped_at: float) -> Iterator[EventRecord]:
    """Return an event if the supervisor clamped every order up to the stop."""
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


def sentence(text: str) -> str:
    """Return a text as a sentence; empty for an empty text."""
    return f"{text[:1].upper()}{text[1:]}." if text else ""
