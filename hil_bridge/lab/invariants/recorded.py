"""The promises that a recording alone shows to be broken, in words."""

from hil_bridge.errors import ConfigError
from hil_bridge.lab.invariants.checking import broken_promises
from hil_bridge.lab.invariants.evidence import Evidence, Promise, violation_text
from hil_bridge.record import Recording
from hil_bridge.runs.replay import recorded_config

_OF_A_RUN = (Promise.REPLAY, Promise.WHOLE, Promise.BUG)
"""Promises that `hil-bridge replay` judges, or of which the first sentences tell."""


def promises_broken(recording: Recording) -> tuple[str, ...]:
    """Promises of the guard that a run did not keep, in words. None for a configuration of another version."""
    try:
        config = recorded_config(recording, {})
    except ConfigError:
        return ()
    violations = broken_promises(Evidence(recording, config), without=_OF_A_RUN)
    return tuple(map(violation_text, violations))
