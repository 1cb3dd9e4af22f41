"""Tables of the controller's decisions per cycle: levels, fired rules, estimate, gain and verdict."""

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeGuard

from hil_bridge.record.analysis.definition import quantity
from hil_bridge.record.analysis.strokes import TRACK
from hil_bridge.record.reader import Recording
from hil_bridge.record.records import CycleRecord
from hil_bridge.show.charts.columns import LEVELS

ROWS_MAX = 200
RULES_MAX = 3
_RULE_SIGN = "→"
"""Character that occurs in the name of every rule and in no other key of an explanation."""
_UNITS = {"_m": (1e3, ".3f", "mm"), "_n": (1.0, ".2f", "N")}
"""Scale, format and unit by the suffix of a key."""


@dataclass(frozen=True, slots=True)
class Decisions:
    """Table of decisions with one row per cycle; empty columns are omitted."""

    titles: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    cycles: int
    """Number of tracked cycles, from which the rows are evenly selected."""


def select_tracked(recording: Recording) -> list[CycleRecord]:
    """Return the cycles in which the force was controlled."""
    return [cycle for cycle in recording.cycles if cycle.phase == TRACK]


def decisions(recording: Recording, zero: float) -> Decisions | None:
    """Return the table of at most `ROWS_MAX` tracked cycles, with times since `zero`.

    The result is None if no force was tracked.
    """
    cycles = select_tracked(recording)
    if not cycles:
        return None
    chosen = decimate(cycles, ROWS_MAX)
    columns = [(title, [text(cycle) for cycle in chosen]) for title, text in _columns(zero)]
    columns = [(title, texts) for title, texts in columns if any(texts)]
    rows = tuple(zip(*(texts for _, texts in columns), strict=True))
    return Decisions(tuple(title for title, _ in columns), rows, len(cycles))


def strongest_rules(recording: Recording) -> list[tuple[str, int, float]]:
    """Return the rules that have the largest weight in a cycle, including ties, the most frequent rule first.

    Each row has the name of the rule, the number of tracked cycles in which it is the strongest, and its mean
    weight in them.
    """
    counts: Counter[str] = Counter()
    weights: dict[str, float] = {}
    for cycle in select_tracked(recording):
        fired = rules(cycle.explanation)
        for name, weight in fired:
            if weight == fired[0][1]:
                counts[name] += 1
                weights[name] = weights.get(name, 0.0) + weight
    names = sorted(counts, key=lambda name: (-counts[name], name))
    return [(name, counts[name], weights[name] / counts[name]) for name in names]


def rules(explanation: Mapping[str, float]) -> list[tuple[str, float]]:
    """Return the rules that fired, with their weights, the strongest first.

    Rules with equal weights are sorted by name.
    """
    fired = [
        (name, weight)
        for name, weight in explanation.items()
        if _RULE_SIGN in name and _known(weight) and weight > 0.0
    ]
    return sorted(fired, key=lambda rule: (-rule[1], rule[0]))


def decimate(cycles: Sequence[CycleRecord], most: int) -> list[CycleRecord]:
    """Return at most `most` of these cycles, evenly selected, including the first and the last."""
    if len(cycles) <= most:
        return list(cycles)
    return [cycles[round(k * (len(cycles) - 1) / (most - 1))] for k in range(most)]


def _columns(zero: float) -> list[tuple[str, Callable[[CycleRecord], str]]]:
    return [
        ("time, s", lambda cycle: _plain(cycle.controlled_at - zero, ".2f")),
        ("force, N", lambda cycle: _plain(cycle.force, ".2f")),
        ("error, N", lambda cycle: _plain(cycle.force - cycle.force_reference, "+.2f")),
        *(
            (f"level of {name}", lambda cycle, key=key: _plain(cycle.explanation.get(key), ".3g"))
            for key, name in LEVELS.items()
        ),
        ("strongest rules, weight", _rules_text),
        ("estimate, N/m", lambda cycle: _plain(cycle.stiffness, ".0f")),
        ("gain", lambda cycle: _plain(cycle.gain, ".3g")),
        ("correction, mm", lambda cycle: _plain(cycle.correction, "+.3f", 1e3)),
        ("other values", _other_text),
        ("verdict", _verdict_text),
    ]


def _plain(value: float | None, form: str, scale: float = 1.0) -> str:
    """Format a number without its unit; return an empty text if it is unknown."""
    return quantity(value, scale, form, "") if _known(value) else ""


def _known(value: float | None) -> TypeGuard[float]:
    return value is not None and math.isfinite(value)


def _rules_text(cycle: CycleRecord) -> str:
    fired = rules(cycle.explanation)[:RULES_MAX]
    return ", ".join(f"{name} {weight:.2f}" for name, weight in fired)


def _other_text(cycle: CycleRecord) -> str:
    """Format the remaining values of the controller, with the units that their names state."""
    parts = []
    for key, value in cycle.explanation.items():
        if key in LEVELS or _RULE_SIGN in key or not _known(value):
            continue
        ending = next((ending for ending in _UNITS if key.endswith(ending)), "")
        scale, form, unit = _UNITS.get(ending, (1.0, ".3g", ""))
        parts.append(f"{key.removesuffix(ending).replace('_', ' ')} {quantity(value, scale, form, unit)}")
    return ", ".join(sorted(parts))


def _verdict_text(cycle: CycleRecord) -> str:
    verdict = ": ".join((cycle.verdict, ", ".join(cycle.reasons))) if cycle.reasons else cycle.verdict
    return f"{verdict}, held" if cycle.held else verdict
