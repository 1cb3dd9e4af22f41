"""Decision of one cycle, and the handling of a failing controller."""

import math
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace

from hil_bridge.control import (
    Command,
    ControlLoop,
    Limits,
    Measurement,
    Phase,
    Sample,
    Stop,
    Stroke,
    StrokeState,
    Supervisor,
    TaskParameters,
    numeric_explanation,
)
from hil_bridge.control.course.state import Course, StepState
from hil_bridge.control.course.touch import Doubt
from hil_bridge.control.geometry.work_frame import WorkFrame
from hil_bridge.control.program.legs import Ground, legs_of
from hil_bridge.control.program.program import Program
from hil_bridge.control.program.state import ProgramState
from hil_bridge.control.steps.approach import Approach
from hil_bridge.control.steps.paths import Line
from hil_bridge.control.steps.retract import Retract
from hil_bridge.control.steps.seam import StepLimits
from hil_bridge.control.steps.track import Track
from hil_bridge.errors import Cause
from tests.control.plain import ACROSS, ALONG, DOWN, plain_program

START = (0.9, 0.0, 0.6)


@dataclass
class Broken:
    """Controller that works until its step number `after`, then calls the failing function."""

    act: Any
    after: int = 3
    name: str = "broken"

    def initial(self):
        return 0

    def step(self, state, measurement, reference):
        return state + 1, self.act(measurement) if state >= self.after else Command(
            measurement.commanded, 0.0
        )


def give_up(measurement):
    raise ZeroDivisionError("the gain was 0")


def drive(controller, cycles=60, force=8.0, **more):
    """Return the decisions until the end, with contact from a depth of 2.2 mm on."""
    loop = ControlLoop(
        plain_program(TaskParameters(retract_mm=4.0), controller, position_step=0.125e-3),
        Supervisor(Limits()),
    )
    state, position, decisions = loop.initial(START), START, []
    for k in range(cycles):
        now = 100.0 + k * 0.18
        pressed = force if START[2] - position[2] > 2.2e-3 else 0.0
        sample = Sample(now, position, pressed, pressed, now - 0.01, k, **more)
        state, decision = loop.step(state, sample)
        decisions.append(decision)
        position = decision.position
        if decision.ended:
            break
    return state, decisions


def leave(measurement):
    raise SystemExit(7)


@pytest.mark.parametrize(
    ("act", "why"),
    [
        (give_up, "ZeroDivisionError: the gain was 0"),
        (lambda m: Command(math.nan, 0.0), "it commands nan m"),
        (lambda m: Command(math.inf, 0.0), "it commands inf m"),
        (lambda m: Command(m.commanded, math.nan), "it commands"),
        (lambda m: None, "AttributeError"),
        (lambda m: Command("deeper", 0.0), "ValueError"),  # type: ignore[arg-type]
        (lambda m: Command(m.commanded, 0.0, stiffness=1j), "TypeError"),  # type: ignore[arg-type]
        (lambda m: Command(m.commanded, 0.0, gain="more"), "ValueError"),  # type: ignore[arg-type]
        (lambda m: Command(m.commanded, 0.0, explanation=None), "TypeError"),  # type: ignore[arg-type]
        (lambda m: Command(m.commanded, 0.0, explanation="soft"), "ValueError"),  # type: ignore[arg-type]
        (leave, "SystemExit: 7"),
    ],
)
def test_failing_controller_retracts_and_is_named(act, why):
    state, decisions = drive(Broken(act))
    failed = next(i for i, d in enumerate(decisions) if isinstance(d.verdict, Stop))
    verdict = decisions[failed].verdict
    assert verdict.reason.cause is Cause.CONTROLLER
    assert verdict.reason.text.startswith("controller broken failed: ")
    assert why in verdict.reason.text
    # From that very cycle on the tool moves out, to the end, and the cause stays.
    depths = [d.target.depth for d in decisions[failed - 1 :]]
    assert all(after < before for before, after in pairwise(depths[:-1]))
    assert depths[-1] == pytest.approx(depths[0] - 4e-3)
    assert decisions[-1].ended
    assert {d.intent.phase for d in decisions[failed:]} == {Phase.RETRACT}
    assert state.program.course.failed
    assert str(state.program.course.reason) == verdict.reason.text
    assert state.supervisor.stopped == verdict.reason
    assert all(math.isfinite(value) for d in decisions for value in d.position)


def test_command_explanation_may_be_any_object():
    explanation = {"found": True, "level": np.float32(0.5), "inverse": math.inf, "why": "soft", 3: object()}
    _, decisions = drive(Broken(lambda m: Command(m.commanded, 0.0, explanation=explanation)), cycles=20)
    assert not any(isinstance(decision.verdict, Stop) for decision in decisions)


