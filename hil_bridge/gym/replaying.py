"""Replay of a recording with another policy."""

from dataclasses import replace
from pathlib import Path

from hil_bridge.control.laws.policy import THINKING, PolicyController
from hil_bridge.control.laws.thinking import MEASURED, RecordedTimes
from hil_bridge.errors import ConfigError
from hil_bridge.record import Recording, read
from hil_bridge.runs.replay import ReplayedCycle, recorded_config, replay


def replay_policy(
    recording: Recording | Path | str, controller: PolicyController
) -> tuple[ReplayedCycle, ...]:
    """Replay every recorded cycle with this controller; `differences` of a cycle lists the values that differ.

    The original policy reproduces the run bit by bit. With another policy, each cycle starts from the recorded
    previous command. A policy whose thinking time is `"measured"` takes the recorded times. Raises ConfigError for a
    recording that cannot be replayed.
    """
    records = read(Path(recording)) if isinstance(recording, (str, Path)) else recording
    if controller.thinking_ms == MEASURED:
        controller = replace(controller, thinking_ms=_recorded_times(records))
    config = recorded_config(records, {}, controller)
    return tuple(replay(records, config, forced=True))


def _recorded_times(records: Recording) -> RecordedTimes:
    """Return the thinking times of all decisions. Raises ConfigError if the recording contains none."""
    times = {
        cycle.sample.now: cycle.explanation[THINKING]
        for cycle in records.cycles
        if THINKING in cycle.explanation
    }
    if not times:
        raise ConfigError(
            'the recording contains no thinking times: a run with thinking_ms = "measured" records them'
        )
    return RecordedTimes(times)
