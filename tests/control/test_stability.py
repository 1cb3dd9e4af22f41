"""Margins of textbook loops, and the limit cycle of the quantised loop against its simulation."""

import math

import numpy as np
import pytest

from hil_bridge.control import Admittance, Measurement, Pi
from hil_bridge.control.analysis.stability import (
    HoldingServo,
    Quantiser,
    SampledPlant,
    admittance_response,
    holding_limit_cycle,
    limit_cycle,
    loop_phase_deg,
    margins,
    pi_response,
)

STEP = 0.125e-3
FAST = 1e5
"""Bandwidth of a servo that settles within a sample, rad/s."""


def ideal(dead_samples: float = 0.5, period: float = 0.1) -> SampledPlant:
    return SampledPlant(period, dead_samples * period, FAST)


def simulate(stiffness, integral, plant, offset=0.5, samples=2000, quantise=True, kick=0.0):
    """Return force samples of an integral controller with quantised commands; the target lies between two steps."""
    taps = plant.taps()
    target = stiffness * STEP * (40 + offset)
    commands = [40.3 * STEP + kick] * (len(taps) + 1)
    forces = []
    for _ in range(samples):
        # No command acts at once, so the first tap is 0.
        rounded = [round(x / STEP) * STEP if quantise else x for x in reversed(commands[1 - len(taps) :])]
        force = stiffness * float(np.dot(taps[1:], rounded))
        forces.append(force)
        commands.append(commands[-1] - integral * (force - target))
    return np.array(forces)


def mean_period(forces, target, period):
    above = forces > target
    rises = np.flatnonzero(~above[:-1] & above[1:])
    return (rises[-1] - rises[0]) / (len(rises) - 1) * period


def test_integrator_with_delay_has_textbook_margins():
    # L = g/(z − 1): on the negative real axis at z = −1, where |L| = g/2; |L| = 1 at sin(θ/2) = g/2.
    result = margins(1000.0, pi_response(0.0, 0.4e-3), ideal())
    assert result.gain_margin == pytest.approx(2 / 0.4, rel=1e-3)
    assert result.phase_crossover_rad_s == pytest.approx(math.pi / 0.1, rel=1e-3)
    theta = 2 * math.asin(0.2)
    assert result.gain_crossover_rad_s == pytest.approx(theta / 0.1, rel=1e-3)
    assert result.phase_margin_deg == pytest.approx(90 - math.degrees(theta / 2), abs=0.1)
    assert result.stable


def test_second_delay_sample_halves_gain_margin():
    # L = g/(z(z − 1)): phase −90° − 3θ/2, so θ = π/3, where |L| = g.
    result = margins(1000.0, pi_response(0.0, 0.4e-3), ideal(1.5))
    assert result.gain_margin == pytest.approx(1 / 0.4, rel=1e-3)
    assert result.phase_crossover_rad_s == pytest.approx(math.pi / 3 / 0.1, rel=1e-3)


def test_integrator_phase_with_delay_is_linear():
    omega = np.array([1.0, 5.0, 20.0])
    phase = loop_phase_deg(1000.0, pi_response(0.0, 1e-3), ideal(1.5), omega)
    assert phase == pytest.approx(-90 - 1.5 * np.degrees(omega * 0.1), abs=0.1)


def test_proportional_part_alone_does_not_integrate():
    result = margins(1000.0, pi_response(0.5e-3, 0.0), ideal())
    assert result.gain_margin == pytest.approx(2.0, rel=1e-3)  # 0.5/z at z = −1
    assert result.phase_margin_deg == math.inf
    assert math.isnan(result.gain_crossover_rad_s)


def test_gain_margin_is_inverse_to_stiffness():
    plant = SampledPlant(0.18, 0.13)
    soft, hard = (margins(k, pi_response(0.0, 2e-5), plant).gain_margin for k in (5e3, 5e4))
    assert soft == pytest.approx(10 * hard, rel=1e-6)


