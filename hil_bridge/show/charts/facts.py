"""Facts of a run that its charts need. For a live run, `show.terminal` provides them."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from hil_bridge.devices.facts import RobotFacts
from hil_bridge.record.analysis.strokes import TRACK
from hil_bridge.record.device_facts import devices_of, json_or_none, recorded_configuration
from hil_bridge.record.reader import Recording
from hil_bridge.record.records import Vector


class ChartFacts(NamedTuple):
    """Facts that are constant during a run."""

    robot: RobotFacts
    limits: Mapping[str, float]
    """Limits by the names of their settings; a limit that is not set is not drawn."""
    tracks: frozenset[int] = frozenset()
    """Numbers of the program steps that follow a path."""
    approach: Vector | None = None
    """Unit vector of the approach in the base frame; if None, the approach is the tool axis at the start."""
    line_floor_s: float | None = None
    foreign: bool = False
    """Whether another program made the recording. Its path over the surface is then measured, not commanded."""


def facts_of_recording(recording: Recording) -> ChartFacts:
    """Return the chart facts of a recording."""
    limits: Any = recorded_configuration(recording).get("limits")
    floor = json_or_none(recording.end.get("line_floor_s"))
    return ChartFacts(
        devices_of(recording).robot,
        limit_numbers(limits if isinstance(limits, dict) else {}),
        frozenset(step.step for step in recording.steps if step.word == TRACK),
        approach_of(recording),
        float(floor) if isinstance(floor, (int, float)) else None,
        recording.foreign is not None,
    )


def approach_of(recording: Recording) -> Vector | None:
    """Return the unit vector of the approach in the robot base frame; None if it is unknown."""
    frame: Any = recorded_configuration(recording).get("frame")
    vector: Any = frame.get("approach") if isinstance(frame, dict) else None
    try:
        x, y, z = map(float, vector)
    except (TypeError, ValueError):
        return None
    return (x, y, z) if np.isfinite((x, y, z)).all() else None


def start_time(recording: Recording) -> float:
    """Return the time on the run's clock at which the times on pages and pictures are zero, s."""
    began = [cycle.started_at for cycle in recording.cycles[:1]]
    return min([*began, *(event.at for event in recording.events)], default=0.0)


def limit_numbers(values: Mapping[str, Any]) -> dict[str, float]:
    """Return the values that are limits, which are the nonzero numbers."""
    return {
        key: float(value)
        for key, value in values.items()
        if isinstance(value, (int, float)) and not isinstance(value, bool) and value
    }
