"""Predictive controller."""

import math
from random import Random

import pytest
from msgspec.structs import replace

from hil_bridge.control import Measurement, Predictive

STEP = 0.125e-3
PAPER = Predictive(step_limit_mm=50.0, force_uncertainty_n=0.5)
"""With the paper's noise, and without limits like the paper's adaptation."""


def sample(force, position=0.0, commanded=None, travel=0.0, ahead=0.0, **more):
    commanded = position if commanded is None else commanded
    return Measurement(0.0, force, position, commanded, travel=travel, travel_next=travel + ahead, **more)


def learnt(stiffness, force=10.0):
    controller = Predictive()
    state, _ = controller.step(controller.initial(), sample(force - stiffness * 2e-3), force)
    return controller, controller.step(state, sample(force, 2e-3), force)[0]


@pytest.mark.parametrize("stiffness", [5e3, 2e4, 5e4, 1e5])
def test_predictive_settles_near_force_in_paper_setup(wall, stiffness):
    for seed in range(20):
        merit = wall(PAPER, stiffness, seed).merit
        assert merit.steps_per_s == 0.0
        assert abs(merit.steady_mean_error_n) <= stiffness * STEP / 2 + 0.5
        assert merit.overshoot_percent <= 10
        assert merit.rise_samples <= 4


@pytest.mark.parametrize(
    ("window_ms", "dt", "pairs"),
    [(80.0, 0.004, 20), (80.0, 0.01, 8), (80.0, 0.18, 6), (0.0, 0.004, 6), (80.0, 0.0, 80)],
)
def test_predictive_window_is_time_with_fewest_pairs(window_ms, dt, pairs):
    controller = Predictive(window_ms=window_ms)
    state = controller.initial()
    for k in range(100):
        state, _ = controller.step(state, sample(10.0, travel=k * 1e-4, dt=dt), 10.0)
    assert len(state.pairs) == pairs


def test_predictive_commands_surface_ahead_on_slope():
    controller, state = learnt(5e3)
    slope = 0.2
    for k in range(1, 12):
        surface = slope * k * 1e-3
        state, command = controller.step(
            state, sample(10.0, surface + 2e-3, travel=k * 1e-3, ahead=1.85e-3), 10.0
        )
    assert command.position == pytest.approx(slope * (11 + 1.85) * 1e-3 + 2e-3, abs=0.03e-3)
    assert command.explanation["slope"] == pytest.approx(slope, rel=0.1)


def test_predictive_compensates_two_samples_of_delay():
    """Commands are points of a path; the tool reports where it was nearly two points ago."""
    for seed in range(5):
        random, controller = Random(seed), Predictive()
        state, path, forces = controller.initial(), [(0.0, 1e-3)] * 3, []
        for k in range(300):
            (y0, x0), (y1, x1) = path[-3], path[-2]
            travel, true = y0 + 0.15 * (y1 - y0), x0 + 0.15 * (x1 - x0)
            force = 5e3 * max(true - 10e-3 * (1 - math.cos(travel * 2 * math.pi / 0.2)), 0.0)
            measured = replace(
                sample(force + random.gauss(0, 0.03), round(true / STEP) * STEP, path[-1][1], travel),
                travel_next=k * 1e-3,
                in_contact=force > 0.5,
            )
            state, command = controller.step(state, measured, 10.0)
            path.append((k * 1e-3, round(command.position / STEP) * STEP))
            forces.append(force)
        steady = forces[30:]
        assert math.sqrt(sum((f - 10.0) ** 2 for f in steady) / len(steady)) < 0.8
        assert min(steady) > 5.0


def test_predictive_holds_in_dead_band():
    controller, state = learnt(2e4)
    band = 2e4 * STEP / 2 + 0.1
    for share, is_held in ((0.9, True), (1.2, False)):
        _, command = controller.step(state, sample(10.0 + share * band, 2e-3, 2.03e-3), 10.0)
        assert command.held is is_held
        assert (command.position == 2.03e-3) is is_held


def test_predictive_first_move_assumes_stiffest_surface():
    _, command = Predictive().step(Predictive().initial(), sample(2.0, 1e-3), 10.0)
    assert command.correction == pytest.approx(8.0 / 1e5)
    assert command.gain == 0.0


def test_predictive_probing_accelerates_on_soft_surface():
    controller = Predictive()
    state, _ = controller.step(controller.initial(), sample(2.0, 0.0), 10.0)
    _, command = controller.step(state, sample(2.1, 4 * STEP), 10.0)
    assert command.stiffness is None
    assert command.correction > 20 * 7.9 / 1e5


def test_predictive_backs_off_from_hard_touch():
    _, command = Predictive().step(Predictive().initial(), sample(30.0, 1e-3, free_position=0.5e-3), 10.0)
    assert command.correction == pytest.approx(-20.0 * 0.5e-3 / (2 * 30.0))


def test_predictive_order_is_limited_per_sample():
    _, state = learnt(5e3)
    for force, expected in ((40.0, -0.1e-3), (2.0, 0.1e-3)):
        _, command = Predictive(step_limit_mm=0.1).step(state, sample(force, 2e-3), 10.0)
        assert command.correction == pytest.approx(expected)


def test_predictive_uncertainty_reduces_inward_moves():
    surer, unsure = Predictive(caution=0.0), Predictive(caution=3.0)
    moves = []
    for controller in (surer, unsure):
        state, _ = controller.step(controller.initial(), sample(2.0), 10.0)
        _, command = controller.step(state, sample(3.0, 2 * STEP), 10.0)
        moves.append(command.correction)
    assert 0 < moves[1] < moves[0]


def test_predictive_oscillation_raises_stiffness():
    controller, state = learnt(5e3)
    guards = []
    for k in range(12):
        state, command = controller.step(state, sample(10.0 + 3.0 * (-1) ** k, 2e-3), 10.0)
        guards.append(command.explanation["guard"])
    assert guards[1] == 1.0  # any landing has one oscillation
    assert guards[-1] > 4.0


def test_predictive_contact_search_moves_a_third():
    controller, state = learnt(5e3)
    state, command = controller.step(state, sample(0.0, 2e-3, in_contact=False), 10.0)
    assert command.correction == pytest.approx(10.0 / (3 * 5e3), rel=0.02)
    assert state.pairs == ()
    assert command.stiffness == pytest.approx(5e3, rel=0.02)


@pytest.mark.parametrize(
    "wrong", [{"window": 0}, {"caution": -1.0}, {"smallest_radius_mm": 0.0}, {"resolution_mm": math.nan}]
)
def test_predictive_invalid_parameters_are_refused(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        Predictive(**wrong)
