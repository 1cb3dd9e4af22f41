"""Page sources of recordings. A recording of a run has a time slider; a ROS bag has its report."""

from collections.abc import Mapping
from typing import Any

import msgspec
from msgspec import Struct
from pydantic import ValidationError

from hil_bridge.control.course.limits import Limits
from hil_bridge.devices.facts import Devices
from hil_bridge.errors import BridgeError
from hil_bridge.record import Recording
from hil_bridge.record.device_facts import devices_of, json_or_none, recorded_configuration
from hil_bridge.record.next_commands import RunPlaces
from hil_bridge.settings.configuration import read_config
from hil_bridge.settings.devices import CellName, name_cell, robot_in, sensor_in
from hil_bridge.show.charts.cell import recorded_model
from hil_bridge.show.charts.facts import approach_of, facts_of_recording, start_time
from hil_bridge.show.terminal import Health, Scene
from hil_bridge.show.web.run_source import RunSource
from hil_bridge.show.web.wire import Begin, End, Pulse


class ReportState(Struct):
    """State of one report page."""

    sent: bool = False


class Report:
    """Source of a static report page."""

    over = False
    """Whether the source has no more updates. Always False: a report is displayed until the server ends."""

    def __init__(self, title: str, file: str, body: str) -> None:
        """`body` is trusted HTML. `file` is the displayed name of the reported file."""
        self._page = {"title": title, "file": file, "body": body, "trouble": "", "still": True}

    def first(self) -> ReportState:
        """Return the state of a new page."""
        return ReportState()

    def handle_request(self, state: Any, message: Mapping[str, Any]) -> None:
        """Reject every request, because a report page is static. Raises ValueError."""
        raise ValueError("the page of a report accepts no requests")

    def updates(self, state: Any) -> Mapping[str, Any] | None:
        """Return the complete page, once."""
        if state.sent:
            return None
        state.sent = True
        return self._page


def run_source_of(recording: Recording, name: str) -> RunSource:
    """Return the page source of a recording. `name` is the displayed name of the file."""
    scene, began = _scene(recording, name), start_time(recording)
    ends = [at for last in recording.cycles[-1:] for at in (last.controlled_at, last.answered_at)]
    ends += [event.at for event in recording.events]
    length_s = max((at - began for at in ends if at == at), default=0.0)
    model = recorded_model(recording)
    begin = Begin(scene, recording.unix_zero_ns, model)
    source = RunSource(begin, 0.0, length_s, facts_of_recording(recording))
    source.pulse(Pulse(began, Health()), 0.0)
    for records in (recording.cycles, recording.truths, recording.sensors, recording.events, recording.steps):
        for record in records:
            source.take(record)
    source.counters = _counters(recording, scene)
    if recording.truncated:
        source.lost("the recording was cut off")
    else:
        source.end(End(recording.end))
    return source


def _counters(recording: Recording, scene: Scene) -> Mapping[str, Any]:
    """Return the counters of the complete run; a recording has no counters for a particular time."""
    counters = json_or_none(recording.end.get("link"))
    link = counters if isinstance(counters, dict) else {}
    lost = json_or_none(recording.end.get("sensor_lost"))
    return {
        "link_errors": sum(link.get(name, 0) for name in scene.robot.errors) if link else None,
        "frames_lost": lost if isinstance(lost, int) else None,
        "traffic": [],
    }


def _scene(recording: Recording, name: str) -> Scene:
    """Return the facts of a recorded run that the recording contains."""
    devices = devices_of(recording)
    recorded = recorded_configuration(recording)
    try:
        config = read_config(recorded)
        cell = name_cell(robot_in(config), sensor_in(config))
        limits, reference = config.limits, config.task.force_n
        total = None if config.task.step else config.run.duration_s
    except (BridgeError, ValidationError, TypeError, ValueError):  # the plug-in is not installed
        cell = _cell_name(devices)
        references = [cycle.force_reference for cycle in recording.cycles[:1]]
        limits, reference, total = _limits(recorded), max(references, default=0.0), None
    return Scene(
        reference_n=reference,
        robot=devices.robot,
        total_s=total,
        steps=tuple(step.label for step in recording.steps),
        tracks=facts_of_recording(recording).tracks,
        cell=cell.words,
        devices=cell.devices,
        real=cell.real,
        limits=limits,
        places=RunPlaces(name),
        approach=approach_of(recording),
    )


def _cell_name(devices: Devices) -> CellName:
    robot, sensor = devices.robot, devices.sensor
    return CellName(
        not robot.emulated, "EMULATED" if robot.emulated else "REAL", f"{robot.kind}, {sensor.kind}"
    )


def _limits(recorded: Mapping[str, Any]) -> Limits:
    try:
        return msgspec.convert(recorded.get("limits", {}), Limits)
    except (ValueError, TypeError):
        return Limits()
