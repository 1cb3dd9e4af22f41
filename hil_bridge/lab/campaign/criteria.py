"""Figures of a campaign run, and the criteria that it must meet."""

import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

from hil_bridge.errors.rounding import three_digits
from hil_bridge.record.analysis.figures import COUNTED, FIGURES, JUDGED

Figure: TypeAlias = int | float | bool | str | dict[str, str | int] | None
"""Value of a figure: a number in the unit of its name, a flag, a word, texts by promise, or counts by name. None if
the run does not have the figure.
"""
Figures: TypeAlias = Mapping[str, Figure]

OUTCOMES = ("completed", "stopped", "interrupted", "refused", "error")
"""Outcomes of a run: the outcomes of a recording, `refused` by a device before any motion, and `error` for a bug."""
BOUNDS: Mapping[str, Callable[[float, float], bool]] = {
    "below": operator.lt,
    "above": operator.gt,
    "at_most": operator.le,
    "at_least": operator.ge,
}
"""Comparison function for each keyword of a bound."""
_ONLY = "outcomes"
_IS = "is"
_FLAGS = "no", "yes"
"""Words for False and True."""


@dataclass(frozen=True, slots=True)
class Unmet:
    """Criterion that a run did not meet, with the value and the bounds as text."""

    figure: str
    """Key of the figure."""
    value: str
    """Value of the figure, with its unit."""
    required: str

    @property
    def text(self) -> str:
        """Unmet criterion as one line of text, such as `overshoot 17.3 %, required below 10 %`."""
        return f"{FIGURES[self.figure].words} {self.value}, required {self.required}"


@dataclass(frozen=True, slots=True)
class Criterion:
    """Criterion of a campaign: the allowed values of one figure."""

    figure: str
    allowed: Any
    """Allowed values as in the file: a value, a list of values, or a table of bounds."""

    def judge(self, figures: Figures) -> bool | None:
        """Return whether the run meets the criterion; None if the criterion does not apply, or the run does not
        have the figure.
        """
        value = figures.get(self.figure)
        if value is None:
            return None
        match self.allowed:
            case dict() as bounds:
                if _ONLY in bounds and figures.get("outcome") not in bounds[_ONLY]:
                    return None
                if _IS in bounds:
                    return bool(value == bounds[_IS])
                return isinstance(value, (int, float)) and all(
                    BOUNDS[name](value, limit) for name, limit in bounds.items() if name != _ONLY
                )
            case list() as values:
                return value in values
            case other:
                return bool(value == other)

    def excess(self, figures: Figures) -> float:
        """Return how far the figure of a run is beyond the farthest bound that it does not meet, as a share of the
        bound; 0 if the criterion is met or has no bound.
        """
        value = figures.get(self.figure)
        if self.judge(figures) is not False or not isinstance(value, (int, float)):
            return 0.0
        unmet = (
            limit for name, limit in self.limits.items() if name in BOUNDS and not BOUNDS[name](value, limit)
        )
        return max((abs(value - limit) / (abs(limit) or 1.0) for limit in unmet), default=0.0)

    @property
    def limits(self) -> Mapping[str, float]:
        """Bounds of the figure by keyword; empty for a figure without bounds."""
        match self.allowed:
            case dict() as bounds:
                return {name: float(bounds[name]) for name in BOUNDS if name in bounds}
            case int() | float() as value if not isinstance(value, bool):
                return {_IS: float(value)}
            case _:
                return {}

    @property
    def text(self) -> str:
        """Criterion as one line of text, with the key of its figure."""
        return f"{self.figure} {self._bounds()}"

    @property
    def title(self) -> str:
        """Criterion as part of a sentence, such as `RMS error below 1.5 N` or `no contact losses`."""
        words, (first, _, rest) = FIGURES[self.figure].words, self.required.partition(" ")
        if first in _FLAGS:
            return f"{'not ' * (first == _FLAGS[False])}{words} {rest}".rstrip()
        return f"no {words}" if self.required == "0" else f"{words} {self.required}"

    @property
    def required(self) -> str:
        """Allowed values in words, with the unit of the figure."""
        return self._bounds(FIGURES[self.figure].unit, plain=True)

    def _bounds(self, unit: str = "", plain: bool = False) -> str:
        """Format the allowed values, `plain` for a reader who does not know the file."""
        flags, scope = (_FLAGS, " in {} runs") if plain else (("false", "true"), " where {}")
        match self.allowed:
            case dict() as bounds:
                parts = [
                    f"{name.replace('_', ' ')} {bounds[name]:g} {unit}".rstrip()
                    for name in BOUNDS
                    if name in bounds
                ]
                parts += [flags[bounds[_IS]]] if _IS in bounds else []
                only = scope.format(" or ".join(bounds[_ONLY])) if _ONLY in bounds else ""
                return f"{', '.join(parts)}{only}"
            case list() as values:
                return " or ".join(map(str, values)).replace(" or ", ", ", plain * (len(values) - 2))
            case bool() as flag:
                return flags[flag]
            case other:
                return f"{other} {unit}".rstrip()


