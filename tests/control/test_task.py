"""Course of a run without steps: phases, contact, contact loss, ends."""

import math
from dataclasses import replace

import pytest

from hil_bridge.control import Command, FuzzyAdaptive, FuzzyPi, Measurement, Phase, TaskParameters
from hil_bridge.errors import Cause, Reason
from tests.control.plain import PlainRun

PARAMETERS = TaskParameters(travel_limit_mm=10.0, approach_depth_limit_mm=5.0, retract_mm=4.0)


STEP = 0.125e-3
"""Step of the robot's position, m."""


def task_of(parameters, controller, limit=math.inf):
    return PlainRun(parameters, controller, limit, STEP)


class Watched:
    """Controller that counts its steps in its state and never moves."""

    name = "watched"

    def initial(self):
        return 0

    def step(self, state, measurement, reference):
        assert reference == 10.0
        return state + 1, Command(measurement.commanded, 0.0, explanation={"contact": measurement.in_contact})


def drive(task, force_of, samples, state=None):
    """Follow the task's depth exactly; the force is a function of depth, travel and sample."""
    state, depth, travel, outputs = state or task.initial(), 0.0, 0.0, []
    for k in range(samples):
        state, output = task.step(state, Measurement(k * 0.18, force_of(depth, travel, k), depth, depth))
        depth, travel = output.target.depth, output.target.travel
        outputs.append(output)
    return state, outputs


def surface_at(contact, stiffness=5000.0):
    return lambda depth, travel, k: stiffness * max(depth - contact, 0.0)


def test_stroke_runs_through_all_phases():
    state, outputs = drive(task_of(PARAMETERS, FuzzyPi()), surface_at(3e-3), 60)
    phases = [output.phase for output in outputs]
    assert sorted(set(phases), key=phases.index) == [Phase.APPROACH, Phase.TRACK, Phase.RETRACT, Phase.END]
    assert phases.count(Phase.TRACK) == 10
    assert state.course.reason is None
    assert state.course.travelled == Reason(Cause.TRAVELLED, "travelled 10 mm")
    tracked = [output for output in outputs if output.phase is Phase.TRACK]
    assert [o.target.travel for o in tracked] == pytest.approx([k * 1e-3 for k in range(1, 11)])
    assert outputs[-1].target.travel == pytest.approx(10e-3)
    assert outputs[-1].target.depth == 0.0, "at least back to the depth of the start"
    assert outputs[-1].losses == 0


def test_plain_run_timeout_names_the_time():
    task = PlainRun(PARAMETERS, FuzzyPi(), math.inf, STEP, duration_s=0.9)
    state, outputs = drive(task, surface_at(3e-3), 60)
    assert state.phase is Phase.END
    assert outputs[-1].target.travel < 10e-3
    assert state.course.travelled == Reason(Cause.TIME_IS_UP)


def test_controller_is_stepped_in_track_only():
    state, outputs = drive(task_of(PARAMETERS, Watched()), surface_at(3e-3), 60)
    assert all((output.command is not None) == (output.phase is Phase.TRACK) for output in outputs)
    assert state.step.stroke.controller == sum(output.phase is Phase.TRACK for output in outputs)


def test_approach_without_surface_ends_at_depth_limit():
    state, outputs = drive(task_of(PARAMETERS, Watched()), lambda *_: 0.0, 40)
    assert str(state.course.reason).startswith("no contact found within 5 mm: start nearer")
    assert state.course.reason.cause is Cause.NO_CONTACT
    assert state.phase is Phase.END
    assert state.step.stroke.controller is None
    assert max(output.target.depth for output in outputs) == pytest.approx(5e-3)
    assert outputs[-1].target.depth == 0.0


def test_contact_loss_restarts_approach_with_estimate():
    task = task_of(replace(PARAMETERS, loss_ms=450.0, travel_limit_mm=100.0), FuzzyAdaptive())
    # A hole of 4 mm after 5 mm of travel.
    state, outputs = drive(task, lambda d, t, k: 5000 * max(d - (3e-3 if t < 5e-3 else 7e-3), 0.0), 40)
    lost = next(i for i, output in enumerate(outputs) if i > 10 and not output.in_contact)
    assert outputs[-1].losses == 1
    assert {output.target.travel for output in outputs[lost : lost + 3]} == {outputs[lost - 1].target.travel}
    after = [output.phase for output in outputs[lost:]]
    assert after[:4] == [Phase.TRACK] * 3 + [Phase.APPROACH]
    back = lost + 3 + after[3:].index(Phase.TRACK)
    assert outputs[back].command.stiffness == pytest.approx(outputs[lost].command.stiffness)
    assert state.phase is Phase.TRACK


def test_contact_loss_has_hysteresis():
    forces = [2.0, 0.7, 0.4, 0.7, 1.1]
    task = task_of(PARAMETERS, Watched())
    _, outputs = drive(task, lambda d, t, k: forces[k], len(forces))
    assert [output.in_contact for output in outputs] == [True, True, False, False, True]
    assert [output.command.explanation["contact"] for output in outputs] == [True, True, False, False, True]
    assert outputs[-1].losses == 1


def test_too_many_losses_end_the_run():
    task = task_of(replace(PARAMETERS, loss_limit=3, travel_limit_mm=1e3), Watched())
    state, _ = drive(task, lambda d, t, k: 5.0 * (k % 2 == 0), 30)
    assert str(state.course.reason) == "contact lost 3 times"
    assert state.course.reason.cause is Cause.CONTACT_LOST
    assert state.phase is Phase.END


