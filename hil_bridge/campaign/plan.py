"""The plan of a campaign: a TOML file, checked as a whole before the first run."""

import hashlib
import itertools
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from functools import cache, cached_property
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

from hil_bridge.campaign.criteria import Criterion, problem_of
from hil_bridge.errors import BridgeError, ConfigError
from hil_bridge.runs.checks import check
from hil_bridge.runs.pace import paced
from hil_bridge.settings.configuration import Config, dump, read_values
from hil_bridge.settings.given import config_of
from hil_bridge.text_files import format_path, format_value, read_toml

RUNS_LIMIT = 10_000_000
"""Most runs of a campaign. Chosen: months of a machine."""
SEED_LIMIT = 2**63 - 1
"""Largest seed: the largest whole number that the results can hold."""
CASES_LIMIT = 100_000
"""Most cells of the matrix times faults. Chosen: all are checked first, a few milliseconds each."""
NO_FAULT = "none"
_SECTIONS = ("campaign", "config")
_KEYS = ("name", "seeds", "cases_per_seed", "config", "without_fault", "matrix", "fault", "criteria")


class PlanErrors(ConfigError):
    """Everything that is wrong with a plan, a line each."""

    def __init__(self, problems: Sequence[str]) -> None:
        super().__init__(problems[0] + (f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""))
        self.problems = tuple(problems)


class _Cell(NamedTuple):
    """A cell of the matrix, or one value of an axis."""

    label: str
    values: Mapping[str, Any]
    """By dotted key."""


@dataclass(frozen=True, slots=True)
class Case:
    """A cell of the matrix with one fault, or none: all that a run is a function of, beside its seed."""

    cell: str
    """Values of the axes, in words; the same for all faults."""
    fault: str
    """The fault in words; `none` for the case without."""
    phase: str
    """Phase in which it comes; empty for the first, or any."""
    config: str
    """The configuration without faults as JSON, its seed 0."""
    table: str
    """The fault as JSON as in [[faults]], {} for none."""
    impossible: str = ""
    """Why this cell cannot have the fault; empty where it can."""

    @property
    def config_hash(self) -> str:
        """Short hash of the configuration."""
        return _short(self.config)

    def key(self, code: str, seed: int) -> str:
        """Name of the run with a seed: the same for the same run of the same code."""
        return _short(json.dumps([self.config, code, self.table, self.phase, seed]))


@dataclass(frozen=True)
class Plan:
    """A campaign that has been checked."""

    name: str
    seeds: tuple[int, ...]
    cases: tuple[Case, ...]
    criteria: tuple[Criterion, ...]
    cases_per_seed: int = 0
    """Cases that each seed takes, in turn; 0 for all."""

    @cached_property
    def possible(self) -> tuple[Case, ...]:
        """Cases that can be run."""
        return tuple(case for case in self.cases if not case.impossible)

    @property
    def count(self) -> int:
        """Number of runs."""
        return (self.cases_per_seed or len(self.possible)) * len(self.seeds)

    @property
    def identity(self) -> str:
        """Hash of all but the seeds: a results file belongs to one of these."""
        rows = [[case.config, case.table, case.phase] for case in self.cases]
        all_but_seeds: list[object] = [rows, [[item.figure, item.wanted] for item in self.criteria]]
        if self.cases_per_seed:
            all_but_seeds.append(self.cases_per_seed)
        return _short(json.dumps(all_but_seeds))

    def cases_of(self, seed: int) -> Sequence[Case]:
        """Cases that a seed takes: the seeds go round the possible ones, so that each has its turn equally often."""
        cases, share = self.possible, self.cases_per_seed
        if not share:
            return cases
        return [cases[(seed * share + place) % len(cases)] for place in range(share)]

    def runs(self) -> Iterator[tuple[Case, int]]:
        """Every run, seed by seed, so that the first ones go over the whole matrix."""
        return ((case, seed) for seed in self.seeds for case in self.cases_of(seed))


def _short(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:16]


