"""Fuzzy inference from the quantised error and change of error to an output level.

The rules are those of the paper or of another rule base. Three surfaces use the same inputs. `paper` looks up the
output in the table that is printed with the rules. `rules` looks it up in a table computed from the rules: AND is
the minimum, implication the minimum, and aggregation the maximum. The output is the centre of gravity over the
output levels, rounded to the nearest level. `continuous` is the limit of ever finer levels that the paper mentions:
memberships are interpolated between levels, and nothing is rounded.
"""

import math
from bisect import bisect_left, bisect_right
from enum import StrEnum
from functools import cache

from msgspec import Struct

from hil_bridge.control.laws.rules import PAPER_RULES, RuleBase, Table, Term
from hil_bridge.control.laws.tables import LEVELS

Terms = list[list[tuple[str, float, float]]]
"""For each level, the terms with a degree above 0 between it and the next level, with their degrees at both levels."""
Strengths = dict[str, float]
"""Degrees of the terms, by name. Terms with degree 0 are omitted."""

TOP_LEVEL = LEVELS[-1]


class Surface(StrEnum):
    """Control surface that computes the output."""

    PAPER = "paper"
    """Table printed with the rules (the paper's Table 3, including its one asymmetric entry); same as `rules` for a
    rule base without a printed table.
    """
    RULES = "rules"
    """Table computed from the rules."""
    CONTINUOUS = "continuous"
    """Rules without quantisation of inputs and output."""


class Inference(Struct, frozen=True):
    """Result of one evaluation of a surface, as levels of the rule base. The levels are integers except on the
    continuous surface.
    """

    level_error: float
    level_change: float
    level_output: float


class InferenceSystem:
    """Rule base with precomputed tables, so that an evaluation takes microseconds."""

    def __init__(self, base: RuleBase, surface: Surface) -> None:
        self.base = base
        self.surface = surface
        self._error_terms = _between_levels(base.error.terms)
        self._change_terms = _between_levels(base.change.terms)
        self._shapes = {
            term.name: [(place, degree) for place, degree in enumerate(term.degrees) if degree > 0.0]
            for term in base.output.terms
        }
        """For each term, the indices of the output levels with a degree above 0, and the degree at each."""
        self._rules: dict[str, dict[str, tuple[str, str]]] = {term.name: {} for term in base.error.terms}
        for rule in base.rules:
            name = f"{rule.error}∧{rule.change}→{rule.output}"
            self._rules[rule.error][rule.change] = name, rule.output
        self._explanations: dict[tuple[int, int], dict[str, float]] = {}
        # Precomputed, because the first use would be within a control cycle.
        self._table: Table | None = None
        if surface == Surface.PAPER and base.printed is not None:
            self._table = base.printed
        elif surface != Surface.CONTINUOUS:
            self._table = self.computed_table()

    def evaluate(self, error_percent: float, change_percent: float) -> Inference:
        """Return the output level for an error and its change, in percent of the desired force. Raises ValueError
        if an input is NaN.
        """
        inference = self.explain(error_percent, change_percent)
        return Inference(inference["level_error"], inference["level_change"], inference["level_output"])

    def explain(self, error_percent: float, change_percent: float) -> dict[str, float]:
        """Return the active rules with their degrees, by names such as `NB∧ZO→PM`, followed by the levels from
        `evaluate`.

        With quantised inputs the rules are evaluated at the two levels, even where a printed table differs.
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
        cached = self._explanations.get((i, j))
        if cached is None:
            levels, rules = (error.levels[i], change.levels[j]), self._fire(i, j)[0]
            cached = self._explanations[i, j] = _explanation(rules, *levels, self._table[i][j])
        return cached.copy()

    def infer(self, row: float, column: float) -> float:
        """Return the centre of gravity over the output levels for two positions among the levels of error and
        change.

        A position is the index of a level, counted from 0, or a value between two indices.
        """
        return self._centre(self._fire(row, column)[1])

    def _centre(self, outputs: Strengths) -> float:
        """Return the output from implication by the minimum, aggregation by the maximum, and centre of gravity."""
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
        """Return the output level from the rules for each level of error (row) and change (column)."""
        columns = range(len(self.base.change.levels))
        levels = self.base.output.levels
        return tuple(
            tuple(_nearest(self.infer(row, column), levels) for column in columns)
            for row in range(len(self.base.error.levels))
        )

    def _fire(self, row: float, column: float) -> tuple[Strengths, Strengths]:
        """Return the active rules, and the output terms, each with the degree of the strongest rule that names it."""
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
    """Return the degrees of the rules and the three levels, by name."""
    return {**rules, "level_error": error, "level_change": change, "level_output": output}


@cache
def paper_system(surface: Surface) -> InferenceSystem:
    """Return the paper's rule base with the given surface."""
    return InferenceSystem(PAPER_RULES, surface)


def evaluate(surface: Surface, error_percent: float, change_percent: float) -> Inference:
    """Return the output level of the paper's rules for an error and its change, in percent of the desired force.

    Raises ValueError if an input is NaN.
    """
    return paper_system(surface).evaluate(error_percent, change_percent)


def computed_matrix() -> Table:
    """Return Table 3 as computed from Table 2 and the rules."""
    return paper_system(Surface.RULES).computed_table()


def infer(level_error: float, level_change: float) -> float:
    """Return the centre of gravity from the paper's rules for two levels within −6…+6, which may be fractional."""
    return paper_system(Surface.CONTINUOUS).infer(level_error + TOP_LEVEL, level_change + TOP_LEVEL)


def quantise(percent: float, edges: tuple[float, ...], levels: tuple[float, ...] = LEVELS) -> float:
    """Return the level of a percentage. Raises ValueError for NaN.

    Assumed: a value exactly on an edge belongs to the level nearer zero, because neighbouring ranges in the paper
    share their edges.
    """
    return levels[_index(percent, edges)]


def _index(percent: float, edges: tuple[float, ...]) -> int:
    if math.isnan(percent):
        raise ValueError("cannot quantise a value that is not a number")
    return bisect_left(edges, percent) if percent > 0.0 else bisect_right(edges, percent)


def _position(percent: float, edges: tuple[float, ...]) -> float:
    """Return the position of a percentage among the levels, interpolated linearly between edges. Each edge is
    half-way between its two levels.

    The outermost levels have no outer edge, so their line continues with the slope of the neighbouring line.
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
    """Return the terms with a degree above 0, interpolated between levels."""
    left = int(position)
    share = position - left
    rest, degrees = 1 - share, []
    for name, low, high in terms[left]:
        if (degree := low * rest + high * share) > 0.0:
            degrees.append((name, degree))
    return degrees


def _nearest(value: float, levels: tuple[float, ...]) -> float:
    # A tie is resolved towards zero, so that opposite inputs give opposite outputs.
    return min(levels, key=lambda level: (abs(level - value), abs(level)))