def test_finish_from_outside_retracts_once():
    task = task_of(PARAMETERS, Watched())
    state, outputs = drive(task, surface_at(0.0), 4)
    state = task.finish(
        task.finish(state, Reason(Cause.TIME_IS_UP, "time is up")), Reason(Cause.SIGNAL, "again")
    )
    assert str(state.course.reason) == "time is up"
    depth = outputs[-1].target.depth
    _, output = task.step(state, Measurement(1.0, 5.0, depth, depth))
    assert output.phase is Phase.RETRACT
    assert output.target.depth == max(depth - 1e-3, 0.0)


@pytest.mark.parametrize("force", [math.nan, math.inf])
def test_non_finite_force_never_moves_deeper(force):
    task = task_of(PARAMETERS, Watched())
    state = task.initial()
    after, output = task.step(state, Measurement(0.0, force, 0.0, 1e-3))
    assert after.step.stroke is state.step.stroke
    assert output.target.depth == 1e-3


def test_retraction_continues_with_dead_sensor():
    task = task_of(PARAMETERS, Watched())
    state = task.finish(task.initial(), Reason(Cause.SENSOR_FAILED, "the sensor died"))
    state, outputs = drive(task, lambda *_: math.nan, 40, state)
    assert state.phase is Phase.END
    assert outputs[-1].target.depth == pytest.approx(-4e-3)


@pytest.mark.parametrize(
    "wrong",
    [
        {"force_n": 0.0},
        {"speed_mm_s": -1.0},
        {"approach_speed_mm_s": 0.0},
        {"retract_speed_mm_s": math.inf},
        {"loss_ms": 0.0},
        {"loss_threshold_n": 2.0},
        {"contact_threshold_n": 10.0},
        {"retract_mm": math.nan},
        {"travel_from_share": 1.5},
        {"expected_stiffness_n_m": 0.0},
        {"search_depth_limit_mm": -1.0},
    ],
)
def test_task_invalid_parameters_are_refused(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        TaskParameters(**wrong)


@pytest.mark.parametrize("lag", [0, 1, 2, 4])
@pytest.mark.parametrize(("stiffness", "limit"), [(5e3, 50.0), (2e4, 50.0), (5e3, 12.0)])
def test_first_touch_presses_no_more_than_allowed(stiffness, limit, lag):
    """The robot is where it was sent `lag` samples ago, and the approach stops when contact shows."""
    parameters = replace(PARAMETERS, expected_stiffness_n_m=stiffness, approach_speed_mm_s=11.0)
    allowed = min(10.0, limit / 2)
    for contact in (1.0e-3, 1.3e-3, 1.77e-3, 2.01e-3):
        task = task_of(parameters, Watched(), limit)
        state, commands = task.initial(), [0.0] * (lag + 1)
        for k in range(400):
            depth = commands[-1 - lag]
            force = stiffness * max(depth - contact, 0.0)
            state, output = task.step(state, Measurement(k * 0.18, force, depth, commands[-1]))
            if output.phase is Phase.TRACK:
                break
            commands.append(output.target.depth)
        assert output.phase is Phase.TRACK
        threshold = parameters.contact_threshold_n
        assert stiffness * (commands[-1] - contact) <= allowed + threshold + 1e-6


def test_approach_speed_is_bounded_by_setting():
    soft = task_of(replace(PARAMETERS, expected_stiffness_n_m=500.0), Watched())
    hard = task_of(replace(PARAMETERS, expected_stiffness_n_m=1e7), Watched())
    for task, step in ((soft, 0.5e-3), (hard, 0.2e-3 * 0.18)):
        _, outputs = drive(task, lambda *_: 0.0, 5)
        assert [o.target.depth for o in outputs] == pytest.approx([step * k for k in range(1, 6)])


def test_contact_loss_at_edge_does_not_dive():
    parameters = replace(PARAMETERS, travel_limit_mm=100.0, approach_depth_limit_mm=50.0)
    for controller in (FuzzyPi(), FuzzyAdaptive()):
        task = task_of(replace(parameters, search_depth_limit_mm=3.0), controller)
        state, outputs = drive(task, lambda d, t, k: 5e3 * max(d - 3e-3, 0.0) if t < 5e-3 else 0.0, 60)
        lost = next(i for i, output in enumerate(outputs) if i > 10 and not output.in_contact)
        assert str(state.course.reason) == "the surface ended: no contact within 3 mm"
        assert state.course.reason.cause is Cause.SURFACE_ENDED
        assert state.course.failed
        assert state.phase is Phase.END
        deepest = max(output.target.depth for output in outputs)
        assert deepest <= outputs[lost - 1].target.depth + 3e-3 + 1e-9


def test_travel_waits_for_force():
    parameters = replace(PARAMETERS, travel_from_share=0.8)
    _, outputs = drive(task_of(parameters, FuzzyPi()), surface_at(3e-3), 40)
    track = [output for output in outputs if output.phase is Phase.TRACK]
    first_move = next(i for i, output in enumerate(track) if output.target.travel > 0)
    assert first_move > 0
    forces = [5e3 * (output.target.depth - 3e-3) for output in track]
    assert forces[first_move - 1] >= 8.0
    assert all(force < 8.0 for force in forces[: first_move - 1])
    assert track[first_move + 3].target.travel == pytest.approx(4e-3)
