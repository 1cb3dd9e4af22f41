"""First touch: the controller approaches slowly, and a stop orders nothing deeper."""

import math
from typing import Any

import pytest
from msgspec.structs import replace

from hil_bridge.control import (
    Command,
    ControlLoop,
    Measurement,
    Phase,
    Predictive,
    Sample,
    Stroke,
    StrokeState,
    Supervisor,
    TaskParameters,
)
from hil_bridge.control.course.limits import Limits
from hil_bridge.control.course.stroke import Order, Stride
from hil_bridge.control.steps.approach import Approach
from hil_bridge.control.steps.hold import Hold
from hil_bridge.control.steps.retract import Retract
from hil_bridge.control.steps.seam import StepResult
from hil_bridge.control.steps.seek import Seek
from hil_bridge.errors import Cause, Reason
from tests.control.plain import plain_program, sense
from tests.control.test_program_course import contact_at, program_of

FORCE = 10.0
DT = 0.004
LANDING = 0.1
"""`landing_ms` of a robot that streams, s."""


class Digs:
    """Step that orders a tenth of a millimetre deeper in every sample."""

    name = "digs"

    def initial(self) -> int:
        return 0

    def step(self, state: int, measurement: Measurement, reference: float) -> tuple[int, Command]:
        return state, Command(measurement.commanded + 1e-4, 1e-4)


class Rests:
    """Controller that stays in its dead band."""

    name = "rests"

    def initial(self) -> int:
        return 0

    def step(self, state: int, measurement: Measurement, reference: float) -> tuple[int, Command]:
        return state, Command(measurement.commanded, 0.0, held=True)


def pressed(force: float, position: float = 0.0, dt: float = DT, **more: Any) -> Measurement:
    return Measurement(0.0, force, position, more.pop("commanded", position), dt=dt, **more)


# --- the controller closes in slowly


def known(stiffness: float, landing_ms: float = 1e3 * LANDING) -> tuple[Predictive, Any]:
    """Controller that has received two samples of a touch, and has an estimate."""
    controller = Predictive(landing_ms=landing_ms, resolution_mm=0.01)
    state, _ = controller.step(controller.initial(), pressed(2.0, 0.0), FORCE)
    state, command = controller.step(state, pressed(4.0, 2.0 / stiffness), FORCE)
    assert command.stiffness == pytest.approx(stiffness, rel=0.1)
    return controller, state


def share(controller: Predictive, state: Any, measurement: Measurement) -> float:
    """Return the fraction of the full inward correction that one sample makes."""
    full = controller.step(replace(state, landing=math.inf), measurement, FORCE)[1].correction
    return controller.step(state, measurement, FORCE)[1].correction / full


@pytest.mark.parametrize("landing_ms", [10.0, 100.0, 1000.0])
@pytest.mark.parametrize("dt", [0.0, 0.002, 0.004, 0.012, 0.05, 0.179])
def test_first_touch_sample_moves_its_share(dt: float, landing_ms: float) -> None:
    exact = min(1.0, dt / (landing_ms * 1e-3))
    controller, state = known(5e3, landing_ms)
    assert share(controller, state, pressed(4.0, 0.4e-3, dt)) == pytest.approx(exact)
    probing = Predictive(landing_ms=landing_ms)
    assert share(probing, probing.initial(), pressed(2.0, 0.0, dt)) == pytest.approx(exact)


def test_first_touch_outward_move_is_complete() -> None:
    controller, state = known(5e3)
    assert share(controller, state, pressed(14.0, 2.4e-3)) == 1.0


def test_first_touch_ends_near_desired_force() -> None:
    controller, state = known(5e3)
    far, _ = controller.step(state, pressed(9.6, 1.52e-3), FORCE)
    assert math.isfinite(far.landing)
    near, _ = controller.step(state, pressed(9.8, 1.56e-3), FORCE)
    assert near.landing == math.inf
    assert share(controller, near, pressed(4.0, 1.56e-3)) == 1.0


@pytest.mark.parametrize("estimated", [True, False])
def test_first_touch_ends_after_three_landing_times(estimated: bool) -> None:
    controller, state = known(5e3)
    if not estimated:  # a surface that hardly answers is not followed late either
        state = controller.initial()
    measurement = pressed(4.0, 0.4e-3, dt=0.007)
    for left in range(math.floor((3 * LANDING - state.landing) / 0.007), 0, -1):
        assert share(controller, state, measurement) == pytest.approx(0.07), left
        state, _ = controller.step(state, measurement, FORCE)
    assert share(controller, state, measurement) == 1.0


def test_first_touch_does_not_restart_after_contact_loss() -> None:
    controller, state = known(5e3)
    before = state.landing
    for _ in range(1000):
        state, _ = controller.step(state, pressed(0.0, 0.0, in_contact=False), FORCE)
    assert state.landing == before
    landed = replace(state, landing=math.inf)
    landed, _ = controller.step(landed, pressed(0.0, 0.0, in_contact=False), FORCE)
    landed, _ = controller.step(landed, pressed(2.0, 0.0), FORCE)
    assert landed.landing == math.inf


def test_first_touch_lower_desired_force_ends_at_once() -> None:
    controller, state = known(5e3)
    state, _ = controller.step(state, pressed(4.0, 0.4e-3), 4.1)
    assert state.landing == math.inf


