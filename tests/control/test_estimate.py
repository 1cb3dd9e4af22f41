"""The stiffness estimator and its gates."""

import math

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from hil_bridge.control import Gates, StiffnessEstimate
from hil_bridge.control.laws.estimate import contact_lost, update

STEP = 0.125e-3
GATES = Gates(position_change=STEP / 2, force_change=1.0)


def feed(samples, gates=GATES, estimate=None):
    estimate = estimate or StiffnessEstimate()
    for position, force in samples:
        estimate = update(estimate, gates, position, force)
    return estimate


def test_one_good_pair_gives_the_quotient():
    assert feed([(0.0, 0.0), (1e-3, 5.0)]).stiffness == pytest.approx(5000)


@pytest.mark.parametrize(
    "second",
    [(0.4 * STEP, 5.0), (STEP, 0.9), (0.0, 40.0), (STEP, -5.0), (0.1, 2.0), (STEP, 2e3)],
    ids=["moved too little", "pressed too little", "not moved", "negative", "below 1e2", "above 1e7"],
)
def test_pair_outside_a_gate_does_not_count(second):
    assert feed([(0.0, 0.0), second]).stiffness is None


def test_pair_at_the_gates_counts():
    assert feed([(0.0, 0.0), (STEP / 2, 1.0)]).stiffness == pytest.approx(1.0 / (STEP / 2))


@pytest.mark.parametrize("bad", [(math.nan, 1.0), (1e-3, math.nan), (math.inf, 1.0), (1e-3, -math.inf)])
def test_sample_that_is_not_finite_changes_nothing(bad):
    estimate = feed([(0.0, 0.0), (1e-3, 5.0)])
    assert update(estimate, GATES, *bad) is estimate


def test_large_change_of_force_outweighs_a_small_one():
    start = [(0.0, 0.0), (1e-3, 5.0)]
    small = feed([*start, (1e-3 + STEP, 5.0 + 1.25)]).stiffness
    large = feed([*start, (2e-3, 5.0 + 20.0)]).stiffness
    assert 5000 < small < 6000 < large < 20000
    assert large == pytest.approx(5000 ** (1 / 17) * 20000 ** (16 / 17))


def test_small_moves_add_up_only_before_first_estimate():
    creeping = [(i * STEP, i * 0.4) for i in range(4)]
    assert feed(creeping).stiffness == pytest.approx(0.4 / STEP)
    known = feed([(0.0, 0.0), (1e-3, 5.0)])
    assert (
        feed([(1e-3 + i * STEP, 5.0 + i * 0.4) for i in range(9)], estimate=known).stiffness
        == known.stiffness
    )


def test_small_moves_add_up_for_limited_time():
    # A surface that yields: a long move with hardly any force gives no stiffness.
    assert feed([(i * STEP, i * 0.1) for i in range(100)]).stiffness is None


def test_contact_loss_keeps_estimate_and_restarts_pair():
    estimate = contact_lost(feed([(0.0, 0.0), (1e-3, 5.0)]))
    assert feed([(5e-3, 6.5)], estimate=estimate).stiffness == pytest.approx(5000)


@given(st.lists(st.tuples(st.floats(), st.floats()), max_size=20))
@example([(0.0, 0.0), (1e300, 1e304), (0.0, 0.0)])
def test_estimate_stays_within_stiffness_range(samples):
    stiffness = feed(samples).stiffness
    assert stiffness is None or GATES.stiffness_min * (1 - 1e-9) <= stiffness <= GATES.stiffness_max * (
        1 + 1e-9
    )


@given(st.floats(1e3, 1e6), st.lists(st.integers(-20, 20), min_size=2, max_size=30))
def test_estimate_of_noiseless_wall_is_exact(stiffness, steps):
    estimate = feed([(n * STEP, n * STEP * stiffness) for n in steps])
    assert estimate.stiffness is None or estimate.stiffness == pytest.approx(stiffness)