@pytest.mark.parametrize(("delay", "period"), [(0.13, 0.18), (0.07, 0.1), (0.25, 0.1)])
def test_loop_oscillates_beyond_gain_margin(delay, period):
    plant = SampledPlant(period, delay)
    critical = margins(1e4, pi_response(0.0, 1e-5), plant).gain_margin * 1e-5
    calm, wild = (
        np.ptp(simulate(1e4, factor * critical, plant, samples=400, quantise=False, kick=STEP)[-40:])
        for factor in (0.9, 1.1)
    )
    assert calm < 0.05
    assert wild > 5.0


def test_admittance_without_mass_is_an_integrator():
    plant = SampledPlant(0.1, 0.07)
    z = np.exp(1j * np.array([0.1, 1.0, 3.0]))
    assert admittance_response(0.0, 50.0, 0.1)(z) == pytest.approx(pi_response(0.0, 0.1 / 50.0)(z))
    light, heavy = (margins(5e3, admittance_response(m, 2e3, 0.1), plant) for m in (1.0, 500.0))
    assert heavy.phase_margin_deg < light.phase_margin_deg
    assert not margins(5e4, admittance_response(500.0, 2e3, 0.1), plant).stable


def test_fast_and_slow_servos_settle_at_one():
    for zeta in (0.3, 1.0, 2.5):
        plant = SampledPlant(0.1, 0.033, 25.0, zeta)
        assert plant.taps().sum() == pytest.approx(1.0)
        assert plant.taps()[0] == 0.0


@pytest.mark.parametrize("stiffness", [5e3, 2e4, 1e5])
@pytest.mark.parametrize(("delay", "period"), [(0.12, 0.1), (0.15, 0.1), (0.25, 0.1), (0.2, 0.18)])
@pytest.mark.parametrize("loop_gain", [0.1, 0.3])
def test_limit_cycle_is_predicted(stiffness, delay, period, loop_gain):
    plant = SampledPlant(period, delay)
    integral = loop_gain / stiffness
    predicted = limit_cycle(stiffness, pi_response(0.0, integral), plant, Quantiser(STEP))
    forces = simulate(stiffness, integral, plant)[-400:]
    assert np.ptp(forces) == pytest.approx(predicted.peak_to_peak, rel=0.25)
    assert mean_period(forces, stiffness * STEP * 40.5, period) == pytest.approx(predicted.period, rel=0.25)
    assert predicted.peak_to_peak == pytest.approx(stiffness * STEP, rel=0.25)


@pytest.mark.parametrize("loop_gain", [0.05, 0.1, 0.2, 0.3, 0.4])
@pytest.mark.parametrize(("delay", "period"), [(0.05, 0.1), (0.13, 0.18)])
def test_limit_cycle_with_short_delay_is_an_upper_bound(delay, period, loop_gain):
    plant = SampledPlant(period, delay)
    predicted = limit_cycle(2e4, pi_response(0.0, loop_gain / 2e4), plant, Quantiser(STEP))
    assert predicted.period == pytest.approx(4 * period)
    for kick in (0.0, 0.2 * STEP, 0.7 * STEP):
        amplitude = np.ptp(simulate(2e4, loop_gain / 2e4, plant, kick=kick)[-400:])
        assert amplitude <= 1.02 * predicted.peak_to_peak


@pytest.mark.parametrize("offset", [0.2, 0.35, 0.7])
def test_limit_cycle_off_centre_is_slower(offset):
    plant = SampledPlant(0.1, 0.35)
    predicted = limit_cycle(2e4, pi_response(0.0, 0.05 / 2e4), plant, Quantiser(STEP, offset=offset))
    forces = simulate(2e4, 0.05 / 2e4, plant, offset, samples=4000)[-1000:]
    measured = mean_period(forces, 2e4 * STEP * (40 + offset), 0.1)
    assert measured == pytest.approx(predicted.period, rel=0.25)


