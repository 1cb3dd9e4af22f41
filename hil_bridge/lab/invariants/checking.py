"""All checkers in one table, and what of their answers the faults of a run leave standing."""

from collections.abc import Callable, Collection, Iterator, Mapping

from hil_bridge.lab.invariants.course import bugs, gate_stops, unfit_codes, unwhole
from hil_bridge.lab.invariants.ends import untold_ends, untrue_lines
from hil_bridge.lab.invariants.evidence import Evidence, Promise, Violation
from hil_bridge.lab.invariants.force import beyond_bound
from hil_bridge.lab.invariants.modelled import unaccepted_cycles
from hil_bridge.lab.invariants.orders import deeper_orders
from hil_bridge.lab.invariants.replayed import other_decisions
from hil_bridge.lab.invariants.speed import too_fast
from hil_bridge.lab.invariants.voids import void_reasons

CHECKERS: Mapping[Promise, Callable[[Evidence], Iterator[Violation]]] = {
    Promise.ORDERS: deeper_orders,
    Promise.END: untold_ends,
    Promise.LAST_LINE: untrue_lines,
    Promise.BOUND: beyond_bound,
    Promise.SPEED: too_fast,
    Promise.GATE: gate_stops,
    Promise.REPLAY: other_decisions,
    Promise.WHOLE: unwhole,
    Promise.EXIT: unfit_codes,
    Promise.BUG: bugs,
    Promise.MODEL: unaccepted_cycles,
}
"""The checker of each promise."""


def broken_promises(evidence: Evidence, without: Collection[Promise] = ()) -> tuple[Violation, ...]:
    """Every promise that a run did not keep, without those that its faults void, and those that are not asked for."""
    faults = evidence.config.faults
    return tuple(
        violation
        for promise, check in CHECKERS.items()
        if promise not in without and not void_reasons(promise, faults)
        for violation in check(evidence)
    )
