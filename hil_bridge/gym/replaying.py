"""Replay of a recording with another policy."""

from pathlib import Path

from hil_bridge.control.laws.policy import PolicyController
from hil_bridge.record import Recording, read
from hil_bridge.runs.replay import ReplayedCycle, recorded_config, replay


def replay_policy(
    recording: Recording | Path | str, controller: PolicyController
) -> tuple[ReplayedCycle, ...]:
    """Replay every recorded cycle with this controller; `differences` of a cycle lists the values that differ.

    The original policy reproduces the run bit by bit. With another policy, each cycle starts from the recorded
    previous command. Raises ConfigError for a recording that cannot be replayed.
    """
    records = read(Path(recording)) if isinstance(recording, (str, Path)) else recording
    config = recorded_config(records, {}, controller)
    return tuple(replay(records, config, forced=True))
