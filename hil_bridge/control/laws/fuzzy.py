"""Fuzzy inference: quantised error and change of error to an output level, of the paper's rules or others.

Three surfaces over the same inputs. `paper` looks the answer up in the table that is printed with the rules.
`rules` looks it up in a table computed from the rules: AND is the minimum, implication the minimum,
aggregation the maximum, the answer the centre of gravity over the output's levels, rounded to the nearest
level. `continuous` is the limit of ever finer levels that the paper mentions: memberships interpolated
between levels, nothing rounded.
"""

import math
from bisect import bisect_left, bisect_right
from enum import StrEnum
from functools import cache

from msgspec import Struct

from hil_bridge.control.laws.rules import PAPER_RULES, RuleBase, Table, Term
from hil_bridge.control.laws.tables import LEVELS

Terms = list[list[tuple[str, float, float]]]
"""For each level the terms that hold somewhere between it and the next, with their degrees at both."""
Strengths = dict[str, float]
"""Degrees to which terms hold, by name; terms that do not hold are left out."""

TOP_LEVEL = LEVELS[-1]


class Surface(StrEnum):
    """Which control surface answers."""

    PAPER = "paper"
    """The table as printed with the rules (the paper's Table 3, its one asymmetric entry included); where a
    rule base prints none, as `rules`.
    """
    RULES = "rules"
    """The table as the rules give it."""
    CONTINUOUS = "continuous"
    """The rules without quantisation of inputs and output."""


class Inference(Struct, frozen=True):
    """One evaluation of a surface; levels of the rule base but on the continuous surface."""

    level_error: float
    level_change: float
    level_output: float


class InferenceSystem:
    """A rule base made ready to answer within microseconds."""

    def __init__(self, base: RuleBase, surface: Surface) -> None:
        self.base = base
        self.surface = surface
        self._error_terms = _between_levels(base.error.terms)
        self._change_terms = _between_levels(base.change.terms)
        self._shapes = {
            term.name: [(place, degree) for place, degree in enumerate(term.degrees) if degree > 0.0]
            for term in base.output.terms
        }
        """Places among the output's levels at which each term holds, and its degree there."""
        self._rules: dict[str, dict[str, tuple[str, str]]] = {term.name: {} for term in base.error.terms}
        for rule in base.rules:
            name = f"{rule.error}∧{rule.change}→{rule.output}"
            self._rules[rule.error][rule.change] = name, rule.output
        self._explanations: dict[tuple[int, int], dict[str, float]] = {}
        # Computed here and not when first needed: that would be within a control cycle.
        self._table: Table | None = None
        if surface == Surface.PAPER and base.printed is not None:
            self._table = base.printed
        elif surface != Surface.CONTINUOUS:
            self._table = self.computed_table()

    def evaluate(self, error_percent: float, change_percent: float) -> Inference:
        """Output level for an error and its change, percent of the desired force. ValueError for a NaN."""
        found = self.explain(error_percent, change_percent)
        return Inference(found["level_error"], found["level_change"], found["level_output"])

    def explain(self, error_percent: float, change_percent: float) -> dict[str, float]:
        """Return the rules that fire, by names such as `NB∧ZO→PM`, and to what degree; then the levels of `evaluate`.

        With quantised inputs the rules are those of the two levels, even where a printed table says otherwise.
        """
        error, change = self.base.error, self.base.change
        if self._table is None:
            row = _position(error_percent, error.edges_percent)
            column = _position(change_percent, change.edges_percent)
            rules, outputs = self._fire(row, column)
            levels = _level_at(row, error.levels), _level_at(column, change.levels)
            return _explanation(rules, *levels, self._centre(outputs))
        i = _index(error_percent, error.edges_percent)
        j = _index(change_percent, change.edges_percent)
        found = self._explanations.get((i, j))
        if found is None:
            levels, rules = (error.levels[i], change.levels[j]), self._fire(i, j)[0]
            found = self._explanations[i, j] = _explanation(rules, *levels, self._table[i][j])
        return found.copy()

    def infer(self, row: float, column: float) -> float:
        """Centre of gravity over the output's levels for two places among the levels of error and change.

        A place is a level's number counted from 0, or lies between two.
        """
        return self._centre(self._fire(row, column)[1])

    def _centre(self, outputs: Strengths) -> float:
        """Implication by the minimum, aggregation by the maximum, centre of gravity."""
        levels, shapes = self.base.output.levels, self._shapes
        heights = [0.0] * len(levels)
        for output, strength in outputs.items():
            for place, degree in shapes[output]:
                height = degree if degree < strength else strength
                if height > heights[place]:
                    heights[place] = height
        moment = area = 0.0
        for level, height in zip(levels, heights):  # noqa: B905 – one height a level
            moment += height * level
            area += height
        return moment / area

    def computed_table(self) -> Table:
        """Return the output level that the rules give for each level of error (row) and change (column)."""
        columns = range(len(self.base.change.levels))
        levels = self.base.output.levels
        return tuple(
            tuple(_nearest(self.infer(row, column), levels) for column in columns)
            for row in range(len(self.base.error.levels))
        )

    def _fire(self, row: float, column: float) -> tuple[Strengths, Strengths]:
        """Return the rules that fire, and the output terms, each as far as the strongest rule that names it."""
        changes = _memberships(column, self._change_terms)
        fired: Strengths = {}
        outputs: Strengths = {}
        for error, error_degree in _memberships(row, self._error_terms):
            rules = self._rules[error]
            for change, degree in changes:
                strength = degree if degree < error_degree else error_degree
                name, output = rules[change]
                fired[name] = strength
                if output not in outputs or strength > outputs[output]:
                    outputs[output] = strength
        return fired, outputs


