"""Figures of merit on arrays with known figures."""

import numpy as np
import pytest

from hil_bridge.control import ForceTrace, figures_of_merit


def figures(force, commanded=None, contact=None, period=0.5, reference=10.0):
    n = len(force)
    trace = ForceTrace(
        np.arange(n) * period + 77.0,
        force,
        reference,
        np.zeros(n) if commanded is None else commanded,
        np.ones(n, bool) if contact is None else contact,
    )
    return figures_of_merit(trace)


def test_figures_of_known_step_response():
    force = [0.0, 5.0, 9.0, 12.0] + [10.0, 11.0] * 30
    merit = figures(force, commanded=np.arange(64) * 0.125e-3)
    assert (merit.rise_samples, merit.rise_s) == (2, 1.0)
    assert merit.overshoot_percent == pytest.approx(20.0)
    assert merit.steady_mean_error_n == pytest.approx(0.5)
    assert merit.steady_peak_to_peak_n == pytest.approx(1.0)
    assert merit.rms_error_n == pytest.approx(np.sqrt((100 + 25 + 1 + 4 + 30) / 64))
    assert merit.steps_per_s == pytest.approx(2.0)
    assert merit.largest_force_n == 12.0


def test_figures_of_short_or_weak_run_are_none():
    merit = figures([1.0, 2.0])
    assert merit.rise_samples is merit.rise_s is merit.steady_mean_error_n is None
    assert merit.steady_peak_to_peak_n is merit.steps_per_s is None
    assert merit.overshoot_percent == 0.0


def test_contact_losses_are_falling_edges():
    assert figures([1.0] * 6, contact=[False, True, False, False, True, False]).contact_losses == 2


def test_reference_may_change_in_time():
    assert figures([5.0, 10.0], reference=[5.0, 10.0]).rms_error_n == 0.0


def test_figures_of_empty_or_unequal_arrays_raise():
    with pytest.raises(ValueError, match="at least one sample"):
        figures([])
    with pytest.raises(ValueError, match="at least one sample"):
        figures([1.0], commanded=[0.0, 0.0])
