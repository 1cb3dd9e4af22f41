"""Why a run ended, in one paragraph of plain words, from its recording alone."""

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

from hil_bridge.devices.facts import Devices
from hil_bridge.errors.failures import TRACEBACK_EVENT
from hil_bridge.record.analysis.steps import failed_criteria, step_outcomes
from hil_bridge.record.analysis.summary import end_of, phases
from hil_bridge.record.device_facts import devices_of
from hil_bridge.record.ending import (
    ASKED_BY_KEY,
    ASKED_BY_PAGE,
    CHECK_EVENT,
    PHASE_EVENT,
    STOP_EVENT,
    Outcome,
    RunEnd,
)
from hil_bridge.record.reader import Recording
from hil_bridge.record.records import CycleRecord, EventRecord, SensorRecord

CALM_S = 3.0
"""Events before the last good cycle, and before so long a calm, belong to no trouble of the end, s. Chosen: a
line of 9600 baud waits 2 s for an answer before it tells that none came.
"""
SILENT_FRAMES = 20
"""Frames that did not come, or did not change, before a sensor counts as silent or as stuck. Chosen: one or two are
lost on a wire now and then.
"""
_FAULT_EVENT, _SIGNAL_EVENT, _BUG_EVENT, _THEN_EVENT, _STEP_EVENT = "fault", "signal", "bug", "then", "step"
_OPERATOR_EVENT = "operator"
_NO_SYMPTOMS = frozenset(
    (
        PHASE_EVENT,
        CHECK_EVENT,
        STOP_EVENT,
        TRACEBACK_EVENT,
        _THEN_EVENT,
        _FAULT_EVENT,
        _SIGNAL_EVENT,
        _OPERATOR_EVENT,
        _BUG_EVENT,
        _STEP_EVENT,
    )
)
"""Kinds of events that tell of the course or of the end, not of trouble before it."""
_BEGUN = (" begins", " happens")
"""Words of the event that tells of an injected fault."""


@dataclass(frozen=True, slots=True)
class _Part:
    """A part of a cell that ends runs: how it is recognised, named, and looked at."""

    pattern: str
    """Regular expression for the beginning of the cause, or for what stands in it."""
    name: str
    look: str


_ROBOT, _SENSOR = "the robot{robot}", "the force sensor{sensor}"
_PARTS = (
    _Part(r"^(the controller|controller) ", "the controller", "the controller's own code and parameters"),
    _Part(
        r"^code of another package ended",
        "code of another package",
        "the traceback below, which stands in the recording's events",
    ),
    _Part(
        r"^the emulated cell failed|^the truth of the emulated cell failed",
        "the emulated cell, not a device",
        "the traceback below, which stands in the recording's events",
    ),
    _Part(
        r"the last gate stopped",
        "the program itself",
        "the recording, which shows the orders before; report it with the bug",
    ),
    _Part(r"^a bug ended", "the program itself or the controller", "the traceback in the recording's events"),
    _Part(
        r"^no decision for",
        "the computer that runs the bridge, or the controller",
        "what else runs on that computer, and [realtime] of the configuration",
    ),
    _Part(
        r"the robot itself feels",
        f"{_SENSOR}, or something that touches {_ROBOT} beside the sensor",
        "what the sensor reads when the tool is pressed by hand; hoses and cables of the tool; then the robot's own "
        "force, with its axes and its zero",
    ),
    _Part(
        r"robot .*(sent nothing|not acknowledged|no answer|nothing came|answered a block|taken \d+ answers|closed"
        r"|link .* stopped|lost|noise)",
        f"the link to {_ROBOT}",
        "the robot's cable, its supply and its program; `hil-bridge monitor FILE` shows the traffic",
    ),
    _Part(
        r"^cycles take ",
        f"the link to {_ROBOT}, by which a cycle takes too long",
        "the robot's cable and whatever delays its line, then limits.cycle_max_ms; `hil-bridge latency FILE` shows "
        "where the time goes",
    ),
    _Part(
        r"^the touch (is not answered|cannot be tested)",
        f"{_SENSOR}, or what the tool touches",
        "whether the sensor's reading follows a press by hand; then whether {robot} goes where it is ordered to",
    ),
    _Part(
        r"robot on |the robot does not answer|robot link ",
        _ROBOT,
        "the robot's panel and its status in the events",
    ),
    _Part(
        r"the (robot reports|reported position|reported)",
        f"the position that {_ROBOT} reports",
        "where the tool really is, and what the robot's display shows",
    ),
    _Part(
        r"^a pull of ",
        f"{_SENSOR} or its zero, or a tool that hangs on to something",
        "whether the sensor reads 0 when the tool touches nothing, and whether the tool sticks",
    ),
    _Part(
        r"force sensor|the newest force|no new force|the sensor's frame counter",
        _SENSOR,
        "the sensor's cable and supply; `hil-bridge probe sensor URL` checks its stream",
    ),
    _Part(
        r"the force stayed|sensor's zero|the sensor tells no force|did not change since the zero",
        f"{_SENSOR}, or what the tool touches",
        "whether the tool touches anything now; `hil-bridge probe sensor URL` checks the sensor",
    ),
    _Part(
        r"the force rose",
        f"what the tool touches, or {_SENSOR}",
        "what is above or beside the tool, then the sensor's signal in the report",
    ),
    _Part(
        r"contact force|resultant force|moment .* beyond|the force swings|oscillat",
        f"the contact, since {_ROBOT} went too deep, the surface is another, or {_SENSOR} tells it wrongly",
        "the force before the stop in the report: one frame that jumps is the sensor, a ramp is a touch",
    ),
    _Part(
        r"surface ended|no contact|contact lost",
        f"the surface, or {_SENSOR} that does not feel it",
        "where the tool stands above the surface, and whether the sensor's sign is right",
    ),
    _Part(r"workspace", "the path", "limits.workspace_m of the configuration and the start of the run"),
)


