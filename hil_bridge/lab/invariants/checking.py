"""Table of all promise checkers, and the violations that the faults of a run do not excuse."""

from collections.abc import Callable, Collection, Iterator, Mapping

from hil_bridge.errors import ConfigError
from hil_bridge.lab.invariants.course import (
    bugs,
    contradicting_exit_codes,
    deeper_orders,
    gate_stops,
    incomplete_recordings,
    other_decisions,
    too_fast,
    unaccepted_cycles,
)
from hil_bridge.lab.invariants.ends import false_ends, false_last_lines
from hil_bridge.lab.invariants.evidence import Evidence, Promise, Violation, violation_text
from hil_bridge.lab.invariants.force import beyond_bound
from hil_bridge.lab.invariants.order import other_in_drawn_order
from hil_bridge.lab.invariants.voids import void_reasons
from hil_bridge.record import Recording
from hil_bridge.runs.replay import recorded_config

CHECKERS: Mapping[Promise, Callable[[Evidence], Iterator[Violation]]] = {
    Promise.ORDERS: deeper_orders,
    Promise.END: false_ends,
    Promise.LAST_LINE: false_last_lines,
    Promise.BOUND: beyond_bound,
    Promise.SPEED: too_fast,
    Promise.GATE: gate_stops,
    Promise.REPLAY: other_decisions,
    Promise.WHOLE: incomplete_recordings,
    Promise.EXIT: contradicting_exit_codes,
    Promise.BUG: bugs,
    Promise.MODEL: unaccepted_cycles,
    Promise.ORDER: other_in_drawn_order,
}
"""Checker function for each promise."""
_OF_A_RUN = (Promise.REPLAY, Promise.WHOLE, Promise.BUG)
"""Promises that are judged by `hil-bridge replay`, or reported in the first sentences of `why`."""


def broken_promises(evidence: Evidence, without: Collection[Promise] = ()) -> tuple[Violation, ...]:
    """Return the promises that a run broke, except promises that its faults void and promises in `without`."""
    faults = evidence.config.faults
    return tuple(
        violation
        for promise, check in CHECKERS.items()
        if promise not in without and not void_reasons(promise, faults)
        for violation in check(evidence)
    )


def promises_broken(recording: Recording) -> tuple[str, ...]:
    """Return the guard promises that a run broke, as text; empty for a configuration of another version."""
    try:
        config = recorded_config(recording, {})
    except ConfigError:
        return ()
    violations = broken_promises(Evidence(recording, config), without=_OF_A_RUN)
    return tuple(map(violation_text, violations))
