"""Campaign file: TOML, checked completely before the first run."""

import itertools
import json
import math
from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

from hil_bridge.clock import VIRTUAL_EPOCH
from hil_bridge.errors import BridgeError, ConfigError, SettingRefused
from hil_bridge.errors.text_files import format_path, format_value, read_toml
from hil_bridge.lab.campaign.criteria import Criterion, problem_of
from hil_bridge.lab.campaign.draw_file import draw_of, leaves, try_options
from hil_bridge.lab.campaign.drawing import DRAWN, Draw
from hil_bridge.lab.campaign.inputs import pin_policy
from hil_bridge.lab.campaign.plan import RUNS_LIMIT, Case, Plan, fault_label
from hil_bridge.runs.checks import check
from hil_bridge.runs.setup import Setup
from hil_bridge.settings.configuration import Config, dump, read_values
from hil_bridge.settings.given import config_of

CASES_LIMIT = 100_000
"""Most cells of the matrix times faults. Chosen: all are checked first, in a few milliseconds each."""
_SECTIONS = ("campaign", "config")
_ONLY_FAULT = ("faults", "0")
"""Key of the only fault of a configuration."""
_KEYS = (
    "name",
    "requirements",
    "seeds",
    "cases_per_seed",
    "faults_per_run",
    "config",
    "without_fault",
    "matrix",
    "draw",
    "fault",
    "criteria",
)


class PlanErrors(ConfigError):
    """All problems of a plan, one line each."""

    def __init__(self, problems: Sequence[str]) -> None:
        super().__init__(problems[0] + (f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""))
        self.problems = tuple(problems)


class _Cell(NamedTuple):
    """Cell of the matrix, or one value of an axis."""

    label: str
    head: str
    """The label without its keys."""
    values: Mapping[str, Any]
    """By dotted key."""


def read_plan(path: Path, seeds: tuple[int, ...] = (), settings: Mapping[str, Any] | None = None) -> Plan:
    """Read the plan of a file. `seeds`, if any, replace its own; `settings`, by dotted key, override those that all
    cells share.

    Raises PlanErrors with all problems, ConfigError for invalid TOML.
    """
    return _PlanReader(path, read_toml(path), seeds, settings or {}).plan()