def test_streamed_robot_has_slow_landing() -> None:
    landings = {tuning.sample_ms: tuning.parameters["landing_ms"] for tuning in Predictive.tunings}
    assert landings == {2.0: 1e3 * LANDING, 4.0: 1e3 * LANDING, 12.0: 1e3 * LANDING}
    assert share(Predictive(), Predictive().initial(), pressed(2.0)) == 1.0, (
        "without tuning, the correction is complete"
    )


# --- the approach


@pytest.mark.parametrize(("step", "share"), [(None, 0.6), (1e-4, 1.0)])
def test_approach_order_lead_respects_allowed_force(step: float | None, share: float) -> None:
    """The tool is stationary: the order leads by at most that fraction of 10 N on 10 kN/m, in complete steps."""
    task = TaskParameters(expected_stiffness_n_m=1e4, approach_speed_mm_s=50.0, approach_depth_limit_mm=50.0)
    stroke, state, commanded = Stroke(task, Rests(), position_step=step), StrokeState(), 0.0
    leads = []
    for _ in range(12):
        state, order = stroke.step(state, pressed(0.0, 0.0, commanded=commanded))
        leads.append(order.depth - commanded)
        commanded = order.depth
    slowest = 0.2e-3 * DT
    quick = [lead for lead in leads if lead > 2 * slowest]
    assert sum(quick) == pytest.approx(share * 1e-3, abs=2 * slowest)
    assert leads[-1] == pytest.approx(slowest)


# --- the travel begins


def test_travel_starts_when_controller_is_in_dead_band() -> None:
    stroke = Stroke(TaskParameters(travel_from_share=0.9), Rests())
    state, travels = StrokeState(phase=Phase.TRACK, in_contact=True, controller=0), []
    for _ in range(3):
        before = state.travel
        state, _ = stroke.step(state, pressed(8.0), Stride(FORCE))
        travels.append(state.travel - before)
    assert travels[0] == 0.0
    assert travels[1] > 0.0


# --- after a stop nothing goes deeper


def test_last_contact_loss_does_not_order_deeper() -> None:
    stroke = Stroke(TaskParameters(loss_limit=1), Digs())
    state = StrokeState(phase=Phase.TRACK, in_contact=True, controller=0)
    state, order = stroke.step(state, pressed(0.0, 1e-3))
    assert state.trouble == Reason(Cause.CONTACT_LOST, "contact lost 1 times")
    assert order.phase is Phase.RETRACT
    assert order.depth < 1e-3


def test_loop_does_not_advance_after_last_contact_loss() -> None:
    program = plain_program(TaskParameters(loss_limit=1, speed_mm_s=0.0), Digs())
    loop = ControlLoop(program, Supervisor(Limits()), sample_time=0.02)
    state, reported, depth = loop.initial((0.0, 0.0, 0.0)), None, 0.0
    for k in range(40):
        force = 10.0 if k < 20 else 0.0
        sample = Sample(0.02 * k, (0.0, 0.0, -depth), force, force, 0.02 * k, k)
        state, decision = loop.step(state, sample)
        if decision.intent.reason is not None:
            reported = reported or decision.intent.reason.cause
            assert decision.depth <= state.start[2] + depth + 1e-12
            assert decision.target.depth <= depth + 1e-12, k
        depth = decision.target.depth
    assert reported is Cause.CONTACT_LOST


@pytest.mark.parametrize("phase", [Phase.TRACK, Phase.APPROACH])
def test_failed_step_does_not_order_deeper(phase: Phase, monkeypatch: pytest.MonkeyPatch) -> None:
    program = program_of(Approach(), Hold(for_s=1.0), Retract())
    reason = Reason(Cause.STEP_TROUBLE, "it says so")

    def take(step: Any, context: Any, state: Any) -> StepResult:
        return StepResult(state, Order(phase, 2e-3), trouble=reason)

    monkeypatch.setattr(Approach, "take", take)
    contact = contact_at(0.0, (0.0, 0.0), 1e-3, (0.0, 0.0, 0.0))
    state, intent = program.step(*sense(program, program.initial(), contact))
    assert state.course.failed
    assert intent.target.depth == 1e-3


@pytest.mark.parametrize(("commanded", "ordered"), [(1e-3, 1e-3), (3e-3, 2e-3)])
def test_failed_step_is_held_at_commanded_depth(
    commanded: float, ordered: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The robot reports 1.5 mm and the step orders 2 mm; neither is the commanded depth."""
    program = program_of(Approach(), Hold(for_s=1.0), Retract())
    reason = Reason(Cause.STEP_TROUBLE, "it says so")

    def take(step: Any, context: Any, state: Any) -> StepResult:
        return StepResult(state, Order(Phase.TRACK, 2e-3), trouble=reason)

    monkeypatch.setattr(Approach, "take", take)
    contact = contact_at(0.0, (0.0, 0.0), 1.5e-3, (0.0, 0.0, 0.0))
    contact = replace(contact, measurement=replace(contact.measurement, commanded=commanded))
    _, intent = program.step(*sense(program, program.initial(), contact))
    assert intent.target.depth == ordered


def test_missing_edge_does_not_order_deeper() -> None:
    program = program_of(Approach(), Seek(direction_deg=0.0, until="edge", at_most_mm=1.0), Retract())
    state, depth = program.initial(), 0.0
    for k in range(200):
        contact = contact_at(0.1 * k, state.step.at, depth, (8.0 if depth > 1e-3 else 0.0, 0.0, 0.0))
        state, intent = program.step(*sense(program, state, contact))
        if state.course.failed:
            break
        depth = intent.target.depth
    assert state.course.reason is not None
    assert state.course.reason.cause is Cause.NO_EDGE
    assert intent.target.depth <= depth