@cache
def code_version() -> str:
    """Version of the package, and a hash of the source of the bridge, the emulators and the protocols."""
    digest = hashlib.sha256()
    for package in ("hil_bridge", "emulators", "protocol"):
        spec = find_spec(package)
        for place in (spec.submodule_search_locations or ()) if spec else ():
            for path in sorted(Path(place).rglob("*.py")):
                digest.update(str(path.relative_to(place)).encode() + b"\0" + path.read_bytes())
    return f"{version('hil-bridge')}+{digest.hexdigest()[:12]}"


def read_plan(path: Path, seeds: tuple[int, ...] = ()) -> Plan:
    """The campaign of a file, with these seeds in place of its own where there are any.

    Raises PlanErrors with everything that is wrong, ConfigError for what is no TOML.
    """
    return _Reading(path, read_toml(path), seeds).plan()


def seeds_of(text: str) -> tuple[int, ...]:
    """Seeds from text: FROM:TO with both ends included, or a single one. Raises ValueError."""
    first, _, last = text.partition(":")
    begin, end = int(first), int(last or first)
    if not 0 <= begin <= end <= SEED_LIMIT or end - begin >= RUNS_LIMIT:
        raise ValueError(f"no seeds from {text!r}")
    return tuple(range(begin, end + 1))