class _PlanReader:
    """Reader that turns a file into a plan and collects its problems."""

    def __init__(
        self, path: Path, values: dict[str, Any], seeds: tuple[int, ...], given: Mapping[str, Any]
    ) -> None:
        self._path = path
        self._given = given
        self._given_seeds = seeds
        self._source = format_path(path)
        self._values = values
        self._problems: list[str] = []

    def plan(self) -> Plan:
        campaign = self._values.get("campaign")
        if not isinstance(campaign, dict):
            raise PlanErrors([f"{self._source}: the table [campaign] is missing"])
        for key in self._values:
            if key not in _SECTIONS:
                self._wrong(key, f"is not a table of a campaign; known: {', '.join(_SECTIONS)}")
        for key in campaign:
            if key not in _KEYS:
                self._wrong(f"campaign.{key}", f"is not a setting; known: {', '.join(_KEYS)}")
        name = campaign.get("name", self._path.stem)
        if not isinstance(name, str) or not name.strip() or not name.isprintable():
            self._wrong("campaign.name", f"must be a text, got {format_value(name)}")
        seeds = self._given_seeds or self._seeds(campaign.get("seeds"))
        share = campaign.get("cases_per_seed", 0)
        if type(share) is not int or share < 0:
            self._wrong("campaign.cases_per_seed", f"must be a whole number, got {format_value(share)}")
        criteria = self._criteria(campaign.get("criteria", {}))
        required = self._requirements(campaign.get("requirements", []))
        base = self._base(campaign.get("config"))
        cells = self._cells(campaign.get("matrix", {}))
        draw = self._draw(campaign)
        faults = [{}] if draw is not None and draw.most else self._faults(campaign)
        if not self._problems and len(cells) * len(faults) > CASES_LIMIT:
            self._wrong("campaign.matrix", f"makes more than {CASES_LIMIT} cells with the faults")
        cases = [] if self._problems else self._cases(base, cells, faults)
        if draw is not None and not self._problems:
            draw = self._check_draw(draw, cases)
            if draw.most:
                cases = [replace(case, fault=DRAWN) for case in cases]
        if self._problems:
            raise PlanErrors(self._problems)
        plan = Plan(name, seeds, tuple(cases), criteria, share, draw, required)
        if share > len(plan.possible):
            self._wrong("campaign.cases_per_seed", f"is more than the {len(plan.possible)} cases there are")
        if plan.count > RUNS_LIMIT:
            self._wrong("campaign", f"makes more than {RUNS_LIMIT} runs")
        if self._problems:
            raise PlanErrors(self._problems)
        return plan

    def _wrong(self, key: str, text: str) -> None:
        self._problems.append(f"{self._source}: {key} {text}")

    def _wrong_in(self, problems: Mapping[str, Sequence[str]], key: str = "") -> None:
        """Add problems, each with the labels of its cells."""
        for problem, labels in problems.items():
            more = f" and {len(labels) - 1} more" if len(labels) > 1 else ""
            self._problems.append(f"{self._source}: {key}{problem} (with {labels[0]}{more})")

    def _requirements(self, given: object) -> tuple[str, ...]:
        names = given if isinstance(given, list) else [None]
        if all(isinstance(name, str) and name.strip() and name.isprintable() for name in names):
            return tuple(names)
        expected = 'must be a list of names such as "R-12"'
        self._wrong("campaign.requirements", f"{expected}, got {format_value(given)}")
        return ()

    def _seeds(self, given: object) -> tuple[int, ...]:
        """Read a list of numbers, or `{ from = 1, to = 50 }` with both ends included."""
        match given:
            case {"from": int(first), "to": int(last), **rest} if not rest and 0 <= first <= last:
                if last - first >= RUNS_LIMIT:
                    self._wrong("campaign.seeds", f"has more than {RUNS_LIMIT} seeds")
                    return ()
                return tuple(range(first, last + 1))
            case list() if given and all(type(seed) is int and seed >= 0 for seed in given):
                if len(set(given)) < len(given):
                    self._wrong("campaign.seeds", "contains a seed twice")
                return tuple(given)
        expected = "must be a list of whole numbers from 0, or { from = 1, to = 50 }"
        self._wrong("campaign.seeds", expected if given is None else f"{expected}, got {format_value(given)}")
        return ()

    def _criteria(self, given: object) -> tuple[Criterion, ...]:
        if not isinstance(given, dict) or not given:
            self._wrong("campaign.criteria", "must be a table with at least one figure")
            return ()
        for figure, allowed in given.items():
            if (problem := problem_of(figure, allowed)) is not None:
                self._wrong(f"campaign.criteria.{figure}", problem)
        return tuple(Criterion(figure, allowed) for figure, allowed in given.items())

    def _draw(self, campaign: Mapping[str, Any]) -> Draw | None:
        """Read the draws of each run; None if there are none."""
        draw, problems = draw_of(campaign)
        for key, text in problems:
            self._wrong(key, text)
        return draw

    def _check_draw(self, draw: Draw, cases: Sequence[Case]) -> Draw:
        """Return the draw without the options that a cell does not support."""
        labels: dict[str, list[str]] = {}
        without: dict[str, tuple[tuple[str, int], ...]] = {}
        for cell, config in dict.fromkeys((case.cell, case.config) for case in cases):
            impossible, problems = try_options(draw, config)
            if impossible:
                without[cell] = impossible
            for problem in problems:
                labels.setdefault(problem, []).append(cell)
        self._wrong_in(labels, "campaign.draw: ")
        return msgspec.structs.replace(draw, without=without)

    def _base(self, path: object) -> dict[str, Any]:
        """Return the values that all cells share: those of the named file, overridden by [config]."""
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
        if bad := [key for key in self._given if key.startswith(("faults", "run.seed"))]:
            self._wrong("--set", f"cannot give {bad[0]}: faults and seeds have their own settings")
        for place, tables in (("config", own), ("campaign.config", values)):
            if "faults" in tables:
                self._wrong(f"{place}.faults", "belongs into tables [[campaign.fault]]")
        for key, value in (*leaves(own), *leaves(self._given)):
            _put(values, key, value)
        return values

    def _cells(self, given: object) -> list[_Cell]:
        """Return every combination of the axes, in the order of the file."""
        if not isinstance(given, dict):
            self._wrong("campaign.matrix", "must be a table of lists")
            return []
        axes: list[list[_Cell]] = []
        for key, values in leaves(given):
            where = f"campaign.matrix.{key}"
            if not isinstance(values, list) or not values:
                self._wrong(where, f"must be a list of values, got {format_value(values)}")
                continue
            tables = [isinstance(value, dict) for value in values]
            if any(tables) and not all(tables):
                self._wrong(where, "mixes tables and plain values; use one kind")
                continue
            axis = [_value(key, value) for value in values]
            if len({json.dumps(one.values, sort_keys=True, default=str) for one in axis}) < len(axis):
                self._wrong(where, "contains a value twice")
            if len({one.label for one in axis}) < len(axis):
                self._wrong(where, "contains a label twice")
            if any(name == "run.seed" or name.startswith("faults") for one in axis for name in one.values):
                self._wrong(where, "cannot be an axis: faults and seeds have their own settings")
            for name in sorted({name for one in axis for name in one.values} & set(self._given)):
                self._wrong(where, f"sets {name}, and so does --set; remove one of them")
            axes.append(axis)
        if math.prod(map(len, axes)) > CASES_LIMIT:  # before any is built: they would fill the memory
            self._wrong("campaign.matrix", f"makes more than {CASES_LIMIT} cells")
            return []
        return [_join(parts) for parts in itertools.product(*axes)]

    def _faults(self, campaign: Mapping[str, Any]) -> list[dict[str, Any]]:
        """Return tables as in [[faults]], one for each phase; the empty one is the case without a fault."""
        without, given = campaign.get("without_fault", True), campaign.get("fault", [])
        if not isinstance(without, bool):
            self._wrong("campaign.without_fault", f"must be true or false, got {format_value(without)}")
        if not isinstance(given, list) or not all(isinstance(table, dict) for table in given):
            self._wrong("campaign.fault", "must be tables [[campaign.fault]]")
            return []
        faults: list[dict[str, Any]] = [{}] if without else []
        for number, table in enumerate(given):
            phases = table.get("phase", "")
            if isinstance(phases, list) and not phases:
                self._wrong(f"campaign.fault.{number}.phase", "is an empty list")
            for phase in phases if isinstance(phases, list) else [phases]:
                one = {**table, "phase": phase}
                if one in faults:
                    self._wrong(f"campaign.fault.{number}", "is a duplicate")
                faults.append(one)
        if not faults:
            self._wrong("campaign.fault", "is missing, and without_fault is false: there is nothing to run")
        return faults

    def _cases(self, base: dict[str, Any], cells: list[_Cell], faults: list[dict[str, Any]]) -> list[Case]:
        cases: list[Case] = []
        refusals: dict[int, list[str]] = {number: [] for number, table in enumerate(faults) if table}
        rejected: dict[str, list[str]] = {}
        for label, head, given in cells:
            values = deepcopy(base)
            for key, value in given.items():
                _put(values, key, value)
            try:
                config = config_of(values, seed=0)
                _check_emulated(config)
                check(Setup(config), True, VIRTUAL_EPOCH)
            except BridgeError as error:
                rejected.setdefault(error.without_source, []).append(label)
                continue
            text = dump(pin_policy(config))
            for number, table in enumerate(faults):
                refusal = _refusal(config, table)
                if table and refusal:
                    refusals[number].append(refusal)
                row = json.dumps(table, sort_keys=True, default=str)
                cases.append(
                    Case(label, head, fault_label(table), table.get("phase", ""), text, row, refusal)
                )
        self._wrong_in(rejected)
        for number, texts in refusals.items():  # a fault that no cell supports is a mistake
            if texts and len(texts) == len(cells) - sum(map(len, rejected.values())):
                self._problems.append(f"{self._source}: campaign.fault.{number}: {texts[0]}")
        return cases


