"""A recording on the page of a run: all of its charts at once, and its values at the moment that a slider names."""

import math
from bisect import bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import msgspec
from pydantic import ValidationError

from hil_bridge.control.course.limits import Limits
from hil_bridge.devices.facts import Devices
from hil_bridge.errors import BridgeError, ConfigError
from hil_bridge.record import Recording
from hil_bridge.record.device_facts import devices_of, json_or_none, recorded_configuration
from hil_bridge.record.ending import words_of
from hil_bridge.settings.configuration import read_config
from hil_bridge.settings.devices import cell_in_words, robot_in, sensor_in
from hil_bridge.show.run_marks import fault_spans, marks, stretches
from hil_bridge.show.terminal import Health, Scene, ViewModel
from hil_bridge.show.terminal.model import HISTORY_CYCLES
from hil_bridge.show.web.columns import ROW_S, Columns, tidy
from hil_bridge.show.web.telling import (
    charts_of,
    is_zero,
    phases_in,
    spans_of,
    told_event,
    told_now,
    told_scene,
)

ROWS = 8000
"""Rows of a whole recording at most. Chosen: more than any screen has columns."""
EVENTS = 200
"""Events that are shown at most, the newest before the moment."""


@dataclass(slots=True)
class Place:
    """Where one page looks."""

    at: float
    fresh: bool = True
    """It has been told nothing yet."""
    moved: bool = True
    events: int = -1


class Playback:
    """Tells pages of a recording. Times are seconds from its first record."""

    over = False
    """A recording is there until the server is ended."""

    def __init__(self, recording: Recording, name: str) -> None:
        """`name` stands for the file. Raises ConfigError for a recording without cycles."""
        if not recording.cycles:
            raise ConfigError(f"{name} holds no cycles: the run ended before it moved")
        self._recording = recording
        self._scene = _scene(recording, name)
        first = min(recording.cycles[0].started_at, *(event.at for event in recording.events), math.inf)
        last = max(recording.cycles[-1].answered_at, recording.cycles[-1].controlled_at)
        self._began = first
        self.length_s = max((one.at - first for one in recording.events), default=0.0)
        self.length_s = max(self.length_s, last - first)
        self._cycle_times = [cycle.controlled_at for cycle in recording.cycles]
        self._truth_times = [truth.at for truth in recording.truths]
        self._frame_times = [frame.at for frame in recording.sensors]
        self._event_times = [event.at for event in recording.events]
        self._track = next((cycle for cycle in recording.cycles if cycle.phase == "track"), None)
        self._columns = Columns(first, max(ROW_S, self.length_s / ROWS), None)
        for cycle in recording.cycles:
            self._columns.cycle(cycle)
        for truth in recording.truths:
            self._columns.truth(truth)

    def first(self) -> Place:
        """A page that shows the end."""
        return Place(self.length_s)

    def asked(self, state: Any, message: Mapping[str, Any]) -> None:
        """Go to a moment: `{"at": seconds}`. Raises ValueError."""
        at = message.get("at")
        if set(message) != {"at"} or isinstance(at, bool) or not isinstance(at, (int, float)):
            raise ValueError("a page of a recording asks for a moment")
        if not math.isfinite(at):
            raise ValueError("a moment must be a number")
        state.at, state.moved = min(max(0.0, float(at)), self.length_s), True

    def news(self, state: Any) -> Mapping[str, Any] | None:
        """Everything at first, then the values of a moment that was asked for."""
        if not state.moved:
            return None
        told = self._whole() if state.fresh else {}
        state.fresh = state.moved = False
        return told | self._moment(state)

    def _whole(self) -> dict[str, Any]:
        recording, began = self._recording, self._began
        start = recording.unix_zero_ns * 1e-9 + began if recording.unix_zero_ns else None
        spans = stretches(
            spans_of(phases_in(recording.events, began), self.length_s), recording.steps, began
        ) + fault_spans(recording.events, began, self.length_s)
        end = words_of(recording.end)
        if recording.truncated:
            end |= {"outcome": "gone", "cause": "the recording was cut"}
        return {
            "scene": told_scene(self._scene),
            "charts": msgspec.to_builtins(charts_of(self._scene, start)),
            "playback": {"begin": 0.0, "end": self.length_s},
            "rows": self._columns.since({}),
            "marks": msgspec.to_builtins(marks(recording, began)),
            "spans": msgspec.to_builtins(spans),
            "end": end,
        }

    def _moment(self, place: Place) -> dict[str, Any]:
        recording, now = self._recording, self._began + place.at
        model = ViewModel(self._scene)
        model.snapshot(self._began, Health())
        count = bisect_right(self._cycle_times, now)
        if self._track is not None and self._track.controlled_at <= now:
            model.update(self._track)
        for cycle in recording.cycles[max(0, count - HISTORY_CYCLES) : count]:
            model.update(cycle)
        events = recording.events[: bisect_right(self._event_times, now)]
        for event in events:
            model.event(event)
        frame = _last(recording.sensors, self._frame_times, now)
        told: dict[str, Any] = {
            "at": tidy(place.at),
            "approach": self._columns.approach,
            "now": told_now(model.snapshot(now, Health(sensor_at=None if frame is None else frame.at))),
        }
        zeros = [event.text for event in events if is_zero(event)]
        told["now"] |= {"zero": zeros[-1] if zeros else "", "dropped": 0, "silent_s": 0, **self._counts()}
        truth = _last(recording.truths, self._truth_times, now)
        if truth is not None:
            told["truth"] = {
                "quaternion": [tidy(value) for value in truth.quaternion],
                "normal": [tidy(value) for value in truth.normal],
                "force": [tidy(value) for value in truth.force],
                "faults": list(truth.faults),
            }
        if len(events) != place.events:
            place.events = len(events)
            told["events"] = [told_event(event, self._began) for event in events[-EVENTS:]]
            told["events_whole"] = True
        return told

    def _counts(self) -> dict[str, Any]:
        """Counters of the whole run; a recording has none of a moment."""
        counters = json_or_none(self._recording.end.get("link"))
        link = counters if isinstance(counters, dict) else {}
        lost = json_or_none(self._recording.end.get("sensor_lost"))
        return {
            "link_errors": sum(link.get(name, 0) for name in self._scene.robot.errors) if link else None,
            "frames_lost": lost if isinstance(lost, int) else None,
            "traffic": [],
        }


