"""Differences between two campaigns."""

import math
import statistics
from collections.abc import Iterator
from typing import NamedTuple, TypeAlias

from hil_bridge.lab.campaign.criteria import Figures, figure_text
from hil_bridge.lab.campaign.store import Done, Store
from hil_bridge.record.analysis.figures import JUDGED

LINES = 50
"""Most runs that are told one by one. Chosen: a screen or two."""
_NOTHING = "nothing"
"""Word for a figure that a run did not show."""
_Name: TypeAlias = tuple[str, str, str, int]
"""Cell, fault, phase and seed of a run, in words."""


class Compared(NamedTuple):
    """Two campaigns side by side."""

    lines: list[str]
    """For people."""
    differing: int
    """Runs that are in both and differ."""


def differences(before: Figures, after: Figures) -> Iterator[str]:
    """Figures that are not the same, in words."""
    for name in JUDGED:
        old, new = before.get(name), after.get(name)
        if old != new:
            yield f"{name} {figure_text(old) or _NOTHING} → {figure_text(new) or _NOTHING}"


def compare_campaigns(first: Store, second: Store) -> Compared:
    """Runs of the same cell, fault, phase and seed."""
    old, new = _by_name(first), _by_name(second)
    common = [name for name in old if name in new]
    changed = {
        name: found for name in common if (found := list(differences(old[name].figures, new[name].figures)))
    }
    lines = [
        f"{first.path.name}: {first.fact('name')}, code {first.fact('code')}, {len(old)} runs",
        f"{second.path.name}: {second.fact('name')}, code {second.fact('code')}, {len(new)} runs",
        f"{len(common)} runs in both, {len(changed)} of them differ",
    ]
    worse = sum(old[name].passed and not new[name].passed for name in common)
    better = sum(new[name].passed and not old[name].passed for name in common)
    if worse or better:
        lines.append(f"{worse} passed and fail now, {better} failed and pass now")
    lines += _shifts([old[name] for name in changed], [new[name] for name in changed])
    for name in sorted(changed, key=lambda name: (old[name].outcome == new[name].outcome, name))[:LINES]:
        cell, fault, phase, seed = name
        lines.append(f"{cell} | {fault} {phase} | seed {seed}: {'; '.join(changed[name])}")
    if len(changed) > LINES:
        lines.append(f"and {len(changed) - LINES} more")
    return Compared(lines, len(changed))


def _by_name(store: Store) -> dict[_Name, Done]:
    cases = store.plan().cases
    return {
        (case.cell, case.fault, case.phase, done.seed): done
        for done in store.runs()
        for case in (cases[done.number],)
    }


def _shifts(old: list[Done], new: list[Done]) -> Iterator[str]:
    """How far each figure has moved, over the runs that differ."""
    for name in JUDGED:
        moved = []
        for one, other in zip(old, new, strict=True):
            was, now = one.figures.get(name), other.figures.get(name)
            if isinstance(was, (int, float)) and isinstance(now, (int, float)) and was != now:
                moved.append(float(now) - float(was))
        if moved and all(map(math.isfinite, moved)):
            median = statistics.median(moved)
            yield f"{name}: moved in {len(moved)} runs, {min(moved):+.4g} … {max(moved):+.4g}, median {median:+.4g}"