def why(recording: Recording) -> str:
    """How the run ended: last good cycle, first symptom, cause, what followed, where the tool is, what to look at.

    One sentence for a run that completed. Times count from the start of the recording.
    """
    end = end_of(recording)
    if end.outcome is Outcome.COMPLETED:
        return _completed(recording, end)
    return _Ending(recording, end).text


def tracebacks(recording: Recording) -> tuple[str, ...]:
    """Tracebacks of code that failed in a run, oldest first."""
    return tuple(event.text for event in recording.events if event.kind in (TRACEBACK_EVENT, _BUG_EVENT))


def _completed(recording: Recording, end: RunEnd) -> str:
    seconds = sum(span.end - span.begin for span in phases(recording))
    text = f"The run completed after {seconds:.1f} s and {len(recording.cycles)} cycles"
    text += f", ended by its task: {end.cause}" if end.cause else ", as it was meant to"
    unmet = failed_criteria(step_outcomes(recording.steps))
    left = f"; the tool was left {end.left}" if end.left else ""
    return f"{text}{left}{unmet and f'; but {unmet}'}."


class _Ending:
    """The end of a run that did not complete, sentence by sentence."""

    def __init__(self, recording: Recording, end: RunEnd) -> None:
        self._recording = recording
        self._end = end
        self._cycles = recording.cycles
        times = [event.at for event in recording.events] + [cycle.started_at for cycle in self._cycles[:1]]
        self._zero = min(times, default=0.0)
        stops = [event.at for event in recording.events if event.kind == STOP_EVENT]
        lasts = [event.at for event in recording.events] + [
            cycle.answered_at for cycle in self._cycles[-1:] if math.isfinite(cycle.answered_at)
        ]
        self._at = stops[0] if stops else max(lasts, default=self._zero)
        """When the run was stopped, s on its clock."""
        self._symptom = _first_symptom(recording, self._at)

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

    def _how(self) -> str:
        began = [span.name for span in phases(self._recording) if span.begin < self._at]
        phase = f", in the phase {began[-1]}" if began else ""
        when = f"{self._at - self._zero:.2f} s after its start{phase}"
        if self._recording.truncated or not self._recording.end:
            return (
                f"The recording ends {when}, before the run does: the process was killed, or the file is cut."
            )
        if self._end.outcome is Outcome.INTERRUPTED:
            return f"The run was interrupted {when}."
        return f"The run was stopped {when}."

    def _last_good(self) -> str:
        limit = self._at if self._symptom is None else min(self._at, self._symptom.at)
        good = [cycle for cycle in self._cycles if cycle.verdict != "stop" and cycle.answered_at <= limit]
        if not self._cycles:
            return "It had no control cycle: the tool had not gone towards the surface."
        if not good:
            return "No cycle of it was good."
        last = good[-1]
        return (
            f"The last good cycle was number {last.cycle}, {_before(self._at - last.answered_at)}: "
            f"{last.force:.1f} N at a depth of {last.depth * 1e3:.1f} mm."
        )

    def _first_symptom(self) -> str:
        if self._symptom is None:
            return ""
        told = self._symptom.text.partition(";")[0]
        return f"The first symptom came {_before(self._at - self._symptom.at)}: {told}."

    def _cause(self) -> str:
        if self._recording.truncated:
            return ""
        if self._end.outcome is Outcome.INTERRUPTED:
            events = self._recording.events
            asked = [event.text for event in events if event.kind == _OPERATOR_EVENT]
            told = [f"the key {text[len(ASKED_BY_KEY) :]}" for text in asked if text.startswith(ASKED_BY_KEY)]
            told += ["the page in the browser" for text in asked if text == ASKED_BY_PAGE]
            told += [event.text for event in events if event.kind == _SIGNAL_EVENT]
            return f"It was ended by {told[0]}." if told else _sentence(self._end.cause)
        if not self._end.cause:
            return "The recording tells no cause."
        part = self._part
        blamed = f"What ended it was {self._named(part)}: " if part else "What ended it: "
        return f"{blamed}{self._end.cause.partition(';')[0]}."

    def _beside(self) -> Iterator[str]:
        if self._end.followed:
            yield "Then: " + "; ".join(text.partition(";")[0] for text in self._end.followed) + "."
        faults = [event for event in self._recording.events if _is_injected(event) and event.at <= self._at]
        if faults:
            last = faults[-1]
            text = last.text
            for word in _BEGUN:
                text = text.partition(word)[0]
            yield f"A fault had been injected on purpose {_before(self._at - last.at)}: {text}."

    def _left(self) -> str:
        left = self._end.left
        if not left:
            return "" if self._recording.truncated else "The tool had not been moved."
        return f"The tool was left {left.partition(', because')[0].removeprefix('left ')}."

    def _look(self) -> str:
        _, _, remedy = self._end.cause.partition(";")
        part = self._part
        looks = [part.look] if part is not None else []
        if "NOT retracted" in self._end.left:
            looks.append("lift the tool off with `hil-bridge free`")
        told = f"The message goes on: {remedy.strip()}. " if remedy.strip() else ""
        return told + (f"Look at: {'; '.join(looks)}." if looks else "")

    @property
    def _part(self) -> _Part | None:
        """The part that the cause blames."""
        cause = self._end.cause.partition(";")[0]
        if self._end.outcome is not Outcome.STOPPED or not cause:
            return None
        if cause == "a measurement or command is no number":
            return _no_number(self._cycles)
        devices = devices_of(self._recording)
        kind = devices.robot.kind
        if kind and re.match(rf"\S*\b{re.escape(kind)}\b", cause):  # only the wire is named
            cause = f"robot on {cause}"
        return next((part for part in _PARTS if re.search(part.pattern, cause)), None)

    def _named(self, part: _Part) -> str:
        devices: Devices = devices_of(self._recording)
        robot, sensor = devices.robot.kind, devices.sensor.kind
        return part.name.format(robot=robot and f" ({robot})", sensor=sensor and f" ({sensor})")


