"""Figures of signals with known values."""

import math

import numpy as np
import pytest

from hil_bridge.lab.fidelity import measures
from hil_bridge.lab.fidelity.measures import Floats

TIMES = np.arange(2000) / 250.0
RANDOM = np.random.default_rng(7)


def wave(times: Floats) -> Floats:
    """Return the sum of two slow sines: an input that is never constant."""
    return 0.3 * np.sin(2.0 * times) + 0.1 * np.sin(7.0 * times)


@pytest.mark.parametrize("lag", [-0.0053, 0.0, 0.0137, 0.1743])
def test_lag_is_accurate_to_10_microseconds(lag: float) -> None:
    result = measures.shift_of(TIMES, wave(TIMES), wave(TIMES - lag))
    assert result.seconds == pytest.approx(lag, abs=2e-5)
    assert result.spread < 1e-4
    assert measures.rms(result.rest) < 1e-5


def test_lag_and_noise_are_separated() -> None:
    noise = RANDOM.normal(0.0, 1e-3, len(TIMES))
    result = measures.shift_of(TIMES, wave(TIMES), wave(TIMES - 0.02) + noise)
    assert result.seconds == pytest.approx(0.02, abs=3e-4)
    assert measures.noise_of(result.rest) == pytest.approx(1e-3, rel=0.05)
    assert measures.rms(result.rest) == pytest.approx(1e-3, rel=0.05)


def test_offset_at_constant_speed_counts_as_lag() -> None:
    late = 2.0 * (TIMES - 0.06)
    assert measures.shift_of(TIMES, 2.0 * TIMES, late).seconds == pytest.approx(0.06, abs=1e-4)
    assert measures.rms(measures.shift_of(TIMES, 2.0 * TIMES, late, free=1).rest) < 1e-9


@pytest.mark.parametrize(
    "source", [np.full(len(TIMES), 1.3), 1.3 + 1e-14 * np.sin(TIMES), np.zeros(len(TIMES))]
)
def test_constant_input_yields_no_lag(source: Floats) -> None:
    result = measures.shift_of(TIMES, source, RANDOM.normal(1.3, 1e-3, len(TIMES)))
    assert math.isnan(result.seconds)


def test_unrelated_output_yields_no_lag() -> None:
    assert math.isnan(measures.shift_of(TIMES, wave(TIMES), np.cos(50.0 * TIMES)).seconds)


def test_noise_of_slow_signal_is_white_noise() -> None:
    values = wave(TIMES) + RANDOM.normal(0.0, 0.02, len(TIMES))
    assert measures.noise_of(values) == pytest.approx(0.02, rel=0.05)


def test_share_below_frequency_is_slow_variance() -> None:
    slow, fast = np.sin(2 * math.pi * 3.0 * TIMES), 0.5 * np.sin(2 * math.pi * 60.0 * TIMES)
    assert measures.share_below(TIMES, slow + fast, 20.0) == pytest.approx(0.8, abs=0.01)
    assert math.isnan(measures.share_below(TIMES, slow, 200.0)), "above half the rate"
    assert math.isnan(measures.share_below(TIMES, np.zeros(len(TIMES)), 20.0))


STEP = 2.0 * math.pi / 2**19


@pytest.mark.parametrize(
    "values",
    [
        1.37 + 1.5 * STEP * RANDOM.normal(size=2000),
        1.37 + 20.0 * STEP * np.sin(TIMES) + 1.5 * STEP * RANDOM.normal(size=2000),
    ],
)
def test_grid_is_found_despite_float32_rounding(values: Floats) -> None:
    on_grid = (np.round(values / STEP) * STEP).astype(np.float32).astype(np.float64)
    assert measures.grid_of(on_grid) == pytest.approx(STEP, rel=0.02)
    assert math.isnan(measures.grid_of(values)), "values without a grid"


def test_only_rounded_ramp_has_grid() -> None:
    assert math.isnan(measures.grid_of(0.01 * TIMES))
    assert measures.grid_of(np.round(0.01 * TIMES, 3)) == pytest.approx(1e-3, rel=1e-6)


def test_sample_intervals_have_statistics() -> None:
    times = np.cumsum(np.array([0.0] + [0.002] * 98 + [0.010]))
    result = measures.gaps_of(times)
    assert result.mean_s == pytest.approx(0.206 / 99)
    assert result.longest_s == pytest.approx(0.010)
    assert result.deviation_s == pytest.approx(math.sqrt(98) / 99 * 0.008)


def test_integral_of_speeds_is_distance() -> None:
    distance = measures.integral_of(TIMES, np.cos(TIMES))
    assert distance == pytest.approx(np.sin(TIMES), abs=1e-5)
