"""Figures of a run in a campaign, and the criteria that it has to meet."""

import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

from hil_bridge.record.analysis.figures import COUNTED, FIGURES, JUDGED

Figure: TypeAlias = int | float | bool | str | dict[str, str | int] | None
"""A number in the unit of its name, an answer, a word, words by the name of a promise, or counts by name; None where
the run did not show it.
"""
Figures: TypeAlias = Mapping[str, Figure]

OUTCOMES = ("completed", "stopped", "interrupted", "refused", "error")
"""Outcomes of a run: those of a recording, a run that a device refused before it moved, and a bug."""
BOUNDS: Mapping[str, Callable[[float, float], bool]] = {
    "below": operator.lt,
    "above": operator.gt,
    "at_most": operator.le,
    "at_least": operator.ge,
}
"""Words of a bound, and what they compare."""
_ONLY = "outcomes"
_IS = "is"


@dataclass(frozen=True, slots=True)
class Unmet:
    """A criterion that a run did not meet: the value beside its bounds, in words."""

    figure: str
    """Key of the figure."""
    value: str
    """With its unit."""
    wanted: str

    @property
    def text(self) -> str:
        """In words: `overshoot 17.3 %, wanted below 10`."""
        return f"{FIGURES[self.figure].words} {self.value}, wanted {self.wanted}"


@dataclass(frozen=True, slots=True)
class Criterion:
    """Bounds of one figure."""

    figure: str
    wanted: Any
    """A value, a list of values, or a table of bounds as in the file."""

    def judge(self, figures: Figures) -> bool | None:
        """Whether it is met; None where it does not concern the run, or the run has no such figure."""
        value = figures.get(self.figure)
        if value is None:
            return None
        match self.wanted:
            case dict() as bounds:
                if _ONLY in bounds and figures.get("outcome") not in bounds[_ONLY]:
                    return None
                if _IS in bounds:
                    return bool(value == bounds[_IS])
                return isinstance(value, (int, float)) and all(
                    BOUNDS[name](value, limit) for name, limit in bounds.items() if name != _ONLY
                )
            case list() as allowed:
                return value in allowed
            case other:
                return bool(value == other)

    @property
    def text(self) -> str:
        """In words."""
        return f"{self.figure} {self.bounds}"

    @property
    def bounds(self) -> str:
        """The wanted values in words, without the figure."""
        match self.wanted:
            case dict() as bounds:
                parts = [f"{name.replace('_', ' ')} {bounds[name]:g}" for name in BOUNDS if name in bounds]
                parts += [str(bounds[_IS]).lower()] if _IS in bounds else []
                only = f" where {' or '.join(bounds[_ONLY])}" if _ONLY in bounds else ""
                return f"{', '.join(parts)}{only}"
            case list() as allowed:
                return " or ".join(map(str, allowed))
            case bool() as wanted:
                return str(wanted).lower()
            case other:
                return f"{other}"


def figure_text(figure: Figure) -> str:
    """A figure in words; empty where there is none."""
    match figure:
        case None:
            return ""
        case dict():
            return "; ".join(f"{name}: {words}" for name, words in figure.items())
        case float():
            return f"{figure:.6g}"
        case _:
            return str(figure)


def find_unmet(criteria: Sequence[Criterion], figures: Figures) -> list[str]:
    """Criteria that a run did not meet, in words. A bug fails every run."""
    broken = ["no bug"] if figures.get("outcome") == "error" else []
    return broken + [criterion.text for criterion in criteria if criterion.judge(figures) is False]


def unmet_of(criteria: Sequence[Criterion], figures: Figures) -> tuple[Unmet, ...]:
    """The same with the value of each figure beside its bounds."""
    bug = (Unmet("outcome", "error", "no bug"),) if figures.get("outcome") == "error" else ()
    return bug + tuple(
        Unmet(one.figure, value_text(one.figure, figures.get(one.figure)), one.bounds)
        for one in criteria
        if one.judge(figures) is False
    )


def value_text(key: str, value: Figure) -> str:
    """A figure's value with its unit, in words."""
    return f"{figure_text(value)} {FIGURES[key].unit}".rstrip()


def problem_of(figure: str, wanted: object) -> str | None:
    """Fault of a criterion of a file, in words; None where it has none."""
    if figure not in JUDGED:
        return f"is no figure; choose from {', '.join(JUDGED)}"
    if figure == "promises":
        return "is in words; use promises_broken"
    if figure in COUNTED:
        return "is a table of counts, and no criterion"
    if figure == "outcome":
        asked = wanted if isinstance(wanted, list) else [wanted]
        if not asked or any(word not in OUTCOMES for word in asked):
            return f"must be one or a list of {', '.join(OUTCOMES)}"
        return None
    if figure == "retracted":
        if isinstance(wanted, dict) and isinstance(wanted.get(_IS), bool) and set(wanted) <= {_IS, _ONLY}:
            return _problem_of_outcomes(wanted)
        return None if isinstance(wanted, bool) else f"must be true or false, or a table with {_IS}, {_ONLY}"
    if not isinstance(wanted, dict):
        return None if _is_number(wanted) else f"must be a number or a table with {', '.join(BOUNDS)}"
    return _problem_of_bounds(wanted)


def _problem_of_bounds(wanted: Mapping[str, Any]) -> str | None:
    if unknown := [name for name in wanted if name not in BOUNDS and name != _ONLY]:
        return f"has no {unknown[0]!r}, only {', '.join(BOUNDS)}, {_ONLY}"
    if not any(name in BOUNDS for name in wanted):
        return f"needs one of {', '.join(BOUNDS)}"
    if wrong := [name for name in BOUNDS if name in wanted and not _is_number(wanted[name])]:
        return f"{wrong[0]} must be a number, got {wanted[wrong[0]]}"
    return _problem_of_outcomes(wanted)


def _problem_of_outcomes(wanted: Mapping[str, Any]) -> str | None:
    only = wanted.get(_ONLY, [OUTCOMES[0]])
    if not isinstance(only, list) or not only or any(word not in OUTCOMES for word in only):
        return f"{_ONLY} must be a list of {', '.join(OUTCOMES)}"
    return None


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and value == value