def _explanation(rules: Strengths, error: float, change: float, output: float) -> dict[str, float]:
    """Return the rules and the three levels, by name."""
    return {**rules, "level_error": error, "level_change": change, "level_output": output}


@cache
def paper_system(surface: Surface) -> InferenceSystem:
    """Return the paper's rule base with one of the surfaces."""
    return InferenceSystem(PAPER_RULES, surface)


def evaluate(surface: Surface, error_percent: float, change_percent: float) -> Inference:
    """Output level of the paper's rules for an error and its change, percent of the desired force.

    Raises ValueError for a NaN.
    """
    return paper_system(surface).evaluate(error_percent, change_percent)


def computed_matrix() -> Table:
    """Table 3 as it follows from Table 2 and the rules."""
    return paper_system(Surface.RULES).computed_table()


def infer(level_error: float, level_change: float) -> float:
    """Centre of gravity that the paper's rules give for two levels within −6…+6, not only whole ones."""
    return paper_system(Surface.CONTINUOUS).infer(level_error + TOP_LEVEL, level_change + TOP_LEVEL)


def quantise(percent: float, edges: tuple[float, ...], levels: tuple[float, ...] = LEVELS) -> float:
    """Level of a percentage. Raises ValueError for a NaN.

    Assumed: a value exactly on an edge belongs to the level nearer zero; the paper's ranges share their
    borders.
    """
    return levels[_index(percent, edges)]


def _index(percent: float, edges: tuple[float, ...]) -> int:
    if math.isnan(percent):
        raise ValueError("cannot quantise a value that is not a number")
    return bisect_left(edges, percent) if percent > 0.0 else bisect_right(edges, percent)


def _position(percent: float, edges: tuple[float, ...]) -> float:
    """Place among the levels: each edge lies half-way between its two levels, straight lines between edges.

    The outermost levels have no outer edge, so their line continues with the slope of their neighbour.
    """
    if math.isnan(percent):
        raise ValueError("cannot grade a value that is not a number")
    segment, last = bisect_right(edges, percent) - 1, len(edges) - 1
    segment = 0 if segment < 0 else segment if segment < last else last - 1
    left, right = edges[segment], edges[segment + 1]
    position = segment + 0.5 + (percent - left) / (right - left)
    return 0.0 if position < 0.0 else position if position <= last + 1 else last + 1.0


def _level_at(position: float, levels: tuple[float, ...]) -> float:
    left, last = int(position), len(levels) - 2
    left = left if left < last else last
    return levels[left] + (position - left) * (levels[left + 1] - levels[left])


def _between_levels(terms: tuple[Term, ...]) -> Terms:
    levels = len(terms[0].degrees)
    return [
        [
            (term.name, low, high)
            for term in terms
            for low, high in [(*term.degrees, 0.0)[left : left + 2]]
            if low > 0.0 or high > 0.0
        ]
        for left in range(levels)
    ]


def _memberships(position: float, terms: Terms) -> list[tuple[str, float]]:
    """Terms that hold to some degree, interpolated between levels."""
    left = int(position)
    share = position - left
    rest, held = 1 - share, []
    for name, low, high in terms[left]:
        if (degree := low * rest + high * share) > 0.0:
            held.append((name, degree))
    return held


def _nearest(value: float, levels: tuple[float, ...]) -> float:
    # Of two equally near, the one nearer zero: opposite inputs then keep opposite outputs.
    return min(levels, key=lambda level: (abs(level - value), abs(level)))
