"""Rule bases of a fuzzy controller, read from TOML and checked for completeness.

A rule base has two inputs, the force error and its change in percent of the desired force, and one output. Edges
divide each input into levels. Each linguistic term defines the degree to which every level belongs to it. A rule
gives the output term for a pair of input terms. The output levels are factors on one output step.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

from hil_bridge.control.laws import tables
from hil_bridge.errors import ConfigError
from hil_bridge.errors.text_files import (
    TOML_LIMIT_BYTES,
    format_value,
    parse_toml,
    read_text,
    toml_pair,
    toml_value,
)

Table = tuple[tuple[float, ...], ...]


class Term(NamedTuple):
    """Linguistic term."""

    name: str
    degrees: tuple[float, ...]
    """Degree (0 … 1) to which each level of the variable belongs to the term."""


class Rule(NamedTuple):
    """Rule given by three names of terms: if the error is … and its change is …, the output is …."""

    error: str
    change: str
    output: str


@dataclass(frozen=True, slots=True)
class Variable:
    """Linguistic variable: the error, its change or the output."""

    name: str
    levels: tuple[float, ...]
    """Names of the levels, ascending. For the output they are also its values in output steps."""
    edges_percent: tuple[float, ...]
    """Edges between neighbouring levels, ascending, in percent; empty for the output."""
    terms: tuple[Term, ...]

    def __post_init__(self) -> None:
        """Raise ValueError if the numbers or lengths do not form a valid variable."""
        _check_ascending(f"{self.name}.levels", self.levels)
        # The continuous surface extends the outermost levels by the slope between two edges.
        if len(self.levels) < 3:
            raise ValueError(f"{self.name}.levels must be at least 3, got {len(self.levels)}")
        if not self.terms:
            raise ValueError(f"{self.name}.terms is empty")
        names = [term.name for term in self.terms]
        if twice := [name for name in names if names.count(name) > 1]:
            raise ValueError(f"{self.name}.terms: {twice[0]} is defined twice")
        for name, degrees in self.terms:
            where = f"{self.name}.terms.{name}"
            if len(degrees) != len(self.levels):
                raise ValueError(
                    f"{where} must have {len(self.levels)} degrees, one for each level, got {len(degrees)}"
                )
            for level, degree in zip(self.levels, degrees, strict=True):
                if not 0.0 <= degree <= 1.0:
                    raise ValueError(f"{where} must be within 0 and 1, got {degree:g} at level {level:g}")
            if not any(degrees):
                raise ValueError(f"{where} is 0 at every level")


@dataclass(frozen=True, slots=True)
class RuleBase:
    """Complete rule base of a fuzzy controller."""

    error: Variable
    change: Variable
    output: Variable
    rules: tuple[Rule, ...]
    printed: Table | None = None
    """Output levels for error level (row) and change level (column), if a source prints such a table with its
    rules. The printed table may differ from the table computed from the rules.
    """

    def __post_init__(self) -> None:
        """Raise ValueError for the first rule or term that is missing, contradictory or unused."""
        for variable in (self.error, self.change):
            _check_input(variable)
        known = [{term.name for term in v.terms} for v in (self.error, self.change, self.output)]
        outcomes: dict[tuple[str, str], str] = {}
        for number, rule in enumerate(self.rules, 1):
            for name, names, role in zip(rule, known, ("error", "change", "output"), strict=True):
                if name not in names:
                    raise ValueError(f"inference.rules, number {number}: {role} has no term {name!r}")
            before = outcomes.setdefault((rule.error, rule.change), rule.output)
            if before != rule.output:
                raise ValueError(
                    f"inference.rules, number {number}: error {rule.error} with change {rule.change} "
                    f"gives {rule.output}, but {before} in an earlier rule"
                )
        missing = [
            f"error {e.name} with change {c.name}"
            for e in self.error.terms
            for c in self.change.terms
            if (e.name, c.name) not in outcomes
        ]
        if missing:
            more = f" (and {len(missing) - 1} more)" if len(missing) > 1 else ""
            raise ValueError(f"inference.rules: no rule for {missing[0]}{more}")
        if self.printed is not None:
            self._check_printed(self.printed)

    def _check_printed(self, printed: Table) -> None:
        rows, columns = len(self.error.levels), len(self.change.levels)
        if len(printed) != rows or any(len(row) != columns for row in printed):
            raise ValueError(f"inference.printed must have {rows} rows of {columns} numbers")
        low, high = self.output.levels[0], self.output.levels[-1]
        if not all(low <= value <= high for row in printed for value in row):
            raise ValueError(f"inference.printed must stay within the output's levels, {low:g} to {high:g}")


def parse_rules(text: str, source: str = "rules") -> RuleBase:
    """Return the rule base from a TOML text. Raises ConfigError, with `source` and the entry in its text.

    `levels` and `[terms]` at the top level apply to every variable that does not define its own.
    """
    values = parse_toml(text, source)
    try:
        return _base(values)
    except ValueError as error:
        raise ConfigError(f"{source}: {error}") from error


def read_rules(path: str | Path) -> RuleBase:
    """Return the rule base from a TOML file. Raises ConfigError, with the file and the entry in its text."""
    return parse_rules(read_text(Path(path), TOML_LIMIT_BYTES), str(path))


def rules_as_toml(base: RuleBase) -> str:
    """Return a TOML text from which `parse_rules` returns the same rule base, as a starting point for a custom rule
    base.
    """
    lines = ["# Rule base of a fuzzy force controller.", ""]
    lines += [
        "# Borders between the levels of an input, percent of the desired force; degree to which each level",
        "# belongs to a term; for the output, levels are factors on one output step, positive inwards.",
    ]
    for variable in (base.error, base.change, base.output):
        lines.append(f"[{variable.name}]")
        lines.append(toml_pair("levels", variable.levels))
        if variable is not base.output:
            lines.append(toml_pair("edges_percent", variable.edges_percent))
        lines += ["terms." + toml_pair(term.name, term.degrees) for term in variable.terms]
        lines.append("")
    lines.append("[inference]")
    lines.append("# error, change, output")
    lines.append("rules = [")
    for _, group in _by_error(base.rules):
        lines.append("  " + " ".join(f"{toml_value(rule)}," for rule in group))
    lines.append("]")
    if base.printed is not None:
        lines.append("# output level as a source prints it: rows are error levels, columns change levels")
        lines.append("printed = [")
        lines += [f"  {toml_value(row)}," for row in base.printed]
        lines.append("]")
    return "\n".join(lines) + "\n"


def _read_built_in() -> RuleBase:
    terms = tuple(Term(name, degrees) for name, degrees in tables.MEMBERSHIPS.items())
    names = tuple(tables.MEMBERSHIPS)
    return RuleBase(
        Variable("error", tables.LEVELS, tables.ERROR_EDGES_PERCENT, terms),
        Variable("change", tables.LEVELS, tables.CHANGE_EDGES_PERCENT, terms),
        Variable("output", tables.LEVELS, (), terms),
        tuple(
            Rule(error, change, output)
            for error, row in tables.RULES.items()
            for change, output in zip(names, row, strict=True)
        ),
        tables.GAIN_MATRIX,
    )


def _check_ascending(where: str, numbers: Sequence[float]) -> None:
    if not all(math.isfinite(number) for number in numbers):
        raise ValueError(f"{where} must be finite numbers")
    for left, right in pairwise(numbers):
        if not left < right:
            raise ValueError(f"{where} must ascend, but {right:g} follows {left:g}")


def _check_input(variable: Variable) -> None:
    where = f"{variable.name}.edges_percent"
    _check_ascending(where, variable.edges_percent)
    edge_count = len(variable.levels) - 1
    if len(variable.edges_percent) != edge_count:
        raise ValueError(
            f"{where} must be {edge_count} numbers, one fewer than levels, got {len(variable.edges_percent)}"
        )
    for index, level in enumerate(variable.levels):
        if not any(term.degrees[index] for term in variable.terms):
            raise ValueError(f"{variable.name}.terms leave a gap: no term is above 0 at level {level:g}")


def _base(values: dict[str, Any]) -> RuleBase:
    _check_keys("", values, {"levels", "terms", "error", "change", "output", "inference"})
    inference = _table("inference", values.get("inference", {}))
    _check_keys("inference.", inference, {"rules", "printed"})
    printed = inference.get("printed")
    return RuleBase(
        _variable("error", values, {"levels", "terms", "edges_percent"}),
        _variable("change", values, {"levels", "terms", "edges_percent"}),
        _variable("output", values, {"levels", "terms"}),
        tuple(_rule(n, rule) for n, rule in enumerate(_list("inference.rules", inference.get("rules")), 1)),
        None
        if printed is None
        else tuple(_numbers("inference.printed", row) for row in _list("inference.printed", printed)),
    )


def _variable(name: str, values: dict[str, Any], known: set[str]) -> Variable:
    section = _table(name, values.get(name, {}))
    _check_keys(f"{name}.", section, known)
    terms = _table(f"{name}.terms", section.get("terms", values.get("terms")))
    return Variable(
        name,
        _numbers(f"{name}.levels", section.get("levels", values.get("levels"))),
        _numbers(f"{name}.edges_percent", section.get("edges_percent")) if "edges_percent" in known else (),
        tuple(Term(term, _numbers(f"{name}.terms.{term}", degrees)) for term, degrees in terms.items()),
    )


def _check_keys(prefix: str, section: dict[str, Any], known: set[str]) -> None:
    for key in section:
        if key not in known:
            raise ValueError(
                f"{prefix}{key} is not an entry of a rule base; known: {', '.join(sorted(known))}"
            )


def _table(where: str, value: object) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise ValueError(f"{where} is missing" if value is None else f"{where} must be a table")
    return value


def _list(where: str, value: object) -> list[Any]:
    if not isinstance(value, list):
        raise ValueError(f"{where} is missing" if value is None else f"{where} must be an array")
    return value


def _numbers(where: str, value: object) -> tuple[float, ...]:
    numbers = _list(where, value)
    for number in numbers:
        if isinstance(number, bool) or not isinstance(number, (int, float)):
            raise ValueError(f"{where} must be numbers, got {format_value(number)}")
    return tuple(numbers)


def _rule(number: int, value: object) -> Rule:
    if not (isinstance(value, list) and len(value) == 3 and all(isinstance(name, str) for name in value)):
        raise ValueError(
            f"inference.rules, number {number} must be three names of terms [error, change, output], "
            f"got {format_value(value)}"
        )
    return Rule(*value)


def _by_error(rules: Sequence[Rule]) -> list[tuple[str, list[Rule]]]:
    rows: dict[str, list[Rule]] = {}
    for rule in rules:
        rows.setdefault(rule.error, []).append(rule)
    return list(rows.items())


PAPER_RULES = _read_built_in()
"""The paper's Tables 1 and 2, the rules recovered from its Table 3, and Table 3 as printed."""
