"""Oscillation detector: what it must detect, and what it must ignore."""

import math
import random

import pytest

from hil_bridge.control.course.oscillation import Finding, OscillationDetector

DETECTOR = OscillationDetector()


def watch(errors, stiffness=None, detector=DETECTOR, dt=0.18):
    state, advices = detector.initial(), []
    for error in errors:
        state, advice = detector.step(state, error, stiffness, dt)
        advices.append(advice)
    return advices


def findings(errors, stiffness=None, detector=DETECTOR):
    return {advice.finding for advice in watch(errors, stiffness, detector)}


def swing(samples, amplitude, period, decay=1.0):
    return [amplitude * decay**k * math.sin(2 * math.pi * (k + 0.3) / period) for k in range(samples)]


@pytest.mark.parametrize("period", [2.3, 4, 7.5, 12])
def test_oscillation_is_measured_within_window(period):
    advices = watch(swing(45, 10.0, period))
    first = next(a for a in advices if a.finding is Finding.OSCILLATING)
    assert first.factor == 0.5
    assert first.amplitude == pytest.approx(10.0, rel=0.35)  # samples miss the crest of a fast one
    assert first.period == pytest.approx(period * 0.18, rel=0.25)


def test_lasting_oscillation_lowers_gain_then_retracts():
    advices = watch(swing(400, 10.0, 6))
    factors = [a.factor for a in advices if a.finding is Finding.OSCILLATING]
    assert factors == [0.5, 0.25, 0.125]
    first = next(k for k, a in enumerate(advices) if a.finding is Finding.PERSISTING)
    assert all(a.retract for a in advices[first:])
    assert not any(a.retract for a in advices[:first])
    assert min(a.factor for a in advices) == 0.125


def test_gain_is_restored_after_calm():
    advices = watch(swing(25, 10.0, 6) + [0.1] * 200)
    lowered = next(k for k, a in enumerate(advices) if a.finding is Finding.OSCILLATING)
    assert [a.factor for a in advices[lowered : lowered + 40]] == [0.5] * 40, "until then it stays lowered"
    assert min(a.factor for a in advices) == 0.5
    assert advices[-1].factor == 1.0
    assert not advices[-1].retract


@pytest.mark.parametrize("seed", range(20))
def test_noise_within_band_is_not_an_oscillation(seed):
    noise = random.Random(seed)
    assert findings([noise.uniform(-0.5, 0.5) for _ in range(2000)]) == {Finding.CALM}


@pytest.mark.parametrize("stiffness", [5e3, 5e4, 2e5])
def test_one_step_oscillation_is_ignored(stiffness):
    step = stiffness * 0.125e-3
    noise = random.Random(1)
    errors = [step * (0.5 if k // 2 % 2 else -0.5) + noise.uniform(-0.5, 0.5) for k in range(400)]
    assert findings(errors, stiffness) == {Finding.CALM}


@pytest.mark.parametrize("stiffness", [2e4, 1e5])
def test_five_step_limit_cycle_is_detected(stiffness):
    step = stiffness * 0.125e-3
    errors = [step * (2.5 if k // 2 % 2 else -2.5) for k in range(60)]
    assert Finding.OSCILLATING in findings(errors, stiffness)


@pytest.mark.parametrize("seed", range(10))
def test_settling_steps_are_not_an_oscillation(seed):
    noise = random.Random(seed)
    errors = []
    for jump in (-50.0, 30.0, -20.0):
        errors += [jump * 0.6**k * math.cos(k * 1.2) + noise.uniform(-0.5, 0.5) for k in range(40)]
    assert findings(errors) == {Finding.CALM}


def test_ramps_and_slow_waves_are_not_an_oscillation():
    noise = random.Random(3)
    ramp = [-20.0 + 0.4 * k + noise.uniform(-0.5, 0.5) for k in range(100)]
    contour = [5.0 * math.sin(2 * math.pi * k / 100) + noise.uniform(-0.5, 0.5) for k in range(1000)]
    assert findings(ramp) == {Finding.CALM}
    assert findings(contour) == {Finding.CALM}


def test_slow_large_variation_is_not_an_oscillation():
    """Six peaks in 9.9 s, where the window is 7.3 s."""
    assert findings([30.0 if k // 11 % 2 == 0 else -30.0 for k in range(400)]) == {Finding.CALM}
    assert Finding.OSCILLATING in findings([30.0 if k // 6 % 2 == 0 else -30.0 for k in range(400)])


def test_oscillation_nan_error_is_skipped():
    errors = swing(60, 10.0, 6)
    holes = [value for error in errors for value in (error, math.nan)]
    plain = [a for a in watch(errors) if a.finding is not Finding.CALM]
    assert [a for a in watch(holes) if a.finding is not Finding.CALM] == plain


@pytest.mark.parametrize(
    "wrong",
    [
        {"peaks": 3},
        {"window_ms": 0.0},
        {"notch": 1.0},
        {"factor_min": 0.0},
        {"decay": 1.5},
        {"force_uncertainty_n": -1.0},
        {"resolution_mm": math.nan},
    ],
)
def test_oscillation_invalid_parameters_are_refused(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        OscillationDetector(**wrong)
