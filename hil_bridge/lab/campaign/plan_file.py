"""Campaign file in TOML, which is checked completely before the first run."""

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
from hil_bridge.lab.campaign.plan import RUNS_LIMIT, Case, Plan, PrimaryFigure, fault_label
from hil_bridge.record.analysis.figures import JUDGED, WORDS
from hil_bridge.runs.checks import check
from hil_bridge.runs.setup import Setup
from hil_bridge.settings.configuration import Config, dump, read_values
from hil_bridge.settings.given import config_of

CASES_LIMIT = 100_000
"""Maximum number of cases: cells of the matrix times faults. Chosen: all cases are checked before the first run, in
a few milliseconds each.
"""
_SECTIONS = ("campaign", "config")
_ONLY_FAULT = ("faults", "0")
"""Prefix of the keys of a configuration's only fault."""
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
    "primary",
)


class PlanErrors(ConfigError):
    """Error that lists all problems of a plan, one line each."""

    def __init__(self, problems: Sequence[str]) -> None:
        super().__init__(problems[0] + (f" (and {len(problems) - 1} more)" if len(problems) > 1 else ""))
        self.problems = tuple(problems)


class _Cell(NamedTuple):
    """Cell of the matrix, or one value of an axis."""

    label: str
    head: str
    """Label of the cell without keys."""
    values: Mapping[str, Any]
    """Settings of the cell, by dotted key."""


def read_plan(path: Path, seeds: tuple[int, ...] = (), settings: Mapping[str, Any] | None = None) -> Plan:
    """Read the plan of a file.

    `seeds`, if any, replace the seeds of the file. `settings`, by dotted key, override the settings that all cells
    share. Raises PlanErrors with all problems, and ConfigError for invalid TOML.
    """
    return _PlanReader(path, read_toml(path), seeds, settings or {}).plan()