def _last(records: Sequence[Any], times: Sequence[float], now: float) -> Any:
    number = bisect_right(times, now)
    return records[number - 1] if number else None


def _scene(recording: Recording, name: str) -> Scene:
    """Facts of a recorded run, as far as the recording tells them."""
    devices = devices_of(recording)
    recorded = recorded_configuration(recording)
    try:
        config = read_config(recorded)
        real, cell = cell_in_words(robot_in(config), sensor_in(config))
        limits, reference = config.limits, config.task.force_n
        total = None if config.task.step else config.run.duration_s
    except (BridgeError, ValidationError, TypeError, ValueError):  # of a plug-in that is not here
        real, cell = _words(devices)
        limits, reference, total = _limits(recorded), recording.cycles[0].force_reference, None
    return Scene(
        reference_n=reference,
        robot=devices.robot,
        total_s=total,
        steps=tuple(step.label for step in recording.steps),
        cell=cell,
        real=real,
        limits=limits,
        record=name,
    )


def _words(devices: Devices) -> tuple[bool, str]:
    robot, sensor = devices.robot, devices.sensor
    word = "EMULATED" if robot.emulated else "REAL"
    return not robot.emulated, f"{word}  {robot.kind}, {sensor.kind}"


def _limits(recorded: Mapping[str, Any]) -> Limits:
    try:
        return msgspec.convert(recorded.get("limits", {}), Limits)
    except (ValueError, TypeError):
        return Limits()
