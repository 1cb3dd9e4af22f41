"""Response figures of signals whose figures are known by hand."""

import cmath
import math

import numpy as np
import pytest

from hil_bridge.control.analysis.response import (
    ForceSignal,
    amplitude_n,
    error_figures,
    phase_deg,
    ramp_lags_s,
    settling_s,
    sine_response,
    slope_per_min,
    step_figures,
    target_steps,
    touch_figures,
)

RATE = 1024
"""Samples per second: a power of two, so that all times are exact."""


def signal(force, target=10.0, rate: int = RATE) -> ForceSignal:
    """Return a signal that begins at 64 s."""
    values = np.asarray(force, dtype=float)
    at = 64.0 + np.arange(values.size) / rate
    return ForceSignal(at, values, np.broadcast_to(np.asarray(target, dtype=float), values.shape))


def seconds(duration: float) -> np.ndarray:
    return np.arange(round(duration * RATE)) / RATE


def test_interval_includes_both_ends():
    part = signal(np.arange(5.0), rate=1).between(65.0, 67.0)
    assert part.force.tolist() == [1.0, 2.0, 3.0]
    assert part.span_s == 2.0


def test_force_settles_after_last_sample_outside_band():
    force = np.full(2048, 10.0)
    force[:512] = 12.5
    force[768] = 8.75  # leaves the band once more
    assert settling_s(signal(force), 1.0) == 769 / RATE
    assert settling_s(signal(force), 1.25) == 512 / RATE  # the bound is in the band
    assert settling_s(signal(force), 2.5) == 0.0
    force[-1] = 12.0
    assert settling_s(signal(force), 1.0) == math.inf


def test_touch_has_peak_impulse_and_errors():
    force = np.array([2.0, 20.0, 20.0, 14.0, 10.0, 10.0, 10.0, 10.0])
    figures = touch_figures(signal(force, rate=4))
    assert figures["touch_peak_n"] == 20.0
    # trapezoids of 0, 10, 10, 4, 0 N above the target, 0.25 s each
    assert figures["touch_impulse_ns"] == 0.25 * (5.0 + 10.0 + 7.0 + 2.0)
    assert figures["touch_error_max_n"] == 10.0
    assert figures["touch_error_mean_n"] == 4.0
    # absolute errors 8, 10, 10, 4 and four times 0; their mean square is 35, their mean 4
    assert figures["touch_error_deviation_n"] == pytest.approx(math.sqrt(35.0 - 16.0))
    assert figures["settle_s"] == 1.0
    assert figures["settle_10n_s"] is None  # the band would include no force at all
    assert touch_figures(signal(force, 15.0, 4))["settle_10n_s"] == 0.25


def test_track_errors_are_of_absolute_error():
    figures = error_figures(signal([9.0, 11.0, 13.0, 10.0]))
    assert figures == {
        "track_error_max_n": 3.0,
        "track_error_mean_n": 1.25,
        "track_error_deviation_n": pytest.approx(math.sqrt(11 / 4 - 1.25**2)),
    }


def stairs(*levels: float, gain: float = 1.0, rise_s: float = 0.0) -> ForceSignal:
    """Return a force that follows steps of the target every 4 s by a share, after a linear rise."""
    target = np.repeat(levels, 4 * RATE)
    force = np.repeat([10.0 + gain * (level - 10.0) for level in levels], 4 * RATE)
    rise = round(rise_s * RATE)
    for begin in range(4 * RATE, force.size, 4 * RATE):
        force[begin : begin + rise] = np.linspace(force[begin - 1], force[begin + rise], rise, endpoint=False)
    return signal(force, target)


def test_step_has_rise_overshoot_settling_and_error():
    figures = step_figures(list(target_steps(stairs(10.0, 20.0, rise_s=1.0))))
    assert figures["step_rise_s"] == pytest.approx(0.8, abs=2 / RATE)
    assert figures["step_settle_s"] == pytest.approx(0.9, abs=2 / RATE)
    assert figures["step_overshoot_percent"] == 0.0
    assert figures["step_error_n"] == 0.0
    assert figures["smallest_step_n"] is None
    high = step_figures(list(target_steps(stairs(10.0, 20.0, 10.0, gain=1.25))))
    assert high["step_overshoot_percent"] == 25.0  # of the step up; the step down ends at its target
    assert high["step_error_n"] == 2.5
    assert high["step_settle_s"] == math.inf