class _Reading:
    """A file on its way to a plan."""

    def __init__(self, path: Path, values: dict[str, Any], instead: tuple[int, ...]) -> None:
        self._path = path
        self._instead = instead
        self._source = format_path(path)
        self._values = values
        self._problems: list[str] = []

    def plan(self) -> Plan:
        campaign = self._values.get("campaign")
        if not isinstance(campaign, dict):
            raise PlanErrors([f"{self._source}: there must be a table [campaign]"])
        for key in self._values:
            if key not in _SECTIONS:
                self._wrong(key, f"is no table of a campaign, only {', '.join(_SECTIONS)}")
        for key in campaign:
            if key not in _KEYS:
                self._wrong(f"campaign.{key}", f"is no setting; choose from {', '.join(_KEYS)}")
        name = campaign.get("name", self._path.stem)
        if not isinstance(name, str) or not name.strip() or not name.isprintable():
            self._wrong("campaign.name", f"must be a text, got {format_value(name)}")
        seeds = self._instead or self._seeds(campaign.get("seeds"))
        share = campaign.get("cases_per_seed", 0)
        if type(share) is not int or share < 0:
            self._wrong("campaign.cases_per_seed", f"must be a whole number, got {format_value(share)}")
        criteria = self._criteria(campaign.get("criteria", {}))
        base = self._base(campaign.get("config"))
        cells = self._cells(campaign.get("matrix", {}))
        faults = self._faults(campaign)
        if not self._problems and len(cells) * len(faults) > CASES_LIMIT:
            self._wrong("campaign.matrix", f"makes more than {CASES_LIMIT} cells with the faults")
        cases = [] if self._problems else self._cases(base, cells, faults)
        if self._problems:
            raise PlanErrors(self._problems)
        plan = Plan(name, seeds, tuple(cases), criteria, share)
        if share > len(plan.possible):
            self._wrong("campaign.cases_per_seed", f"is more than the {len(plan.possible)} cases there are")
        if plan.count > RUNS_LIMIT:
            self._wrong("campaign", f"makes more than {RUNS_LIMIT} runs")
        if self._problems:
            raise PlanErrors(self._problems)
        return plan

    def _wrong(self, key: str, text: str) -> None:
        self._problems.append(f"{self._source}: {key} {text}")

    def _seeds(self, given: object) -> tuple[int, ...]:
        """A list of numbers, or `{ from = 1, to = 50 }`, both ends included."""
        match given:
            case {"from": int(first), "to": int(last), **rest} if not rest and 0 <= first <= last:
                if last - first >= RUNS_LIMIT:
                    self._wrong("campaign.seeds", f"are more than {RUNS_LIMIT}")
                    return ()
                return tuple(range(first, last + 1))
            case list() if given and all(type(seed) is int and seed >= 0 for seed in given):
                if len(set(given)) < len(given):
                    self._wrong("campaign.seeds", "holds a seed twice")
                return tuple(given)
        wanted = "must be a list of whole numbers from 0, or { from = 1, to = 50 }"
        self._wrong("campaign.seeds", wanted if given is None else f"{wanted}, got {format_value(given)}")
        return ()

    def _criteria(self, given: object) -> tuple[Criterion, ...]:
        if not isinstance(given, dict) or not given:
            self._wrong("campaign.criteria", "must be a table with one figure at least")
            return ()
        for figure, wanted in given.items():
            if (problem := problem_of(figure, wanted)) is not None:
                self._wrong(f"campaign.criteria.{figure}", problem)
        return tuple(Criterion(figure, wanted) for figure, wanted in given.items())

    def _base(self, path: object) -> dict[str, Any]:
        """The values that all cells share: of the file that is named, and over them those of [config]."""
        values: dict[str, Any] = {}
        if isinstance(path, str) and path:
            try:
                values = read_values(self._path.parent / path)
            except ConfigError as error:
                self._wrong("campaign.config:", str(error))
        elif path is not None:
            self._wrong("campaign.config", f"must be the path of a configuration, got {format_value(path)}")
        own = self._values.get("config", {})
        if not isinstance(own, dict):
            self._wrong("config", "must be a table of settings")
            return values
        for place, tables in (("config", own), ("campaign.config", values)):
            if "faults" in tables:
                self._wrong(f"{place}.faults", "belongs into tables [[campaign.fault]]")
        for key, value in _leaves(own):
            _put(values, key, value)
        return values

    def _cells(self, given: object) -> list[_Cell]:
        """Every combination of the axes, in the order of the file."""
        if not isinstance(given, dict):
            self._wrong("campaign.matrix", "must be a table of lists")
            return []
        axes: list[list[_Cell]] = []
        for key, values in _leaves(given):
            where = f"campaign.matrix.{key}"
            if not isinstance(values, list) or not values:
                self._wrong(where, f"must be a list of values, got {format_value(values)}")
                continue
            tables = [isinstance(value, dict) for value in values]
            if any(tables) and not all(tables):
                self._wrong(where, "holds tables and plain values; use either")
                continue
            axis = [_value(key, value) for value in values]
            if len({json.dumps(one.values, sort_keys=True, default=str) for one in axis}) < len(axis):
                self._wrong(where, "holds a value twice")
            if len({one.label for one in axis}) < len(axis):
                self._wrong(where, "holds a label twice")
            if any(name == "run.seed" or name.startswith("faults") for one in axis for name in one.values):
                self._wrong(where, "cannot be an axis: faults and seeds have their own settings")
            axes.append(axis)
        if math.prod(map(len, axes)) > CASES_LIMIT:  # before any is made: they would fill the memory
            self._wrong("campaign.matrix", f"makes more than {CASES_LIMIT} cells")
            return []
        return [_joined(parts) for parts in itertools.product(*axes)]

    def _faults(self, campaign: Mapping[str, Any]) -> list[dict[str, Any]]:
        """Tables as in [[faults]], one for each phase; the empty one is the case without a fault."""
        without, given = campaign.get("without_fault", True), campaign.get("fault", [])
        if not isinstance(without, bool):
            self._wrong("campaign.without_fault", f"must be true or false, got {format_value(without)}")
        if not isinstance(given, list) or not all(isinstance(table, dict) for table in given):
            self._wrong("campaign.fault", "must be tables [[campaign.fault]]")
            return []
        found: list[dict[str, Any]] = [{}] if without else []
        for number, table in enumerate(given):
            phases = table.get("phase", "")
            if isinstance(phases, list) and not phases:
                self._wrong(f"campaign.fault.{number}.phase", "is an empty list")
            for phase in phases if isinstance(phases, list) else [phases]:
                one = {**table, "phase": phase}
                if one in found:
                    self._wrong(f"campaign.fault.{number}", "is there already")
                found.append(one)
        if not found:
            self._wrong("campaign.fault", "is missing, and without_fault is false: there is nothing to run")
        return found

    def _cases(self, base: dict[str, Any], cells: list[_Cell], faults: list[dict[str, Any]]) -> list[Case]:
        cases: list[Case] = []
        refusals: dict[int, list[str]] = {number: [] for number, table in enumerate(faults) if table}
        told: dict[str, list[str]] = {}
        for label, given in cells:
            values = deepcopy(base)
            for key, value in given.items():
                _put(values, key, value)
            try:
                config = config_of(values, seed=0)
                _check_emulated(config)
                check(paced(config), True)
            except BridgeError as error:
                told.setdefault(_plain(error), []).append(label)
                continue
            text = dump(config)
            for number, table in enumerate(faults):
                refusal = _refusal(config, table)
                if table and refusal:
                    refusals[number].append(refusal)
                row = json.dumps(table, sort_keys=True, default=str)
                cases.append(Case(label, fault_label(table), table.get("phase", ""), text, row, refusal))
        for problem, labels in told.items():
            more = f" and {len(labels) - 1} more" if len(labels) > 1 else ""
            self._problems.append(f"{self._source}: {problem} (with {labels[0]}{more})")
        for number, texts in refusals.items():  # a fault that no cell can have is a mistake
            if texts and len(texts) == len(cells) - sum(map(len, told.values())):
                self._problems.append(f"{self._source}: campaign.fault.{number}: {texts[0]}")
        return cases


