"""Speeds and times of task and guard, converted to steps by the measured duration of each cycle."""

import math
from dataclasses import dataclass, replace
from typing import Any

import pytest
from msgspec import structs

from hil_bridge.control import (
    CONTROLLERS,
    Clamp,
    Command,
    ControlLoop,
    Limits,
    Measurement,
    Phase,
    Request,
    Sample,
    Stop,
    Supervisor,
    TaskParameters,
    make_controller,
)
from hil_bridge.control.controllers import check_period, sample_time
from hil_bridge.control.loop import LONGEST_SAMPLES
from hil_bridge.control.types import SAMPLE_MS
from hil_bridge.errors import Cause, ConfigError, Reason
from tests.control.plain import PlainRun, plain_program
from tests.observed import observation, observed

STEP = 0.125e-3
"""Position step of the paper's robot, m."""
CYCLES_S = (0.002, 0.004, 0.02, 0.18)
DOWN = (0.0, 0.0, -1.0)
START = (0.9, 0.0, 0.6)


@dataclass
class Still:
    """Controller that never moves."""

    sample_ms: Any = SAMPLE_MS
    name: str = "still"

    def initial(self) -> int:
        return 0

    def step(self, state: int, measurement: Measurement, reference: float) -> tuple[int, Command]:
        return state, Command(measurement.commanded, 0.0)


def outputs(task: PlainRun, dt: float, seconds: float, force: float = 0.0) -> list[Any]:
    """Commands of a task in cycles of this time; the robot follows at once, and the force is always the same."""
    state, depth, answers = task.initial(), 0.0, []
    for k in range(round(seconds / dt)):
        state, output = task.step(state, Measurement(k * dt, force, depth, depth, dt=dt))
        depth = output.target.depth
        answers.append(output)
    return answers


@pytest.mark.parametrize("position_step", [None, STEP])
@pytest.mark.parametrize("dt", CYCLES_S)
def test_stroke_speed_is_independent_of_cycle(dt: float, position_step: float | None) -> None:
    parameters = TaskParameters(expected_stiffness_n_m=500.0)
    task = PlainRun(parameters, Still(), position_step=position_step)
    approach = outputs(task, dt, 3.6)
    assert {output.phase for output in approach} == {Phase.APPROACH}
    # complete position steps match the speed to within half a step a cycle
    rough = 0.0 if position_step is None else 0.5 * position_step
    most = abs(approach[-1].target.depth / len(approach) - 2.75e-3 * dt)
    assert most <= (rough if 2.75e-3 * dt > rough else 0.0) + 1e-12
    track = outputs(task, dt, 3.6, force=10.0)
    assert {output.phase for output in track} == {Phase.TRACK}
    most = abs(track[-1].target.travel / len(track) - 5.5e-3 * dt)
    assert most <= (rough if 5.5e-3 * dt > rough else 0.0) + 1e-12


@pytest.mark.parametrize("dt", [0.172, 0.18, 0.187])
def test_stroke_on_slow_link_is_multiple_of_position_step(dt: float) -> None:
    task = PlainRun(TaskParameters(), Still(), position_step=STEP)
    assert task.stroke.way(5.5, dt) == 1e-3
    assert task.stroke.way(2.75, dt) == 0.5e-3


def test_stroke_without_position_step_is_not_rounded() -> None:
    assert PlainRun(TaskParameters(), Still()).stroke.way(5.5, 0.1) == 5.5 * 1e-3 * 0.1


def test_stroke_below_half_step_adds_up() -> None:
    task = PlainRun(TaskParameters(), Still(), position_step=STEP)
    assert task.stroke.way(5.5, 0.002) == pytest.approx(5.5e-3 * 0.002)
    assert task.stroke.way(0.0, 0.18) == 0.0


@pytest.mark.parametrize("dt", CYCLES_S)
def test_retraction_speed_is_independent_of_cycle(dt: float) -> None:
    task = PlainRun(TaskParameters(retract_mm=4.0), Still())
    state = task.finish(task.initial(), Reason(Cause.TIME_IS_UP, "enough"))
    _, output = task.step(state, Measurement(0.0, 8.0, 5e-3, 5e-3, dt=dt))
    assert output.phase is Phase.RETRACT
    assert 5e-3 - output.target.depth == pytest.approx(5.5e-3 * dt)


@pytest.mark.parametrize("dt", CYCLES_S)
def test_contact_loss_time_is_independent_of_cycle(dt: float) -> None:
    task = PlainRun(TaskParameters(loss_ms=450.0), Still())
    state, depth = task.initial(), 3e-3
    state, _ = task.step(state, Measurement(0.0, 8.0, depth, depth, dt=dt))
    lost = 0
    while state.phase is Phase.TRACK:
        state, _ = task.step(state, Measurement(0.0, 0.0, depth, depth, dt=dt))
        lost += 1
    assert 0.45 - 1e-9 <= lost * dt < 0.45 + dt + 1e-9
    assert state.phase is Phase.APPROACH
    assert state.step.stroke.losses == 1


SUPERVISOR = Supervisor(Limits())
QUIET = observation(5.0, resultant=6.0, sensor_at=99.99)


@pytest.mark.parametrize("dt", CYCLES_S)
def test_guard_speed_limit_is_exact(dt: float) -> None:
    state = SUPERVISOR.initial((0.0, 0.0, 0.0))
    requested = Request(5e-3, (20e-3, 0.0, -5e-3), DOWN)
    _, verdict = SUPERVISOR.step(state, observed(QUIET, dt=dt), requested)
    assert isinstance(verdict, Clamp)
    assert verdict.depth == 11.0 * 1e-3 * dt
    assert verdict.position == pytest.approx((27.5e-3 * dt, 0.0, -11e-3 * dt))
    assert verdict.reasons == ("deeper faster than 11 mm/s", "across faster than 27.5 mm/s")


