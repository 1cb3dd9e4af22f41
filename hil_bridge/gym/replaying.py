"""A recording, decided again by a policy that a program gives."""

from pathlib import Path

from hil_bridge.control.laws.policy import PolicyController
from hil_bridge.record import Recording, read
from hil_bridge.runs.replay import ReplayedCycle, recorded_config, replay


def replay_policy(
    recording: Recording | Path | str, controller: PolicyController
) -> tuple[ReplayedCycle, ...]:
    """Every recorded cycle, decided again by this controller; `differences` of a cycle tells what is not the same.

    The policy with which the run was made gives the same, bit by bit. With another one, each cycle begins from the
    command before it that was recorded. Raises ConfigError for a recording that cannot be replayed.
    """
    records = read(Path(recording)) if isinstance(recording, (str, Path)) else recording
    config = recorded_config(records, {}, controller)
    return tuple(replay(records, config, forced=True))
