"""Comparison of a run whose callbacks ran in a drawn order with the same run, first in, first out."""

import math
from collections.abc import Iterator

from hil_bridge.lab.invariants.evidence import Evidence, Promise, Violation
from hil_bridge.record import CycleRecord, Recording

_DECIDED = ("phase", "step", "verdict", "reasons", "held", "in_contact")
"""Fields of a cycle that are equal under any order."""
_ROUNDED = (
    "started_at",
    "force",
    "depth",
    "depth_commanded",
    "travel_commanded",
    "across_commanded",
    "target",
)
"""Fields of a cycle that are equal but for the rounding of a computer, SI units."""
ROUNDING = 1e-9
"""Largest difference of a number that counts as rounding, SI units. Chosen: the emulated arm moves in steps between
the times at which something reads it, and these times depend on the order.
"""
_END = ("outcome", "reason", "cause", "exit_code")
"""Fields of the end of a run that are equal under any order."""


def other_in_drawn_order(evidence: Evidence) -> Iterator[Violation]:
    """Yield the first cycle, or the end, that differs from the same run in the usual order."""
    if evidence.usual is None:
        return
    here, there = evidence.recording, evidence.usual
    for drawn, usual in zip(here.cycles, there.cycles, strict=False):
        if changed := _changed(drawn, usual):
            figures = {"cycle": float(usual.cycle)}
            detail = f"cycle {usual.cycle} (phase: {usual.phase}): {', '.join(changed)}"
            yield Violation(Promise.ORDER, usual.started_at, figures, detail=detail)
            return
    counts = [len(recording.cycles) for recording in (there, here)]
    others = [
        f"{name} {there.end.get(name)}, not {here.end.get(name)}" for name in _different_ends(here, there)
    ]
    if counts[0] != counts[1]:
        others.append(f"{counts[0]} cycles, not {counts[1]}")
    if others:
        yield Violation(Promise.ORDER, math.nan, {}, detail=f"the end: {', '.join(others)}")


def _changed(drawn: CycleRecord, usual: CycleRecord) -> list[str]:
    """Return the names of the fields in which a cycle differs."""
    names = [name for name in _DECIDED if getattr(drawn, name) != getattr(usual, name)]
    return names + [name for name in _ROUNDED if not _equal(getattr(drawn, name), getattr(usual, name))]


def _equal(one: float | tuple[float, ...], other: float | tuple[float, ...]) -> bool:
    ones, others = (value if isinstance(value, tuple) else (value,) for value in (one, other))
    return len(ones) == len(others) and all(
        a == b or abs(a - b) <= ROUNDING or (a != a and b != b) for a, b in zip(ones, others, strict=True)
    )


def _different_ends(one: Recording, other: Recording) -> list[str]:
    return [name for name in _END if one.end.get(name) != other.end.get(name)]
