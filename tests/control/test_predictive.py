"""The controller that looks ahead along the travel."""

import math
from random import Random

import pytest
from msgspec.structs import replace

from hil_bridge.control import Measurement, Predictive

STEP = 0.125e-3
PAPER = Predictive(step_limit_mm=50.0, force_uncertainty_n=0.5)
"""With the paper's noise, and unlimited as the paper's adaptation."""


def sample(force, position=0.0, commanded=None, travel=0.0, ahead=0.0, **more):
    commanded = position if commanded is None else commanded
    return Measurement(0.0, force, position, commanded, travel=travel, travel_next=travel + ahead, **more)


def learnt(stiffness, force=10.0):
    controller = Predictive()
    state, _ = controller.step(controller.initial(), sample(force - stiffness * 2e-3), force)
    return controller, controller.step(state, sample(force, 2e-3), force)[0]


@pytest.mark.parametrize("stiffness", [5e3, 2e4, 5e4, 1e5])
def test_under_the_papers_assumptions_it_rests_near_the_force(wall, stiffness):
    for seed in range(20):
        merit = wall(PAPER, stiffness, seed).merit
        assert merit.steps_per_s == 0.0
        assert abs(merit.steady_mean_error_n) <= stiffness * STEP / 2 + 0.5
        assert merit.overshoot_percent <= 10
        assert merit.rise_samples <= 4


def test_on_a_slope_it_commands_the_surface_ahead_of_the_tool():
    controller, state = learnt(5e3)
    slope = 0.2
    for k in range(1, 12):
        surface = slope * k * 1e-3
        state, command = controller.step(
            state, sample(10.0, surface + 2e-3, travel=k * 1e-3, ahead=1.85e-3), 10.0
        )
    assert command.position == pytest.approx(slope * (11 + 1.85) * 1e-3 + 2e-3, abs=0.03e-3)
    assert command.explanation["slope"] == pytest.approx(slope, rel=0.1)


def test_a_delay_of_two_samples_does_not_show_on_a_wave():
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
        settled = forces[30:]
        assert math.sqrt(sum((f - 10.0) ** 2 for f in settled) / len(settled)) < 0.8
        assert min(settled) > 5.0


def test_it_holds_where_no_reachable_position_is_nearer():
    controller, state = learnt(2e4)
    band = 2e4 * STEP / 2 + 0.1
    for share, held in ((0.9, True), (1.2, False)):
        _, command = controller.step(state, sample(10.0 + share * band, 2e-3, 2.03e-3), 10.0)
        assert command.held is held
        assert (command.position == 2.03e-3) is held


def test_the_first_move_is_made_for_the_stiffest_surface():
    _, command = Predictive().step(Predictive().initial(), sample(2.0, 1e-3), 10.0)
    assert command.correction == pytest.approx(8.0 / 1e5)
    assert command.gain == 0.0


def test_probing_quickens_when_the_surface_hardly_answers():
    controller = Predictive()
    state, _ = controller.step(controller.initial(), sample(2.0, 0.0), 10.0)
    _, command = controller.step(state, sample(2.1, 4 * STEP), 10.0)
    assert command.stiffness is None
    assert command.correction > 20 * 7.9 / 1e5


def test_too_much_force_at_first_touch_backs_off():
    _, command = Predictive().step(Predictive().initial(), sample(30.0, 1e-3, free_position=0.5e-3), 10.0)
    assert command.correction == pytest.approx(-20.0 * 0.5e-3 / (2 * 30.0))


def test_no_order_goes_further_than_a_step_inwards_or_outwards():
    _, state = learnt(5e3)
    for force, wanted in ((40.0, -0.1e-3), (2.0, 0.1e-3)):
        _, command = Predictive(step_limit_mm=0.1).step(state, sample(force, 2e-3), 10.0)
        assert command.correction == pytest.approx(wanted)


def test_doubt_makes_inward_moves_smaller():
    surer, unsure = Predictive(caution=0.0), Predictive(caution=3.0)
    moves = []
    for controller in (surer, unsure):
        state, _ = controller.step(controller.initial(), sample(2.0), 10.0)
        _, command = controller.step(state, sample(3.0, 2 * STEP), 10.0)
        moves.append(command.correction)
    assert 0 < moves[1] < moves[0]


def test_swings_of_the_error_raise_the_stiffness_used():
    controller, state = learnt(5e3)
    guards = []
    for k in range(12):
        state, command = controller.step(state, sample(10.0 + 3.0 * (-1) ** k, 2e-3), 10.0)
        guards.append(command.explanation["guard"])
    assert guards[1] == 1.0  # one swing is what any landing has
    assert guards[-1] > 4.0


def test_contact_lost_is_searched_by_a_third_of_what_presses_in_full():
    controller, state = learnt(5e3)
    state, command = controller.step(state, sample(0.0, 2e-3, in_contact=False), 10.0)
    assert command.correction == pytest.approx(10.0 / (3 * 5e3), rel=0.02)
    assert state.pairs == ()
    assert command.stiffness == pytest.approx(5e3, rel=0.02)


@pytest.mark.parametrize(
    "wrong", [{"window": 0}, {"caution": -1.0}, {"smallest_radius_mm": 0.0}, {"resolution_mm": math.nan}]
)
def test_impossible_parameters_are_refused(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        Predictive(**wrong)
