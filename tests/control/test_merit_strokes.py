"""Figures of merit of varying forces and of several strokes, on arrays with known figures."""

import numpy as np
import pytest

from hil_bridge.control import ForceTrace, figures_of_merit


def test_figures_use_desired_force_of_each_sample():
    expected = np.linspace(5.0, 15.0, 101)
    merit = figures_of_merit(
        ForceTrace(np.arange(101) * 0.1, expected + 0.1, expected, np.zeros(101), np.ones(101, bool))
    )
    assert merit.steady_peak_to_peak_n == pytest.approx(0.0, abs=1e-12)
    assert merit.steady_mean_error_n == pytest.approx(0.1)
    assert merit.rms_error_n == pytest.approx(0.1)
    assert merit.overshoot_percent == pytest.approx(2.0)  # 0.1 N of the 5 N desired first
    assert merit.rise_samples == 0


def test_falling_desired_force_is_not_overshoot():
    expected = np.array([20.0] * 5 + [10.0] * 5)
    force = np.array([20.0] * 5 + [19.0, 14.0, 10.5, 10.7, 10.0])
    merit = figures_of_merit(ForceTrace(np.arange(10), force, expected, np.zeros(10), np.ones(10, bool)))
    assert merit.overshoot_percent == pytest.approx(7.0)
    assert merit.rms_error_n == pytest.approx(np.sqrt((81 + 16 + 0.25 + 0.49) / 10))


def test_force_above_dropped_target_is_not_counted():
    expected, force = np.array([20.0, 10.0, 10.0]), np.array([21.0, 20.0, 15.0])
    merit = figures_of_merit(ForceTrace(np.arange(3), force, expected, np.zeros(3), np.ones(3, bool)))
    assert merit.overshoot_percent == pytest.approx(5.0)
    assert merit.largest_force_n == 21.0


def test_hard_touch_is_an_overshoot():
    merit = figures_of_merit(
        ForceTrace(np.arange(3), [15.0, 12.0, 10.0], 10.0, np.zeros(3), np.ones(3, bool))
    )
    assert merit.overshoot_percent == pytest.approx(50.0)
