"""Guard promises, verified on a finished run by independent checkers, which are pure functions without clock or
files.

`broken_promises` returns the promises that a run broke. It is shared by tests, campaigns, the hunt and `hil-bridge
why`.
"""

from hil_bridge.lab.invariants.checking import CHECKERS, broken_promises, promises_broken
from hil_bridge.lab.invariants.evidence import (
    Evidence,
    Promise,
    Trace,
    Violation,
    violation_detail,
    violation_text,
)
from hil_bridge.lab.invariants.force import bounded_forces, stated_bound_n
from hil_bridge.lab.invariants.voids import VOIDS, Void, World, added_n, rows_of, void_reasons

__all__ = [
    "CHECKERS",
    "VOIDS",
    "Evidence",
    "Promise",
    "Trace",
    "Violation",
    "Void",
    "World",
    "added_n",
    "bounded_forces",
    "broken_promises",
    "promises_broken",
    "rows_of",
    "stated_bound_n",
    "violation_detail",
    "violation_text",
    "void_reasons",
]