def _value(key: str, value: object) -> _Cell:
    """One value of an axis; a table may tell its own label."""
    if not isinstance(value, dict):
        return _Cell(f"{key} {value}", {key: value})
    values = dict(_leaves(value))
    label = values.pop("label", None) or ", ".join(f"{name} {one}" for name, one in values.items())
    return _Cell(f"{key} {label}", values)


def _joined(parts: Sequence[_Cell]) -> _Cell:
    label = ", ".join(part.label for part in parts) or "the configuration"
    return _Cell(label, {key: value for part in parts for key, value in part.values.items()})


def fault_label(table: Mapping[str, Any]) -> str:
    """A fault in words, without its phase."""
    if not table:
        return NO_FAULT
    more = [f"{key} {value}" for key, value in table.get("with", {}).items()] if _is_table(table) else []
    more += [f"{key} {table[key]}" for key in ("when", "after_s", "for_s") if key in table]
    name = f"{table.get('on', '')}: {table.get('fault', '')}"
    return f"{name} ({', '.join(more)})" if more else name


def _is_table(table: Mapping[str, Any]) -> bool:
    return isinstance(table.get("with", {}), dict)


def _refusal(config: Config, table: Mapping[str, Any]) -> str:
    """Why a cell cannot have a fault; empty where it can."""
    if not table:
        return ""
    robot, sensor = config.robot.emulated, config.sensor.emulated
    alike = {"robot": {"emulated": robot}, "sensor": {"emulated": sensor}}
    if surface := getattr(config.cell, "surface_kind", ""):
        alike["cell"] = {"surface_kind": surface}
    try:  # with the same devices and no more: a thousand whole configurations take seconds
        config_of(alike, [table])
    except ConfigError as error:
        return _plain(error).removeprefix("faults.0").removeprefix(": ").removeprefix(".")
    return ""


def _check_emulated(config: Config) -> None:
    for key, url in (("robot.url", config.robot.url), ("sensor.url", config.sensor.url)):
        if url:
            raise ConfigError(f"{key}: a campaign runs against the emulated cell alone; leave the URL empty")


def _plain(error: BridgeError) -> str:
    return str(error).removeprefix("configuration: ")


def _leaves(table: Mapping[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    """Values by dotted key."""
    for key, value in table.items():
        if isinstance(value, dict) and value:
            yield from _leaves(value, f"{before}{key}.")
        else:
            yield before + key, value


def _put(values: dict[str, Any], key: str, value: object) -> None:
    *sections, name = key.split(".")
    table: Any = values
    for section in sections:
        found = table.setdefault(section, {})
        if not isinstance(found, dict):
            found = table[section] = {}
        table = found
    table[name] = deepcopy(value)