def figure_text(figure: Figure) -> str:
    """Format a figure as text; None becomes an empty text."""
    match figure:
        case None:
            return ""
        case dict():
            return "; ".join(f"{name}: {text}" for name, text in figure.items())
        case float():
            return f"{figure:.6g}"
        case _:
            return str(figure)


def find_unmet(criteria: Sequence[Criterion], figures: Figures) -> list[str]:
    """Return the criteria that a run did not meet, as text. A run that ended by a bug always fails."""
    unmet = ["no bug"] if figures.get("outcome") == "error" else []
    return unmet + [criterion.text for criterion in criteria if criterion.judge(figures) is False]


def unmet_of(criteria: Sequence[Criterion], figures: Figures) -> tuple[Unmet, ...]:
    """Return the criteria that a run did not meet, each with the value of its figure."""
    bug = (Unmet("outcome", "error", "no bug"),) if figures.get("outcome") == "error" else ()
    return bug + tuple(
        Unmet(one.figure, value_text(one.figure, figures.get(one.figure), criteria), one.required)
        for one in criteria
        if one.judge(figures) is False
    )


def value_text(key: str, value: Figure, criteria: Sequence[Criterion] = ()) -> str:
    """Format the value of a figure with its unit: a number with three significant digits, and with more if it would
    otherwise reach or cross a bound of the criteria.
    """
    bounds = [limit for one in criteria if one.figure == key for limit in one.limits.values()]
    if isinstance(value, bool):
        return _FLAGS[value]
    text = three_digits(value, bounds) if isinstance(value, float) else figure_text(value)
    return f"{text} {FIGURES[key].unit}".rstrip()


def problem_of(figure: str, allowed: object) -> str | None:
    """Describe what is wrong with a criterion of a file; None if it is valid."""
    if figure not in JUDGED:
        return f"is not a figure; known: {', '.join(JUDGED)}"
    if figure == "promises":
        return "is text; use promises_broken"
    if figure in COUNTED:
        return "is a table of counts and cannot be a criterion"
    if figure == "outcome":
        outcomes = allowed if isinstance(allowed, list) else [allowed]
        if not outcomes or any(word not in OUTCOMES for word in outcomes):
            return f"must be one or a list of {', '.join(OUTCOMES)}"
        return None
    if figure == "retracted":
        if isinstance(allowed, dict) and isinstance(allowed.get(_IS), bool) and set(allowed) <= {_IS, _ONLY}:
            return _problem_of_outcomes(allowed)
        return None if isinstance(allowed, bool) else f"must be true or false, or a table with {_IS}, {_ONLY}"
    if not isinstance(allowed, dict):
        return None if _is_number(allowed) else f"must be a number or a table with {', '.join(BOUNDS)}"
    return _problem_of_bounds(allowed)


def _problem_of_bounds(allowed: Mapping[str, Any]) -> str | None:
    if unknown := [name for name in allowed if name not in BOUNDS and name != _ONLY]:
        return f"has an unknown key {unknown[0]!r}; known: {', '.join(BOUNDS)}, {_ONLY}"
    if not any(name in BOUNDS for name in allowed):
        return f"needs one of {', '.join(BOUNDS)}"
    if wrong := [name for name in BOUNDS if name in allowed and not _is_number(allowed[name])]:
        return f"{wrong[0]} must be a number, got {allowed[wrong[0]]}"
    return _problem_of_outcomes(allowed)


def _problem_of_outcomes(allowed: Mapping[str, Any]) -> str | None:
    only = allowed.get(_ONLY, [OUTCOMES[0]])
    if not isinstance(only, list) or not only or any(word not in OUTCOMES for word in only):
        return f"{_ONLY} must be a list of {', '.join(OUTCOMES)}"
    return None


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and value == value