def test_limit_cycle_with_dead_band_is_slower():
    plant = SampledPlant(0.1, 0.15)
    plain, banded = (
        limit_cycle(2e4, pi_response(0.0, 0.1 / 2e4), plant, Quantiser(STEP, dead_band=b)) for b in (0.0, 0.5)
    )
    assert banded.period > 1.5 * plain.period
    assert banded.peak_to_peak == pytest.approx(2e4 * STEP, rel=0.05)


@pytest.mark.full
@pytest.mark.parametrize(("frequency", "damping"), [(25.0, 1.0), (40.0, 1.0), (40.0, 0.7), (40.0, 1.5)])
def test_holding_servo_stops_beyond_border(frequency, damping):
    """If the servo settles well before each sample, the amplitude is a fixed point in closed form."""
    tick = 0.02
    plant = SampledPlant(1.0, 0.1, frequency, damping)
    fixed, before = [], 0.0
    for f in plant.step_response(tick * np.arange(1, 20)).tolist():
        beyond = f / (2.0 * (2.0 - f))
        if before * (0.5 + beyond) < beyond:
            fixed.append(2e4 * STEP * 2.0 * beyond)
        before = f
    result = holding_limit_cycle(2e4, 0.05 / 2e4, plant, HoldingServo(STEP, tick))
    assert any(result.peak_to_peak == pytest.approx(amplitude, rel=0.01) for amplitude in fixed)
    assert len(fixed) <= 3
    assert result.period == pytest.approx(2.0, rel=0.01)


def test_holding_servo_amplitude_grows_while_coasting():
    rested = holding_limit_cycle(2e4, 0.2 / 2e4, SampledPlant(1.0, 0.1), HoldingServo(STEP, 0.02))
    coasting = holding_limit_cycle(2e4, 0.2 / 2e4, SampledPlant(0.18, 0.115), HoldingServo(STEP, 0.02))
    filtered = holding_limit_cycle(2e4, 0.2 / 2e4, SampledPlant(0.18, 0.115), HoldingServo(STEP, 0.02), 0.016)
    assert coasting.peak_to_peak > 1.8 * rested.peak_to_peak
    assert rested.peak_to_peak < filtered.peak_to_peak < coasting.peak_to_peak


def test_holding_servo_in_unstable_loop_is_refused():
    with pytest.raises(ValueError, match="unstable"):
        holding_limit_cycle(2e4, 30.0 / 2e4, SampledPlant(0.18, 0.1), HoldingServo(STEP, 0.02))


def test_loops_without_a_limit_cycle_are_refused():
    plant = SampledPlant(0.1, 0.05)
    with pytest.raises(ValueError, match="unstable"):
        limit_cycle(2e4, pi_response(0.0, 30.0 / 2e4), plant, Quantiser(STEP))
    with pytest.raises(ValueError, match="offset"):
        limit_cycle(2e4, pi_response(0.0, 0.1 / 2e4), plant, Quantiser(STEP, offset=1.0))
    with pytest.raises(ValueError, match="period"):
        SampledPlant(0.0, 0.1)


def test_responses_match_the_controllers():
    """The response of a controller object to a force impulse, summed up, is its transfer function."""
    period, stop = 0.18, 400
    z = np.exp(1j * np.array([0.5, 1.5, 3.0]))
    for controller, response in (
        (Pi(proportional=0.1, integral=0.2, correction_limit_mm=1e9), pi_response(0.1 / 5e3, 0.2 / 5e3)),
        (
            Admittance(mass_kg=220.0, damping_ns_m=4500.0, correction_limit_mm=1e9),
            admittance_response(220.0, 4500.0, period),
        ),
    ):
        state, commanded, moves = controller.initial(), 0.0, []
        for k in range(stop):
            force = 9.0 if k == 1 else 10.0
            measurement = Measurement(k * period, force, 0.0, commanded)
            state, command = controller.step(state, measurement, 10.0)
            moves.append(command.position - commanded)
            commanded = command.position
        # Moves die out where the command does not; the command is their sum: z/(z − 1) times them.
        transfer = sum(move * z ** -(k - 1) for k, move in enumerate(moves) if k) * z / (z - 1)
        assert transfer == pytest.approx(response(z), rel=1e-6)