def _value(key: str, value: object) -> _Cell:
    """Return one value of an axis; a table may contain a label."""
    if not isinstance(value, dict):
        return _Cell(f"{key} {value}", f"{value}", {key: value})
    values = dict(leaves(value))
    label = values.pop("label", None) or ", ".join(f"{name} {one}" for name, one in values.items())
    return _Cell(f"{key} {label}", label, values)


def _join(parts: Sequence[_Cell]) -> _Cell:
    plain = "the configuration"
    label = ", ".join(part.label for part in parts) or plain
    return _Cell(
        label,
        ", ".join(part.head for part in parts) or plain,
        {key: value for part in parts for key, value in part.values.items()},
    )


def _refusal(config: Config, table: Mapping[str, Any]) -> str:
    """Return why a cell does not support a fault; empty if it does."""
    if not table:
        return ""
    robot, sensor = config.robot.emulated, config.sensor.emulated
    alike = {"robot": {"emulated": robot}, "sensor": {"emulated": sensor}}
    if surface := getattr(config.cell, "surface_kind", ""):
        alike["cell"] = {"surface_kind": surface}
    try:  # with the devices alone: a thousand complete configurations take seconds
        config_of(alike, [table])
    except SettingRefused as error:
        return (
            error.below(len(_ONLY_FAULT))
            if error.key[: len(_ONLY_FAULT)] == _ONLY_FAULT
            else error.without_source
        )
    except ConfigError as error:
        return str(error)
    return ""


def _check_emulated(config: Config) -> None:
    for key, url in (("robot.url", config.robot.url), ("sensor.url", config.sensor.url)):
        if url:
            raise ConfigError(f"{key}: a campaign runs on the emulated cell only; leave the URL empty")


def _put(values: dict[str, Any], key: str, value: object) -> None:
    *sections, name = key.split(".")
    table: Any = values
    for section in sections:
        inner = table.setdefault(section, {})
        if not isinstance(inner, dict):
            inner = table[section] = {}
        table = inner
    table[name] = deepcopy(value)