def test_small_steps_do_not_change_step_figures():
    steps = list(target_steps(stairs(10.0, 20.0, 10.0, 11.0, gain=1.25)))
    assert [step.size for step in steps] == [10.0, -10.0, 1.0]
    assert step_figures(steps)["step_error_n"] == 2.5


def test_changes_shorter_than_hold_are_no_steps():
    target = np.repeat([10.0, 20.0, 10.0], [4 * RATE, RATE, 4 * RATE])
    assert list(target_steps(signal(target, target))) == []
    assert step_figures([])["smallest_step_n"] is None


def test_smallest_step_shows_with_all_larger_ones():
    levels = [10.0, *(10.0 + size for size in (0.1, 0.5, 1.0) for size in (size, 0.0, size, 0.0))]
    followed = stairs(*levels)
    assert step_figures(list(target_steps(followed)))["smallest_step_n"] == pytest.approx(0.1)
    hidden = followed.force.copy()
    hidden[np.abs(hidden - 10.0) < 0.3] = 10.0  # the steps of 0.1 N have no effect
    figures = step_figures(list(target_steps(followed._replace(force=hidden))))
    assert figures["smallest_step_n"] == pytest.approx(0.5)
    weak = step_figures(list(target_steps(stairs(*levels, gain=0.4))))
    assert weak["smallest_step_n"] == math.inf


def test_ramp_lag_is_time_shift():
    at = seconds(8.0)
    target = np.clip(10.0 + 4.0 * (at - 2.0), 10.0, 22.0)
    late = np.clip(10.0 + 4.0 * (at - 2.25), 10.0, 22.0)
    assert list(ramp_lags_s(signal(late, target))) == [pytest.approx(0.25)]
    assert list(ramp_lags_s(signal(-late, -target))) == [pytest.approx(0.25)]


def test_step_and_sine_are_no_ramps():
    at = seconds(8.0)
    assert list(ramp_lags_s(stairs(10.0, 20.0))) == []
    assert list(ramp_lags_s(signal(at, 10.0 + 2.0 * np.sin(np.pi * at / 2)))) == []


def test_sine_response_has_gain_and_phase():
    at = seconds(16.0)
    angle = 2.0 * np.pi * at / 2.0
    target = 10.0 + 2.0 * np.sin(angle)
    force = 9.0 + 1.5 * np.sin(angle - np.pi / 3)
    force[: 2 * RATE] = 50.0  # the first period is left out
    ratio = sine_response(signal(force, target))
    assert ratio is not None
    assert abs(ratio) == pytest.approx(0.75, rel=1e-6)
    assert phase_deg(ratio) == pytest.approx(-60.0, abs=1e-3)
    assert amplitude_n(signal(force, target).between(66.0, 80.0), 2.0) == pytest.approx(1.5, rel=1e-3)


def test_phase_beyond_half_turn_stays_a_delay():
    assert phase_deg(cmath.rect(1.0, math.radians(-200.0))) == pytest.approx(-200.0)
    assert phase_deg(cmath.rect(1.0, math.radians(10.0))) == pytest.approx(10.0)


@pytest.mark.parametrize(
    "target",
    [
        10.0 + np.sin(np.pi * seconds(5.0)),  # two periods and a half
        np.full(16 * RATE, 10.0),
        10.0 + np.sin(np.pi * seconds(16.0)) ** 5,
        10.0 + np.sin(np.pi * seconds(16.0) ** 1.5),
    ],
    ids=["too short", "constant", "not a sine", "sweep"],
)
def test_target_without_sine_has_no_response(target):
    assert sine_response(signal(target, target)) is None


def test_sine_with_few_samples_has_no_response():
    at = np.arange(200) / 7.0
    target = 10.0 + np.sin(2 * np.pi * at)
    assert sine_response(signal(target, target, rate=7)) is None


def test_slope_is_per_minute():
    at = seconds(4.0)
    assert slope_per_min(at + 64.0, 3.0 - 0.5 * at) == pytest.approx(-30.0)
