"""Promises of the guard as independent checkers of a finished run. Pure functions: no clock, no file.

`broken_promises` returns the promises that a run broke. Tests, campaigns, the hunt and `hil-bridge why` share it.
"""

from hil_bridge.lab.invariants.checking import CHECKERS, broken_promises, promises_broken
from hil_bridge.lab.invariants.evidence import (
    Evidence,
    Promise,
    Trace,
    Violation,
    violation_text,
    violation_words,
)
from hil_bridge.lab.invariants.force import judged_forces, stated_bound_n
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
    "broken_promises",
    "judged_forces",
    "promises_broken",
    "rows_of",
    "stated_bound_n",
    "violation_text",
    "violation_words",
    "void_reasons",
]
