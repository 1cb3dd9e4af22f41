"""Run-by-run differences between two campaigns. `trends` compares their figures and tests significance."""

import json
from collections.abc import Iterator, Sequence
from typing import TypeAlias

from msgspec import Struct

from hil_bridge.errors.text_files import harmless
from hil_bridge.lab.campaign.criteria import Figure, Figures, figure_text
from hil_bridge.lab.campaign.store import Done, Store
from hil_bridge.record.analysis.figures import JUDGED
from hil_bridge.show.report.differences import describe_value, flat

LINES = 50
"""Maximum number of runs listed individually. Chosen: a screen or two."""
_NOTHING = "nothing"
"""Text shown for a figure that a run does not have."""
_Name: TypeAlias = tuple[str, str, str, int]
"""Cell, fault, phase and seed, which identify a run in both campaigns."""


class Difference(Struct, frozen=True):
    """Figure whose value differs between two runs; a value is None if the run does not have the figure."""

    figure: str
    before: Figure
    after: Figure

    @property
    def text(self) -> str:
        """Difference as one line of text."""
        return f"{self.figure} {figure_text(self.before) or _NOTHING} → {figure_text(self.after) or _NOTHING}"


class SettingChange(Struct, frozen=True):
    """Setting that differs between two campaigns, with all its values in each campaign; "–" if a campaign does not
    have it.
    """

    key: str
    before: str
    after: str

    @property
    def text(self) -> str:
        """Change as one line of text."""
        return f"setting {self.key}: {self.before} → {self.after}"


class Side(Struct, frozen=True):
    """One of the two campaigns in a comparison."""

    results: str
    """File name of the campaign's results."""
    name: str
    code: str
    """Version of the code that produced the results."""
    runs: int

    @property
    def text(self) -> str:
        """Campaign as one line of text."""
        return f"{self.results}: {self.name}, code {self.code}, {self.runs} runs"


class ChangedRun(Struct, frozen=True):
    """Run that both campaigns contain, with different figures."""

    cell: str
    fault: str
    phase: str
    seed: int
    differences: tuple[Difference, ...]

    @property
    def text(self) -> str:
        """Changed run as one line of text."""
        differences = "; ".join(one.text for one in self.differences)
        return f"{self.cell} | {self.fault} {self.phase} | seed {self.seed}: {differences}"


class Compared(Struct, frozen=True):
    """Comparison of two campaigns."""

    before: Side
    after: Side
    settings: tuple[SettingChange, ...]
    """Settings that differ between the campaigns, and may explain differing runs."""
    common: int
    """Number of runs that both campaigns contain."""
    worse: int
    """Number of runs that passed in the first campaign and fail in the second."""
    better: int
    """Number of runs that failed in the first campaign and pass in the second."""
    changed: tuple[ChangedRun, ...]
    """Runs that differ, beginning with the runs whose outcome changed."""

    @property
    def differing(self) -> int:
        """Number of runs that both campaigns contain and that differ."""
        return len(self.changed)

    @property
    def lines(self) -> Iterator[str]:
        """Text for the terminal: differing settings, totals, and at most LINES runs."""
        yield self.before.text
        yield self.after.text
        yield from setting_lines(self.settings)
        yield f"{self.common} runs in both, {self.differing} of them differ"
        if self.worse or self.better:
            yield f"{self.worse} passed and fail now, {self.better} failed and pass now"
        yield from (run.text for run in self.changed[:LINES])
        if self.differing > LINES:
            yield f"and {self.differing - LINES} more"


def differences(before: Figures, after: Figures) -> Iterator[Difference]:
    """Yield the figures that differ between two runs."""
    for name in JUDGED:
        old, new = before.get(name), after.get(name)
        if old != new:
            yield Difference(name, old, new)


def setting_changes(first: Store, second: Store) -> Iterator[SettingChange]:
    """Yield the settings whose values, taken over all cases, differ between the campaigns, sorted by key."""
    before, after = _settings(first), _settings(second)
    for key in sorted(before | after):
        old, new = (", ".join(sorted(side.get(key, {"–"}))) for side in (before, after))
        if old != new:
            yield SettingChange(key, old, new)


def setting_lines(changes: Sequence[SettingChange]) -> Iterator[str]:
    """Yield one text line per differing setting, at most LINES of them."""
    yield from (harmless(one.text) for one in changes[:LINES])
    if len(changes) > LINES:
        yield f"and {len(changes) - LINES} more settings"


def _settings(store: Store) -> dict[str, set[str]]:
    """Return all values that each setting has in the cases of a campaign."""
    values: dict[str, set[str]] = {}
    for config in {case.config for case in store.plan().cases}:
        for key, value in flat(json.loads(config)).items():
            values.setdefault(key, set()).add(describe_value(value))
    return values


def compare_campaigns(first: Store, second: Store) -> Compared:
    """Compare the runs of two campaigns that have the same cell, fault, phase and seed."""
    old, new = _by_name(first), _by_name(second)
    common = [name for name in old if name in new]
    changed = {
        name: changes
        for name in common
        if (changes := tuple(differences(old[name].figures, new[name].figures)))
    }
    order = sorted(changed, key=lambda name: (old[name].outcome == new[name].outcome, name))
    return Compared(
        Side(first.path.name, first.fact("name"), first.fact("code"), len(old)),
        Side(second.path.name, second.fact("name"), second.fact("code"), len(new)),
        tuple(setting_changes(first, second)),
        len(common),
        sum(old[name].passed and not new[name].passed for name in common),
        sum(new[name].passed and not old[name].passed for name in common),
        tuple(ChangedRun(*name, changed[name]) for name in order),
    )


def _by_name(store: Store) -> dict[_Name, Done]:
    cases = store.plan().cases
    return {
        (case.cell, case.fault, case.phase, done.seed): done
        for done in store.runs()
        for case in (cases[done.number],)
    }
