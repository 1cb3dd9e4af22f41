"""PI and admittance control, with and without scheduling."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.linalg import expm

from hil_bridge.control import Admittance, Measurement, Pi
from hil_bridge.control.exponential import exponential

SCHEDULED = {"gain_scheduling": True}


def sample(force, time=0.0, position=0.0, commanded=0.0):
    return Measurement(time, force, position, commanded)


def learnt(controller, stiffness, force=10.0):
    """State after a pair with this stiffness, at the desired force."""
    state, _ = controller.step(controller.initial(), sample(force - stiffness * 2e-3), force)
    state, _ = controller.step(state, sample(force, 0.18, 2e-3, 2e-3), force)
    return state


def test_pi_adds_shares_of_the_error_and_of_its_change():
    controller = Pi(proportional=0.1, integral=0.3, tuned_at_n_m=5e3)
    state, first = controller.step(controller.initial(), sample(4.0), 10.0)
    assert first.correction == pytest.approx(0.3 * 6.0 / 5e3)
    _, second = controller.step(state, sample(8.0, commanded=1e-3), 10.0)
    assert second.correction == pytest.approx((0.3 * 2.0 - 0.1 * 4.0) / 5e3)
    assert second.position == pytest.approx(1e-3 + second.correction)


def test_admittance_is_the_exact_answer_of_mass_and_damper():
    controller = Admittance(mass_kg=100.0, damping_ns_m=1000.0, cycle_ms=200.0)
    state, first = controller.step(controller.initial(), sample(4.0, 7.0), 10.0)
    decay = math.exp(-1000.0 / 100.0 * 0.2)
    assert state.velocity == pytest.approx(6e-3 * (1 - decay))
    assert first.correction == pytest.approx(6e-3 * (0.2 - 0.1 * (1 - decay)))
    # The second cycle is as long as it was measured.
    _, second = controller.step(state, sample(10.0, 7.5, commanded=first.position), 10.0)
    assert second.correction == pytest.approx(state.velocity * 0.1 * (1 - math.exp(-5.0)))


def test_admittance_with_spring_has_steady_error():
    controller = Admittance(spring_n_m=5e3)
    state, commanded = controller.initial(), 0.0
    for k in range(200):
        state, command = controller.step(state, sample(5e3 * commanded, k * 0.18, 0.0, commanded), 10.0)
        commanded = command.position
    assert 5e3 * commanded == pytest.approx(5.0, rel=1e-3)


def test_admittance_clamped_body_does_not_wind_up():
    controller = Admittance(correction_limit_mm=0.1)
    state, command = controller.step(controller.initial(), sample(0.0), 10.0)
    assert command.correction == pytest.approx(0.1e-3)
    assert state.velocity == 0.0


@pytest.mark.parametrize("kind", [Pi, Admittance])
def test_gain_scheduling_scales_by_stiffness(kind):
    plain, scheduled = kind(), kind(**SCHEDULED)
    before = [c.step(c.initial(), sample(4.0), 10.0)[1] for c in (plain, scheduled)]
    assert before[1].correction == pytest.approx(before[0].correction * 5e3 / 1e5)
    for stiffness in (1e3, 2e4):
        answers = []
        for controller in (plain, scheduled):
            state = learnt(controller, stiffness)
            _, command = controller.step(state, sample(9.0, 0.36, 2e-3, 2e-3), 10.0)
            answers.append(command)
        assert answers[0].gain == 1.0
        assert answers[1].gain == pytest.approx(5e3 / stiffness, rel=0.02)
        assert answers[1].stiffness == pytest.approx(stiffness, rel=0.02)


@pytest.mark.parametrize("kind", [Pi, Admittance])
def test_linear_needs_scheduling_at_other_stiffness(kind, wall):
    for seed in range(5):
        plain, scheduled = wall(kind(), 1e5, seed).merit, wall(kind(**SCHEDULED), 1e5, seed).merit
        assert plain.overshoot_percent > 100
        assert scheduled.overshoot_percent < 15
        assert abs(scheduled.steady_mean_error_n) < 1e5 * 0.125e-3
        slow, quick = wall(kind(), 1e3, seed).merit, wall(kind(**SCHEDULED), 1e3, seed).merit
        assert quick.rise_samples < slow.rise_samples


@pytest.mark.parametrize(
    ("kind", "wrong"),
    [
        (Pi, {"integral": 0.0}),
        (Pi, {"proportional": -0.1}),
        (Pi, {"resolution_mm": 0.0}),
        (Admittance, {"mass_kg": 0.0}),
        (Admittance, {"spring_n_m": -1.0}),
        (Admittance, {"force_uncertainty_n": math.inf}),
    ],
)
def test_linear_invalid_parameters_are_refused(kind, wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        kind(**wrong)


@given(
    st.integers(2, 4).flatmap(
        lambda n: st.lists(st.floats(-50.0, 50.0), min_size=n * n, max_size=n * n).map(
            lambda values: np.array(values).reshape(n, n)
        )
    )
)
def test_exponential_matches_scipy(matrix: NDArray[np.float64]) -> None:
    expected = expm(matrix)
    assert np.allclose(exponential(matrix), expected, rtol=1e-9, atol=1e-11 * np.abs(expected).max())
