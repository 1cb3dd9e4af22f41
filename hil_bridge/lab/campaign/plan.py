"""Plan of a campaign: its cases, its seeds, and the resulting runs."""

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from hil_bridge.errors.offers import modules_named
from hil_bridge.lab.campaign.criteria import Criterion
from hil_bridge.lab.campaign.drawing import Draw, Numbers, draw_values, numbers_of

RUNS_LIMIT = 10_000_000
"""Maximum number of runs in a campaign. Chosen: months of computing on one machine."""
SEED_LIMIT = 2**63 - 1
"""Largest seed, which is the largest integer that the results file can store."""
CASES_LISTED = 100
"""Maximum number of cases for which figures are listed by fault, and not only by cell. Chosen: a readable table."""
NO_FAULT = "none"


@dataclass(frozen=True, slots=True)
class Case:
    """One cell of the matrix with one fault or without a fault. Together with a seed, it determines a run."""

    cell: str
    """Label of the cell: values of the axes with their keys, as text. It does not depend on the fault."""
    head: str
    """Short label of the cell, with the values only, for a narrow column."""
    fault: str
    """Label of the fault; `none` for the case without a fault."""
    phase: str
    """Phase of the fault; empty for the first phase, or for any phase."""
    config: str
    """Configuration of the cell without faults and with seed 0, as JSON."""
    table: str
    """Table of the fault as in [[faults]], as JSON; {} if there is no fault."""
    impossible: str = ""
    """Reason why the cell does not support the fault; empty if it does."""

    @property
    def config_hash(self) -> str:
        """Short hash of the configuration."""
        return _short(self.config)

    def key(self, code: str, seed: int, table: str = "") -> str:
        """Return the key of the run with a seed, which identical runs of the same code version share.

        `table` contains the settings and faults drawn for the run, as JSON.
        """
        return _short(json.dumps([self.config, code, table or self.table, self.phase, seed]))


@dataclass(frozen=True, slots=True)
class PrimaryFigure:
    """Figure of one case by which results are compared first."""

    title: str
    case: str
    """Label of the case, as in `Plan.labels`."""
    figure: str
    """Key of the figure."""


@dataclass(frozen=True)
class Plan:
    """Complete, checked plan of a campaign."""

    name: str
    seeds: tuple[int, ...]
    cases: tuple[Case, ...]
    criteria: tuple[Criterion, ...]
    cases_per_seed: int = 0
    """Number of cases per seed, selected in rotation; 0 for all cases."""
    draw: Draw | None = None
    """Settings and faults drawn for each run; None if nothing is drawn."""
    requirements: tuple[str, ...] = ()
    """Requirements that each run of the campaign verifies."""
    primary: tuple[PrimaryFigure, ...] = ()
    """Figures that comparisons begin with, and test separately from all others."""
    axes: tuple[tuple[str, ...], ...] = ()
    """Labels of the values of each axis of the matrix, whose product are the cells, in their order. Empty for older
    results.
    """

    @cached_property
    def possible(self) -> tuple[Case, ...]:
        """Cases that can be run."""
        return tuple(case for case in self.cases if not case.impossible)

    @property
    def count(self) -> int:
        """Number of runs in the plan."""
        return (self.cases_per_seed or len(self.possible)) * len(self.seeds)

    @cached_property
    def labels(self) -> tuple[str, ...]:
        """Label of each case in lists of figures: its cell and its fault; only its cell if the plan has one fault or
        very many cases.
        """
        if len({(case.fault, case.phase) for case in self.cases}) == 1 or len(self.cases) > CASES_LISTED:
            return tuple(case.cell for case in self.cases)
        return tuple(
            case.cell if case.fault == NO_FAULT else f"{case.cell}; {case.fault} {case.phase}".rstrip()
            for case in self.cases
        )

    @cached_property
    def plugins(self) -> tuple[str, ...]:
        """Top-level modules of the plug-ins that the runs use, sorted."""
        draw = () if self.draw is None else (self.draw.text,)
        return modules_named({*(case.config for case in self.cases), *draw})

    @property
    def code(self) -> str:
        """Version of the code that determines the runs, including that of their plug-ins."""
        return code_version(self.plugins)

    @property
    def identity(self) -> str:
        """Hash of the plan without its seeds, which identifies the plan of a results file."""
        rows = [[case.config, case.table, case.phase] for case in self.cases]
        all_but_seeds: list[object] = [rows, [[item.figure, item.allowed] for item in self.criteria]]
        if self.cases_per_seed:
            all_but_seeds.append(self.cases_per_seed)
        if self.draw is not None:
            all_but_seeds.append(self.draw.text)
        return _short(json.dumps(all_but_seeds))

    def cases_of(self, seed: int) -> Sequence[Case]:
        """Return the cases of a seed. Seeds rotate through the possible cases, so that each case occurs equally
        often.
        """
        cases, share = self.possible, self.cases_per_seed
        if not share:
            return cases
        return [cases[(seed * share + place) % len(cases)] for place in range(share)]

    def table_of(self, case: Case, seed: int) -> str:
        """Return the overlay of a case for a seed, as JSON: the fault of the case, or all drawn settings and faults."""
        if self.draw is None:
            return case.table
        return self.table_for(case, numbers_of(f"{seed} {case.cell}", self.draw.dimensions))

    def table_for(self, case: Case, numbers: Numbers) -> str:
        """Return the overlay of a case for numbers from 0 to 1, one for each dimension of the draw."""
        assert self.draw is not None
        overlays = [json.loads(case.table)] if case.table != "{}" else []
        return draw_values(self.draw, case.cell, case.config, numbers, overlays)

    def runs(self) -> Iterator[tuple[Case, int]]:
        """Yield every run, seed by seed, so that the first runs cover the complete matrix."""
        return ((case, seed) for seed in self.seeds for case in self.cases_of(seed))