@pytest.mark.parametrize("dt", [0.002, 0.004])
def test_fast_robot_moves_between_slow_sensor_frames(dt: float) -> None:
    """Frames come every 10 ms, cycles every few."""
    state = SUPERVISOR.initial((0.0, 0.0, 0.0))
    for k in range(round(1.0 / dt)):
        sample = observed(QUIET, now=k * dt, sensor_at=k * dt, sensor_sequence=int(k * dt / 0.01), dt=dt)
        state, verdict = SUPERVISOR.step(state, sample, Request(0.0, (0.0, 0.0, 0.0), DOWN))
        assert not isinstance(verdict, Stop), k


@pytest.mark.parametrize("dt", [0.002, 0.004, 0.02, 0.172, 0.18, 0.187])
def test_frozen_sensor_stop_time_is_cycle_independent(dt: float) -> None:
    state, cycles, verdict = SUPERVISOR.initial((0.0, 0.0, 0.0)), 0, None
    while not isinstance(verdict, Stop):
        # as if its age were not known
        sample = observed(QUIET, dt=dt)
        state, verdict = SUPERVISOR.step(state, sample, Request(0.0, (0.0, 0.0, 0.0), DOWN))
        cycles += 1
    assert verdict.reason.cause is Cause.NO_NEW_FRAME
    still = (cycles - 1) * dt
    assert 0.45 - 1e-9 <= still < 0.45 + dt + 1e-9
    assert verdict.reason.text == f"no new force for {still * 1e3:.0f} ms"
    assert dt < 0.17 or cycles == 4, "three cycles of the slow link, as before"


def loop(**more: Any) -> ControlLoop:
    task = plain_program(TaskParameters(expected_stiffness_n_m=500.0), Still())
    return ControlLoop(task, Supervisor(Limits()), **more)


def test_first_cycle_counts_as_sample_time() -> None:
    control = loop(sample_time=0.02)
    state, durations = control.initial(START), []
    for now in (100.0, 100.004, 100.03, 100.030, 109.0, math.nan):
        proposal = control.propose(state, Sample(now, START, 0.0, 0.0, now, 1))
        durations.append(proposal.contact.measurement.dt)
        state = structs.replace(state, previous_at=now)
    assert durations == pytest.approx([0.02, 0.004, 0.026, 0.0, LONGEST_SAMPLES * 0.02, 0.02])


def test_stalled_computer_causes_no_leap() -> None:
    control = loop()
    state, decision = control.step(control.initial(START), Sample(100.0, START, 0.0, 0.0, 99.99, 1))
    before = decision.target.depth
    _, decision = control.step(state, Sample(104.0, START, 0.0, 0.0, 103.99, 2))
    assert decision.target.depth - before == pytest.approx(2.75e-3 * 0.36)


def test_cycle_without_duration_changes_nothing() -> None:
    control = loop()
    state = structs.replace(control.initial(START), previous_at=100.0)
    state = control.finish(state, Reason(Cause.TIME_IS_UP, "enough"))
    state, decision = control.step(state, Sample(100.0, START, 0.0, 0.0, 99.99, 1))
    assert (decision.intent.phase, decision.target.depth, decision.ended) == (Phase.RETRACT, 0.0, False)
    _, decision = control.step(state, Sample(100.18, START, 0.0, 0.0, 100.17, 2))
    assert decision.target.depth == pytest.approx(-2.75e-3 * 0.18)


@pytest.mark.parametrize("name", sorted(CONTROLLERS))
def test_built_in_controllers_are_tuned_for_slow_link(name: str) -> None:
    assert sample_time(make_controller(name)) == 0.18


def test_sample_time_of_config_takes_precedence() -> None:
    assert sample_time(Still(sample_ms=4), 20.0) == 0.02
    assert sample_time(Still(sample_ms=4)) == 0.004

    class Silent:
        name = "silent"

    silent: Any = Silent()
    assert sample_time(silent) == SAMPLE_MS * 1e-3


@pytest.mark.parametrize("wrong", [0.0, -1.0, math.nan, math.inf, "4", True, None])
def test_invalid_sample_time_names_controller(wrong: object) -> None:
    with pytest.raises(ConfigError, match="controller still: its sample_ms"):
        sample_time(Still(sample_ms=wrong))


@pytest.mark.parametrize(
    ("period_s", "sample_ms", "fits"),
    [
        (None, None, True),
        (0.18, None, True),
        (0.09, None, True),
        (0.36, None, True),
        (0.0899, None, False),
        (0.3601, None, False),
        (0.004, None, False),
        (0.004, 4.0, True),
        (0.18, 4.0, False),
    ],
)
def test_period_far_from_sample_time_is_refused(
    period_s: float | None, sample_ms: float | None, fits: bool
) -> None:
    if fits:
        check_period(period_s, Still(), sample_ms)
        return
    with pytest.raises(ConfigError) as refused:
        check_period(period_s, Still(), sample_ms)
    assert period_s is not None
    message = str(refused.value)
    assert f"controller.sample_ms = {period_s * 1e3:g}" in message
    assert f"run.period_ms = {sample_ms or SAMPLE_MS:g}" in message
    assert "\n" not in message


def test_single_step_is_multiple_of_zero_step() -> None:
    assert TaskParameters().single_step_mm == 0.5
    assert TaskParameters(approach_speed_mm_s=0.1).single_step_mm == pytest.approx(0.018)
    assert replace(TaskParameters(), zero_step_mm=0.2).single_step_mm == pytest.approx(0.4)