def test_number_like_command_is_converted():
    def act(measurement):
        return Command(Fraction(measurement.commanded), np.float32(0.0), True, np.int64(1), 1, {"level": 2})

    _, decisions = drive(Broken(act), cycles=20)
    assert not any(isinstance(decision.verdict, Stop) for decision in decisions)
    command = decisions[-1].intent.command
    kinds = [type(getattr(command, name)) for name in ("position", "correction", "stiffness", "gain", "held")]
    assert kinds == [float, float, float, float, bool]
    assert type(decisions[-1].target.depth) is float


def test_command_like_object_is_converted():
    class Own(Command, frozen=True):
        """Command of a plug-in with an additional field."""

    _, decisions = drive(Broken(lambda m: Own(m.commanded, 0.0)), cycles=20)
    assert type(decisions[-1].intent.command) is Command


def test_doubt_lasts_until_a_sample_without_it():
    doubts = []
    loop = ControlLoop(plain_program(TaskParameters(), Broken(give_up)), Supervisor(Limits()))
    state = loop.initial(START)
    for k, doubt in enumerate((Doubt.NONE, Doubt.AXIS, Doubt.NONE)):
        state, _ = loop.step(state, Sample(100.0 + k, START, 0.0, 0.0, 99.99 + k, k, doubt=int(doubt)))
        doubts.append(state.program.step.stroke.doubt)
    assert doubts == [Doubt.NONE, Doubt.AXIS, Doubt.NONE]


def test_command_explanation_is_recorded_as_numbers():
    class Nameless:
        def __str__(self):
            raise RuntimeError("no name")

    reported = numeric_explanation(
        {
            "found": True,
            "level": np.float32(0.5),
            "why": "soft",
            "big": 10**400,
            3: object(),
            Nameless(): None,
        }
    )
    assert (reported.pop("found"), reported.pop("level")) == (1.0, 0.5)
    assert list(reported) == ["why", "big", "3", "<Nameless>"]
    assert all(map(math.isnan, reported.values()))


def test_failure_text_is_one_valid_line():
    def act(measurement):
        raise ValueError("half \udc80\nand more")

    state, _ = drive(Broken(act))
    assert str(state.program.course.reason).startswith(
        "controller broken failed: ValueError: half \\udc80 (tests/control/test_loop.py:"
    )
    assert "\n" not in str(state.program.course.reason)


def test_controller_failure_in_first_step_is_handled():
    class Stillborn(Broken):
        def initial(self):
            raise KeyError("tuning")

    for controller in (Broken(give_up, after=0), Stillborn(give_up)):
        state, decisions = drive(controller)
        assert decisions[-1].ended
        assert "controller broken failed" in str(state.program.course.reason)


def test_measurement_has_travel_pair_and_saturation() -> None:
    measurements: list[Measurement] = []

    def note(measurement):
        measurements.append(measurement)
        return Command(measurement.commanded, 0.0)

    drive(Broken(note, after=0), cycles=12, paired_force=3.5)
    assert {m.paired_force for m in measurements} == {3.5}
    # The robot of this test is where it was sent, so it reports the travel commanded before.
    assert [m.travel for m in measurements] == pytest.approx([k * 1e-3 for k in range(len(measurements))])
    assert [m.travel_next - m.travel for m in measurements] == pytest.approx([1e-3] * len(measurements))
    assert measurements[0].free_position == pytest.approx(2e-3)
    assert measurements[0].position == pytest.approx(2.5e-3)


@pytest.mark.parametrize("name", ["force", "position", "commanded", "paired_force"])
def test_measurement_with_nan_is_not_finite(name: str) -> None:
    finite = Measurement(0.0, 1.0, 2.0, 3.0, paired_force=4.0)
    assert finite.is_finite
    assert replace(finite, paired_force=None).is_finite
    assert not replace(finite, **{name: math.nan}).is_finite


class Feels:
    """Rule for the robot's own force that never reports a fault."""

    def disagreed(self, before, after):
        return None

    def fault(self, since, after):
        return ""