def _short(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:16]


@cache
def code_version(plugins: tuple[str, ...] = ()) -> str:
    """Return the version of the package, with a hash of the source of the bridge, the emulators, the protocols and
    these top-level modules of plug-ins.
    """
    digest = hashlib.sha256()
    for module in ("hil_bridge", "emulators", "protocol", *plugins):
        for place, path in _sources(module):
            digest.update(str(path.relative_to(place)).encode() + b"\0" + path.read_bytes())
    return f"{version('hil-bridge')}+{digest.hexdigest()[:12]}"


def _sources(module: str) -> Iterator[tuple[Path, Path]]:
    """Yield the folder and the path of each source file of a top-level module, which is not imported."""
    spec = find_spec(module)
    if spec is None:
        return
    for place in map(Path, spec.submodule_search_locations or ()):
        yield from ((place, path) for path in sorted(place.rglob("*.py")))
    if not spec.submodule_search_locations and spec.has_location and spec.origin:
        yield Path(spec.origin).parent, Path(spec.origin)


def seeds_of(text: str) -> tuple[int, ...]:
    """Parse seeds: FROM:TO with both ends included, or a single seed. Raises ValueError."""
    first, _, last = text.partition(":")
    begin, end = int(first), int(last or first)
    if not 0 <= begin <= end <= SEED_LIMIT or end - begin >= RUNS_LIMIT:
        raise ValueError(f"invalid seeds {text!r}; give FROM:TO or a single number")
    return tuple(range(begin, end + 1))


def fault_label(table: Mapping[str, Any]) -> str:
    """Format a fault as text, without its phase."""
    if not table:
        return NO_FAULT
    more = [f"{key} {value}" for key, value in table.get("with", {}).items()] if _is_table(table) else []
    more += [f"{key} {table[key]}" for key in ("when", "after_s", "for_s") if key in table]
    name = f"{table.get('on', '')}: {table.get('fault', '')}"
    return f"{name} ({', '.join(more)})" if more else name


def faults_of_table(table: str) -> list[dict[str, Any]]:
    """Return the fault tables of an overlay (JSON)."""
    values: dict[str, Any] = json.loads(table)
    if "config" in values:
        faults: list[dict[str, Any]] = values["faults"]
        return faults
    return [values] if values else []


def _is_table(table: Mapping[str, Any]) -> bool:
    return isinstance(table.get("with", {}), dict)