class _PlanReader:
    """Reader that turns a file into a plan and collects its problems."""

    def __init__(
        self, path: Path, values: dict[str, Any], seeds: tuple[int, ...], overrides: Mapping[str, Any]
    ) -> None:
        self._path = path
        self._overrides = overrides
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
                self._add_problem(key, f"is not a table of a campaign; known: {', '.join(_SECTIONS)}")
        for key in campaign:
            if key not in _KEYS:
                self._add_problem(f"campaign.{key}", f"is not a setting; known: {', '.join(_KEYS)}")
        name = campaign.get("name", self._path.stem)
        if not isinstance(name, str) or not name.strip() or not name.isprintable():
            self._add_problem("campaign.name", f"must be a text, got {format_value(name)}")
        seeds = self._given_seeds or self._seeds(campaign.get("seeds"))
        share = campaign.get("cases_per_seed", 0)
        if type(share) is not int or share < 0:
            self._add_problem("campaign.cases_per_seed", f"must be a whole number, got {format_value(share)}")
        criteria = self._criteria(campaign.get("criteria", {}))
        required = self._requirements(campaign.get("requirements", []))
        primary = self._primary(campaign.get("primary", []))
        base = self._base(campaign.get("config"))
        axes = self._axes(campaign.get("matrix", {}))
        cells = [_join(parts) for parts in itertools.product(*axes)]
        draw = self._draw(campaign)
        faults = [{}] if draw is not None and draw.most else self._faults(campaign)
        if not self._problems and len(cells) * len(faults) > CASES_LIMIT:
            self._add_problem("campaign.matrix", f"makes more than {CASES_LIMIT} cells with the faults")
        cases = [] if self._problems else self._cases(base, cells, faults)
        if draw is not None and not self._problems:
            draw = self._check_draw(draw, cases)
            if draw.most:
                cases = [replace(case, fault=DRAWN) for case in cases]
        if self._problems:
            raise PlanErrors(self._problems)
        labels = tuple(tuple(one.label for one in axis) for axis in axes)
        plan = Plan(name, seeds, tuple(cases), criteria, share, draw, required, primary, labels)
        self._check_complete(plan)
        return plan

    def _check_complete(self, plan: Plan) -> None:
        """Check what concerns the complete plan. Raises PlanErrors."""
        for place, one in enumerate(plan.primary):
            if one.case not in plan.labels:
                self._add_problem(
                    f"campaign.primary.{place}.case", f"{one.case!r} is not the label of a case"
                )
        if plan.cases_per_seed > len(plan.possible):
            self._add_problem(
                "campaign.cases_per_seed", f"is more than the {len(plan.possible)} cases there are"
            )
        if plan.count > RUNS_LIMIT:
            self._add_problem("campaign", f"makes more than {RUNS_LIMIT} runs")
        if self._problems:
            raise PlanErrors(self._problems)

    def _add_problem(self, key: str, text: str) -> None:
        self._problems.append(f"{self._source}: {key} {text}")

    def _add_cell_problems(self, problems: Mapping[str, Sequence[str]], key: str = "") -> None:
        """Add problems, each with the labels of the cells in which it occurs."""
        for problem, labels in problems.items():
            more = f" and {len(labels) - 1} more" if len(labels) > 1 else ""
            self._problems.append(f"{self._source}: {key}{problem} (with {labels[0]}{more})")

    def _requirements(self, value: object) -> tuple[str, ...]:
        names = value if isinstance(value, list) else [None]
        if all(isinstance(name, str) and name.strip() and name.isprintable() for name in names):
            return tuple(names)
        expected = 'must be a list of names such as "R-12"'
        self._add_problem("campaign.requirements", f"{expected}, got {format_value(value)}")
        return ()

    def _seeds(self, value: object) -> tuple[int, ...]:
        """Read a list of numbers, or `{ from = 1, to = 50 }` with both ends included."""
        match value:
            case {"from": int(first), "to": int(last), **rest} if not rest and 0 <= first <= last:
                if last - first >= RUNS_LIMIT:
                    self._add_problem("campaign.seeds", f"has more than {RUNS_LIMIT} seeds")
                    return ()
                return tuple(range(first, last + 1))
            case list() if value and all(type(seed) is int and seed >= 0 for seed in value):
                if len(set(value)) < len(value):
                    self._add_problem("campaign.seeds", "contains a seed twice")
                return tuple(value)
        expected = "must be a list of whole numbers from 0, or { from = 1, to = 50 }"
        self._add_problem(
            "campaign.seeds", expected if value is None else f"{expected}, got {format_value(value)}"
        )
        return ()

    def _criteria(self, value: object) -> tuple[Criterion, ...]:
        if not isinstance(value, dict) or not value:
            self._add_problem("campaign.criteria", "must be a table with at least one figure")
            return ()
        for figure, allowed in value.items():
            if (problem := problem_of(figure, allowed)) is not None:
                self._add_problem(f"campaign.criteria.{figure}", problem)
        return tuple(Criterion(figure, allowed) for figure, allowed in value.items())

    def _primary(self, given: object) -> tuple[PrimaryFigure, ...]:
        """Read the figures by which results are compared first."""
        try:
            figures = msgspec.convert(given, tuple[PrimaryFigure, ...])
        except msgspec.ValidationError as error:
            self._add_problem("campaign.primary", f"must be tables with title, case and figure: {error}")
            return ()
        for place, one in enumerate(figures):
            if one.figure not in JUDGED or one.figure in WORDS:
                self._add_problem(
                    f"campaign.primary.{place}.figure", f"{one.figure!r} is not a number of a run"
                )
        return figures

    def _draw(self, campaign: Mapping[str, Any]) -> Draw | None:
        """Read the draws of each run; None if the file has none."""
        draw, problems = draw_of(campaign)
        for key, text in problems:
            self._add_problem(key, text)
        return draw

    def _check_draw(self, draw: Draw, cases: Sequence[Case]) -> Draw:
        """Check the draw in each cell. Return the draw without the options that a cell does not support."""
        labels: dict[str, list[str]] = {}
        without: dict[str, tuple[tuple[str, int], ...]] = {}
        for cell, config in dict.fromkeys((case.cell, case.config) for case in cases):
            impossible, problems = try_options(draw, config)
            if impossible:
                without[cell] = impossible
            for problem in problems:
                labels.setdefault(problem, []).append(cell)
        self._add_cell_problems(labels, "campaign.draw: ")
        return msgspec.structs.replace(draw, without=without)

    def _base(self, path: object) -> dict[str, Any]:
        """Return the values that all cells share: the values of the named file, overridden by [config]."""
        values: dict[str, Any] = {}
        if isinstance(path, str) and path:
            try:
                values = read_values(self._path.parent / path)
            except ConfigError as error:
                self._add_problem("campaign.config:", str(error))
        elif path is not None:
            self._add_problem(
                "campaign.config", f"must be the path of a configuration, got {format_value(path)}"
            )
        own = self._values.get("config", {})
        if not isinstance(own, dict):
            self._add_problem("config", "must be a table of settings")
            return values
        if bad := [key for key in self._overrides if key.startswith(("faults", "run.seed"))]:
            self._add_problem("--set", f"cannot give {bad[0]}: faults and seeds have their own settings")
        for place, tables in (("config", own), ("campaign.config", values)):
            if "faults" in tables:
                self._add_problem(f"{place}.faults", "belongs into tables [[campaign.fault]]")
        for key, value in (*leaves(own), *leaves(self._overrides)):
            _put(values, key, value)
        return values

    def _axes(self, given: object) -> list[list[_Cell]]:
        """Return the axes of the matrix, in the order of the file; none if they are invalid."""
        if not isinstance(given, dict):
            self._add_problem("campaign.matrix", "must be a table of lists")
            return []
        axes: list[list[_Cell]] = []
        for key, values in leaves(given):
            where = f"campaign.matrix.{key}"
            if not isinstance(values, list) or not values:
                self._add_problem(where, f"must be a list of values, got {format_value(values)}")
                continue
            tables = [isinstance(value, dict) for value in values]
            if any(tables) and not all(tables):
                self._add_problem(where, "mixes tables and plain values; use one kind")
                continue
            axis = [_value(key, value) for value in values]
            if len({json.dumps(one.values, sort_keys=True, default=str) for one in axis}) < len(axis):
                self._add_problem(where, "contains a value twice")
            if len({one.label for one in axis}) < len(axis):
                self._add_problem(where, "contains a label twice")
            if any(name == "run.seed" or name.startswith("faults") for one in axis for name in one.values):
                self._add_problem(where, "cannot be an axis: faults and seeds have their own settings")
            for name in sorted({name for one in axis for name in one.values} & set(self._overrides)):
                self._add_problem(where, f"sets {name}, and so does --set; remove one of them")
            axes.append(axis)
        if (
            math.prod(map(len, axes)) > CASES_LIMIT
        ):  # before any cell is built, because the cells would fill the memory
            self._add_problem("campaign.matrix", f"makes more than {CASES_LIMIT} cells")
            return []
        return axes

    def _faults(self, campaign: Mapping[str, Any]) -> list[dict[str, Any]]:
        """Return the fault tables as in [[faults]], one for each phase; an empty table is the case without a fault."""
        without, given = campaign.get("without_fault", True), campaign.get("fault", [])
        if not isinstance(without, bool):
            self._add_problem("campaign.without_fault", f"must be true or false, got {format_value(without)}")
        if not isinstance(given, list) or not all(isinstance(table, dict) for table in given):
            self._add_problem("campaign.fault", "must be tables [[campaign.fault]]")
            return []
        faults: list[dict[str, Any]] = [{}] if without else []
        for number, table in enumerate(given):
            phases = table.get("phase", "")
            if isinstance(phases, list) and not phases:
                self._add_problem(f"campaign.fault.{number}.phase", "is an empty list")
            for phase in phases if isinstance(phases, list) else [phases]:
                one = {**table, "phase": phase}
                if one in faults:
                    self._add_problem(f"campaign.fault.{number}", "is a duplicate")
                faults.append(one)
        if not faults:
            self._add_problem(
                "campaign.fault", "is missing, and without_fault is false: there is nothing to run"
            )
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
        self._add_cell_problems(rejected)
        for number, texts in refusals.items():  # a fault that no cell supports is a mistake
            if texts and len(texts) == len(cells) - sum(map(len, rejected.values())):
                self._problems.append(f"{self._source}: campaign.fault.{number}: {texts[0]}")
        return cases


def _value(key: str, value: object) -> _Cell:
    """Return one value of an axis. A table may contain a label for it."""
    if not isinstance(value, dict):
        short = f"{value:g}" if isinstance(value, float) else f"{value}"
        return _Cell(f"{key} {value}", f"{key.rpartition('.')[2]} {short}", {key: value})
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
    """Return the reason why a cell does not support a fault; empty if it does."""
    if not table:
        return ""
    robot, sensor = config.robot.emulated, config.sensor.emulated
    alike = {"robot": {"emulated": robot}, "sensor": {"emulated": sensor}}
    if surface := getattr(config.cell, "surface_kind", ""):
        alike["cell"] = {"surface_kind": surface}
    try:  # checks the devices alone, because a thousand complete configurations take seconds
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
