"""Fuzzy inference of the paper: quantised error and change of error to an output level.

Three surfaces over the same inputs. `paper` looks the answer up in the printed Table 3. `rules` looks it
up in a matrix computed from the recovered rules: AND is the minimum, implication the minimum, aggregation
the maximum, the answer the centre of gravity over the levels −6 to +6, rounded to the nearest level.
`continuous` is the limit of ever finer levels that the paper mentions: memberships interpolated between
levels, nothing rounded.
"""

import math
from bisect import bisect_left, bisect_right
from dataclasses import dataclass
from enum import StrEnum
from functools import cache

from hil_bridge.control.tables import (
    CHANGE_EDGES_PERCENT,
    ERROR_EDGES_PERCENT,
    GAIN_MATRIX,
    LEVELS,
    MEMBERSHIPS,
    RULES,
)

Matrix = tuple[tuple[int, ...], ...]

TOP_LEVEL = LEVELS[-1]


class Surface(StrEnum):
    """Which control surface answers."""

    PAPER = "paper"
    """Table 3 as printed, its one asymmetric entry included."""
    RULES = "rules"
    """Table 3 as the recovered rules give it."""
    CONTINUOUS = "continuous"
    """The rules without quantisation of inputs and output."""


@dataclass(frozen=True, slots=True)
class Inference:
    """One evaluation of a surface; whole numbers but on the continuous surface."""

    level_error: float
    level_change: float
    level_output: float


def quantise(percent: float, edges: tuple[float, ...]) -> int:
    """Level −6…+6 of a percentage. Raises ValueError for a NaN.

    Assumed: a value exactly on an edge belongs to the level nearer zero; the paper's ranges share their
    borders.
    """
    if math.isnan(percent):
        raise ValueError("cannot quantise a value that is not a number")
    below = bisect_left(edges, percent) if percent > 0 else bisect_right(edges, percent)
    return below - TOP_LEVEL


def interpolate_level(percent: float, edges: tuple[float, ...]) -> float:
    """Real-valued level −6…+6: each edge lies half-way between its two levels, straight lines between edges.

    The outermost levels have no outer edge, so their line goes on with the slope of their neighbour.
    Raises ValueError for a NaN.
    """
    if math.isnan(percent):
        raise ValueError("cannot grade a value that is not a number")
    segment = min(max(bisect_right(edges, percent) - 1, 0), len(edges) - 2)
    left, right = edges[segment], edges[segment + 1]
    level = LEVELS[segment] + 0.5 + (percent - left) / (right - left)
    return min(max(level, float(-TOP_LEVEL)), float(TOP_LEVEL))


def infer(level_error: float, level_change: float) -> float:
    """Centre of gravity that the rules give for two levels within −6…+6, which need not be whole numbers."""
    strengths: dict[str, float] = {}
    changes = [(_VALUES.index(value), degree) for value, degree in _memberships(level_change)]
    for value, error_degree in _memberships(level_error):
        row = RULES[value]
        for column, change_degree in changes:
            strength = min(error_degree, change_degree)
            strengths[row[column]] = max(strength, strengths.get(row[column], 0.0))
    moment = area = 0.0
    shapes = [(strength, MEMBERSHIPS[value]) for value, strength in strengths.items()]
    for index, level in enumerate(LEVELS):
        height = max(min(strength, shape[index]) for strength, shape in shapes)
        moment += height * level
        area += height
    return moment / area


@cache
def computed_matrix() -> Matrix:
    """Table 3 as it follows from Table 2 and the rules."""
    return tuple(tuple(round(infer(error, change)) for change in LEVELS) for error in LEVELS)


def evaluate(surface: Surface, error_percent: float, change_percent: float) -> Inference:
    """Output level for an error and its change, percent of the desired force. Raises ValueError for a NaN."""
    if surface == Surface.CONTINUOUS:
        graded_error = interpolate_level(error_percent, ERROR_EDGES_PERCENT)
        graded_change = interpolate_level(change_percent, CHANGE_EDGES_PERCENT)
        return Inference(graded_error, graded_change, infer(graded_error, graded_change))
    matrix = GAIN_MATRIX if surface == Surface.PAPER else computed_matrix()
    error = quantise(error_percent, ERROR_EDGES_PERCENT)
    change = quantise(change_percent, CHANGE_EDGES_PERCENT)
    return Inference(error, change, matrix[error + TOP_LEVEL][change + TOP_LEVEL])


_VALUES = tuple(MEMBERSHIPS)


def _memberships(level: float) -> list[tuple[str, float]]:
    """Linguistic values that hold to some degree at a level, interpolated between the columns of Table 2."""
    left = min(math.floor(level), TOP_LEVEL - 1)
    index, share = left + TOP_LEVEL, level - left
    degrees = (
        (value, shape[index] * (1 - share) + shape[index + 1] * share) for value, shape in MEMBERSHIPS.items()
    )
    return [(value, degree) for value, degree in degrees if degree > 0.0]