def _first_symptom(recording: Recording, stopped_at: float) -> EventRecord | None:
    """The earliest trouble of the row that led to the stop; None where the stop itself is all that is known."""
    found: list[EventRecord] = []
    told = [event for event in recording.events if event.kind not in _NO_SYMPTOMS and event.at <= stopped_at]
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
    first += _clamped(recording.cycles, stopped_at)
    return min(first, key=lambda event: event.at, default=None)


def _quiet_sensor(sensors: tuple[SensorRecord, ...], stopped_at: float) -> Iterator[EventRecord]:
    """That the sensor had fallen silent, or told the same again and again."""
    before = [frame for frame in sensors if frame.at <= stopped_at]
    if len(before) <= SILENT_FRAMES:
        return
    steps = sorted(after.at - frame.at for frame, after in pairwise(before[-10 * SILENT_FRAMES :]))
    usual = steps[len(steps) // 2]
    last = before[-1]
    if stopped_at - last.at > SILENT_FRAMES * usual > 0.0:
        yield EventRecord(last.at, "sensor", "the last frame of the force sensor")
    place = len(before) - 1
    while place and before[place - 1].counts == last.counts:
        place -= 1
    if len(before) - place > SILENT_FRAMES:
        yield EventRecord(before[place].at, "sensor", "from here on the force sensor told the same values")


def _clamped(cycles: tuple[CycleRecord, ...], stopped_at: float) -> Iterator[EventRecord]:
    """That the guard had clamped every order up to the stop."""
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


def _no_number(cycles: tuple[CycleRecord, ...]) -> _Part:
    """Which device told what is no number, by the last cycle."""
    wanted = "the robot reports" if not cycles or _finite(cycles[-1].wrench) else "force sensor"
    return next(part for part in _PARTS if re.search(part.pattern, wanted))


def _finite(values: tuple[float, ...]) -> bool:
    return all(map(math.isfinite, values))


def _is_injected(event: EventRecord) -> bool:
    return event.kind == _FAULT_EVENT and any(word in event.text for word in _BEGUN)


def _before(seconds: float) -> str:
    return f"{seconds:.2f} s before that" if seconds >= 0.005 else "at that moment"


def _sentence(text: str) -> str:
    return f"{text[:1].upper()}{text[1:]}." if text else ""
