"""Tables and inference of the paper."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil_bridge.control import Surface, computed_matrix, evaluate, infer, quantise
from hil_bridge.control.laws.tables import (
    CHANGE_EDGES_PERCENT,
    ERROR_EDGES_PERCENT,
    GAIN_MATRIX,
    LEVELS,
    MEMBERSHIPS,
)

EDGES = st.sampled_from([ERROR_EDGES_PERCENT, CHANGE_EDGES_PERCENT])
PERCENT = st.floats(-1e6, 1e6)
LEVEL = st.integers(-6, 6)


def entry(matrix, error, change):
    return matrix[error + 6][change + 6]


def test_rules_reproduce_printed_matrix_except_one_entry():
    computed = computed_matrix()
    differing = [(e, c) for e in LEVELS for c in LEVELS if entry(computed, e, c) != entry(GAIN_MATRIX, e, c)]
    assert differing == [(6, 0)]
    assert entry(GAIN_MATRIX, 6, 0) == -5
    assert entry(computed, 6, 0) == -4
    assert infer(6, 0) == pytest.approx(-3.90625)


def test_printed_rows_match_the_paper():
    # Table 3, rows +6, 0 and −3 read from the page.
    assert GAIN_MATRIX[12] == (0, 0, -1, -2, -3, -4, -5, -5, -5, -5, -5, -5, -5)
    assert GAIN_MATRIX[6] == (3, 3, 3, 2, 1, 0, 0, 0, -1, -2, -3, -3, -3)
    assert GAIN_MATRIX[3] == (5, 4, 4, 3, 3, 3, 2, 2, 1, 0, -1, -2, -2)


@given(LEVEL, LEVEL)
def test_printed_matrix_is_antisymmetric_except_one_pair(error, change):
    total = entry(GAIN_MATRIX, error, change) + entry(GAIN_MATRIX, -error, -change)
    assert total == (-1 if abs(error) == 6 and change == 0 else 0)


@given(PERCENT, PERCENT, st.sampled_from([Surface.RULES, Surface.CONTINUOUS]))
def test_surfaces_of_the_rules_are_antisymmetric(error, change, surface):
    here, there = evaluate(surface, error, change), evaluate(surface, -error, -change)
    assert here.level_output == pytest.approx(-there.level_output, abs=1e-9)


@pytest.mark.parametrize("surface", Surface)
def test_surfaces_do_not_push_at_zero_or_large_error(surface):
    assert evaluate(surface, 0.0, 0.0).level_output == pytest.approx(0.0, abs=1e-12)
    assert evaluate(surface, 100.0, 0.0).level_output < -3
    assert evaluate(surface, -100.0, 0.0).level_output > 3


@given(EDGES, PERCENT, PERCENT)
def test_quantiser_is_monotone_and_odd(edges, a, b):
    low, high = sorted((a, b))
    assert -6 <= quantise(low, edges) <= quantise(high, edges) <= 6
    assert quantise(-a, edges) == -quantise(a, edges)


@pytest.mark.parametrize(
    ("percent", "level"),
    [
        (0.0, 0),
        (1.0, 0),
        (-1.0, 0),
        (1.0001, 1),
        (5.0, 1),
        (21.0, 2),
        (-21.0, -2),
        (-21.1, -3),
        (51.0, 5),
        (51.1, 6),
    ],
)
def test_quantise_edge_belongs_to_level_nearer_zero(percent, level):
    assert quantise(percent, ERROR_EDGES_PERCENT) == level


def test_quantise_infinity_saturates_and_nan_raises():
    assert quantise(math.inf, ERROR_EDGES_PERCENT) == 6
    assert quantise(-math.inf, CHANGE_EDGES_PERCENT) == -6
    with pytest.raises(ValueError, match="not a number"):
        quantise(math.nan, ERROR_EDGES_PERCENT)
    with pytest.raises(ValueError, match="not a number"):
        evaluate(Surface.CONTINUOUS, math.nan, 0.0)


@given(PERCENT, PERCENT)
def test_continuous_level_is_near_quantised_level(a, b):
    low, high = (evaluate(Surface.CONTINUOUS, percent, percent) for percent in sorted((a, b)))
    assert low.level_error <= high.level_error + 1e-9
    assert low.level_change <= high.level_change + 1e-9
    assert abs(low.level_error - quantise(min(a, b), ERROR_EDGES_PERCENT)) <= 0.5 + 1e-9
    assert abs(low.level_change - quantise(min(a, b), CHANGE_EDGES_PERCENT)) <= 0.5 + 1e-9


@given(st.floats(-6, 6), st.floats(-6, 6))
def test_inference_stays_within_the_levels_and_is_continuous(error, change):
    here = infer(error, change)
    assert -6 <= here <= 6
    near = infer(min(error + 1e-7, 6.0), change)
    assert near == pytest.approx(here, abs=1e-4)


def test_memberships_cover_levels_and_are_symmetric():
    assert all(any(shape[i] for shape in MEMBERSHIPS.values()) for i in range(13))
    for left, right in (("NB", "PB"), ("NM", "PM"), ("NS", "PS"), ("ZO", "ZO")):
        assert MEMBERSHIPS[left] == MEMBERSHIPS[right][::-1]
