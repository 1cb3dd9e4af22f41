"""Stiffness by least squares over aligned force–position pairs."""

import math
from dataclasses import replace
from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil_bridge.control import Measurement, Pairing, Stiffness
from hil_bridge.control.laws.stiffness import observe

STEP = 0.125e-3
PAIRING = Pairing()


def pair(position, force, travel=0.0, **more):
    return Measurement(0.0, 99.0, position, position, paired_force=force, travel=travel, **more)


def feed(pairs, estimate=None, **how):
    estimate = estimate or Stiffness()
    for one in pairs:
        estimate = observe(estimate, PAIRING, one, **how)
    return estimate


def known():
    return feed([pair(0.0, 0.0), pair(2e-3, 10.0)])


def test_noiseless_wall_estimate_has_little_bias():
    estimate = known()
    assert estimate.value == pytest.approx(5000.0, rel=0.01)
    assert estimate.relative_error(PAIRING) < 0.05


def test_stiffness_uses_paired_force():
    assert feed([pair(0.0, 0.0), pair(2e-3, 10.0)]).value == known().value
    newest = [Measurement(0.0, force, x, x) for x, force in ((0.0, 0.0), (2e-3, 20.0))]
    assert feed(newest).value == pytest.approx(2 * known().value)


@pytest.mark.parametrize("stiffness", [500.0, 5e3, 1e5])
def test_quantised_positions_stay_within_error(stiffness):
    for seed in range(20):
        random, estimate = Random(seed), Stiffness()
        for _ in range(12):
            true = random.uniform(0.0, 2e-3)
            force = stiffness * true + random.gauss(0.0, 0.05)
            estimate = observe(estimate, PAIRING, pair(round(true / STEP) * STEP, force))
        error = abs(estimate.value / stiffness - 1)
        assert error < max(4 * estimate.relative_error(PAIRING), 0.1)


def test_stiffness_subtracts_slope_of_travel():
    def rising(stiffness, slope):
        random = Random(1)
        for k in range(40):
            depth = slope * k * 1e-3 + random.choice((1e-3, 1.5e-3, 2e-3))
            yield pair(depth, stiffness * (depth - slope * k * 1e-3), k * 1e-3)

    for slope in (-0.3, 0.3):
        assert feed(rising(5e3, slope), slope=slope).value == pytest.approx(5e3, rel=0.05)
        # Without a configured slope, it is learnt.
        assert feed(rising(5e3, slope)).value == pytest.approx(5e3, rel=0.2)


@pytest.mark.parametrize(
    "spoilt",
    [
        pair(math.nan, 20.0),
        pair(4e-3, math.nan),
        pair(4e-3, math.inf),
        pair(4e-3, 50.0, saturated=True),
        pair(4e-3, 50.0, travel=math.nan),
    ],
    ids=["no position", "no force", "infinite force", "saturated", "no travel"],
)
def test_invalid_measurement_keeps_stiffness(spoilt):
    estimate = known()
    assert observe(estimate, PAIRING, spoilt) is estimate


def test_small_moves_do_not_change_stiffness():
    estimate = known()
    for force in (10.2, 9.8, 10.3):
        estimate = observe(estimate, PAIRING, pair(2e-3, force))
        estimate = observe(estimate, PAIRING, pair(2e-3 + STEP, force))
    assert estimate.value == known().value
    assert feed([pair(0.0, 3.0), pair(0.0, 40.0)]).value is None


@pytest.mark.parametrize("force", [-10.0, 0.05, 5e3])
def test_implausible_quotient_is_ignored(force):
    assert feed([pair(0.0, 0.0), pair(2e-3, force)]).value is None


def test_contact_loss_keeps_stiffness_and_restarts_pair():
    lost = observe(known(), PAIRING, pair(0.0, 0.0, in_contact=False))
    assert lost.value == known().value
    assert observe(lost, PAIRING, pair(9e-3, 9.0)).value == known().value


def test_stiffness_adapts_to_new_material():
    estimate = feed([pair(k % 2 * 1e-3, 5.0 * (k % 2)) for k in range(10)])
    assert estimate.value == pytest.approx(5e3, rel=0.02)
    estimate = feed([pair(k % 2 * 1e-3, 20.0 * (k % 2)) for k in range(20)], estimate)
    assert estimate.value == pytest.approx(2e4, rel=0.05)


def test_stiffness_without_pairs_has_infinite_error():
    assert Stiffness().relative_error(PAIRING) == math.inf


@given(st.lists(st.tuples(st.floats(-1, 1), st.floats(-1e4, 1e4), st.floats(-1, 1)), max_size=20))
def test_stiffness_stays_within_plausible_range(samples):
    value = feed(pair(x, f, t) for x, f, t in samples).value
    # The bias removed from a single pair is at most half of it.
    assert value is None or PAIRING.stiffness_min * 0.99 <= value <= PAIRING.stiffness_max * 2.01


@pytest.mark.parametrize(
    "wrong",
    [{"forgetting": 1.1}, {"resolution_mm": 0.0}, {"stiffness_min": 1e7}, {"force_uncertainty_n": math.nan}],
)
def test_pairing_invalid_settings_are_refused(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        replace(PAIRING, **wrong)