def test_each_leg_has_guard_with_its_limits():
    run, speed, witness = Limits(), 0.25, Feels()
    stroke = Stroke(TaskParameters(), Broken(give_up), run.force_limit_n)
    gentle = Track(path=Line(length_mm=20.0), limits=StepLimits(force_limit_n=20.0))
    row = legs_of((Approach(), gentle, Track(path=Line(length_mm=20.0)), Retract()), Ground(stroke, run))
    program = Program(row, stroke, WorkFrame(DOWN, ALONG, ACROSS))
    loop = ControlLoop(program, Supervisor(run, speed, witness))
    assert [guard.limits.force_limit_n for guard in loop.guards] == [50.0, 20.0, 50.0, 50.0]
    assert [(guard.speed, guard.witness) for guard in loop.guards] == [(speed, witness)] * 4
    sample = Sample(100.0, START, 25.0, 25.0, 99.99, 1)
    for leg, stops in ((1, True), (2, False)):
        state = loop.initial(START)
        began = ProgramState(Course(leg, 99.0), StepState(StrokeState(Phase.TRACK, controller=0)))
        _, decision = loop.step(replace(state, program=began), sample)
        assert isinstance(decision.verdict, Stop) is stops


FAR_DOWN = 5e-3
"""Depth of the last order, m."""


def pressing_loop(**parameters):
    """Return a loop and its state in contact while tracking; its controller orders 1 mm more than its last order."""
    program = plain_program(
        TaskParameters(speed_mm_s=0.0, **parameters),
        Broken(lambda m: Command(m.commanded + 1e-3, 1e-3), after=0),
    )
    loop = ControlLoop(program, Supervisor(Limits()))
    state = loop.initial(START)
    stroke = StrokeState(Phase.TRACK, controller=0, in_contact=True)
    ordered = replace(state.supervisor, depth=FAR_DOWN, position=at_depth(FAR_DOWN))
    program_state = ProgramState(Course(leg=1, began=99.0), StepState(stroke))
    return loop, replace(state, supervisor=ordered, program=program_state)


def at_depth(depth):
    x, y, z = START
    return x, y, z - depth


@pytest.mark.parametrize(
    ("newest", "paired", "barrier_mm"), [(40.0, 20.0, 4.5), (20.0, 40.0, 4.1), (20.0, None, 4.5)]
)
def test_barrier_uses_force_at_reported_position(newest, paired, barrier_mm):
    """45 N are predicted on 50 kN/m, from the 4 mm that the robot reports."""
    loop, state = pressing_loop(expected_stiffness_n_m=5e4)
    sample = Sample(100.0, at_depth(4e-3), newest, newest, 99.99, 1, paired_force=paired)
    _, decision = loop.step(state, sample)
    assert decision.verdict.is_for(Cause.BARRIER)
    assert decision.verdict.depth * 1e3 == pytest.approx(barrier_mm)


@pytest.mark.parametrize(
    ("force", "zero", "stops"),
    [(47.0, 0.0, False), (52.0, 5.0, True), (47.0, -5.0, True), (47.0, -2.0, False), (44.0, 5.0, False)],
)
def test_program_zero_hides_no_force(force, zero, stops):
    """The limit of 50 N holds from the zero of the run and from that of the program, here down on the tool."""
    loop, state = pressing_loop()
    course = replace(state.program.course, zero=(0.0, 0.0, -zero, 0.0, 0.0, 0.0))
    state = replace(state, program=replace(state.program, course=course))
    wrench = (0.0, 0.0, -force, 0.0, 0.0, 0.0)
    sample = Sample(
        100.0, at_depth(FAR_DOWN), force, force, 99.99, 1, wrench=wrench, quaternion=(0.0, 1.0, 0.0, 0.0)
    )
    _, decision = loop.step(state, sample)
    assert decision.force == pytest.approx(force - zero)
    assert isinstance(decision.verdict, Stop) is stops
    assert not stops or decision.verdict.reason.cause is Cause.FORCE


@pytest.mark.parametrize(
    ("across", "zero", "stops"), [(105.0, 10.0, True), (95.0, -10.0, True), (95.0, 10.0, False)]
)
def test_program_zero_hides_no_resultant(across, zero, stops):
    """The resultant, limited to 100 N, consists only of a force across the approach."""
    loop, state = pressing_loop()
    course = replace(state.program.course, zero=(zero, 0.0, 0.0, 0.0, 0.0, 0.0))
    state = replace(state, program=replace(state.program, course=course))
    sample = Sample(
        100.0,
        at_depth(FAR_DOWN),
        0.0,
        across,
        99.99,
        1,
        wrench=(across, 0.0, 0.0, 0.0, 0.0, 0.0),
        quaternion=(0.0, 1.0, 0.0, 0.0),
        force_across=across,
    )
    _, decision = loop.step(state, sample)
    assert isinstance(decision.verdict, Stop) is stops
    assert not stops or decision.verdict.reason.cause is Cause.RESULTANT_FORCE
