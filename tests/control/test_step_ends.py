"""Transitions between steps: doubtful touches, directions, limits, and the reported step name."""

import itertools
import math
from dataclasses import dataclass
from typing import Any

import pytest

from hil_bridge.control import (
    Clamp,
    Command,
    Decision,
    Limits,
    Measurement,
    Phase,
    Request,
    Stop,
    Stroke,
    Supervisor,
    TaskParameters,
)
from hil_bridge.control.course.touch import Doubt
from hil_bridge.control.decision import LoopState
from hil_bridge.control.steps.approach import Approach
from hil_bridge.control.steps.hold import Hold
from hil_bridge.control.steps.led import Lead, LedStep, StepSample
from hil_bridge.control.steps.move import Move
from hil_bridge.control.steps.paths import Line
from hil_bridge.control.steps.retract import Retract
from hil_bridge.control.steps.seam import NO_LIMITS, StepLimits
from hil_bridge.control.steps.seek import Seek
from hil_bridge.control.steps.track import Track
from hil_bridge.errors import Cause
from protocol.geometry import Vector
from tests.control.plain import DOWN, guarded, walk
from tests.control.test_program_course import Presses
from tests.observed import observation, observed

STIFFNESS = 5e3
GROUND = 2e-3
"""Depth of the surface, m."""


@dataclass(frozen=True, slots=True)
class Waits(LedStep):
    """Step that presses for a time."""

    for_s: float
    do: str = "waits"
    limits: StepLimits = NO_LIMITS

    def steer(self, memory: None, sample: StepSample) -> tuple[None, Lead]:
        return None, Lead((0.0, 0.0))


class Careful(Presses):
    """Step that moves no more than 0.2 mm per sample."""

    def step(self, state: Any, measurement: Measurement, reference: float) -> tuple[Any, Command]:
        correction = max(min((reference - measurement.force) / 20e3, 0.2e-3), -0.2e-3)
        return state, Command(measurement.commanded + correction, correction, STIFFNESS)


def stroke_of(controller: Any = None, **more: Any) -> Stroke:
    return Stroke(TaskParameters(retract_mm=4.0, **more), controller or Careful(), 50.0)


def press(position: Vector) -> float:
    return STIFFNESS * max(position[0] - GROUND, 0.0)


def stop_of(decisions: list[Decision]) -> Stop:
    return next(each.verdict for each in decisions if isinstance(each.verdict, Stop))


# --- a touch in doubt


@pytest.mark.parametrize("kind", [Hold, Waits])
@pytest.mark.parametrize("first_s", [0.2, 0.5, 1.0, 2.0])
def test_doubtful_touch_survives_end_of_step(kind: type[Hold] | type[Waits], first_s: float) -> None:
    """The sensor dies in the first step and reports 2 N, the missing weight. The test of the touch ends the run."""
    deepest = 0.0

    def respond(state: LoopState, time: float, position: Vector) -> dict[str, Any]:
        nonlocal deepest
        deepest = max(deepest, press(position))
        if state.program.course.leg == 0:
            return {"force": press(position)}
        jitter = 3e-3 * (round(time / 0.012) % 2)
        return {"force": 2.0 + jitter, "doubt": int(Doubt.WEIGHT)}

    steps = (Approach(), kind(for_s=first_s), Hold(for_s=4.0), Retract())
    reason = walk(guarded(steps, stroke_of(), Limits()), respond)[-1].intent.reason
    assert reason is not None
    assert reason.cause is Cause.UNANSWERED_TOUCH
    assert deepest < 15.0


def test_unconfirmed_touch_is_tested_in_next_step() -> None:
    """The axis is unverified: the surface falls, and from then on the sensor reports a tenth of the force."""
    deepest = 0.0

    def respond(state: LoopState, time: float, position: Vector) -> dict[str, Any]:
        nonlocal deepest
        fell = time > 2.0
        true = STIFFNESS * max(position[0] - GROUND - 4e-3 * fell, 0.0)
        deepest = max(deepest, true)
        return {"force": true * (0.1 if fell else 1.0), "doubt": int(Doubt.AXIS)}

    stroke = stroke_of(loss_ms=100.0, search_depth_limit_mm=8.0)
    for first_s in (1.0, 1.5, 6.0):
        deepest = 0.0
        steps = (Approach(), Hold(for_s=first_s), Hold(for_s=8.0), Retract())
        reason = walk(guarded(steps, stroke, Limits()), respond)[-1].intent.reason
        assert reason is not None
        assert reason.cause is Cause.UNANSWERED_TOUCH, first_s
        assert deepest < 30.0


def test_approach_ends_if_force_dips_at_confirmation() -> None:
    """The axis is unverified, and the tool bounces at the sample after the confirmation."""
    dips = 0

    def respond(state: LoopState, time: float, position: Vector) -> dict[str, Any]:
        nonlocal dips
        touch, force = state.program.step.stroke.touch, press(position)
        if touch is not None and touch.proven:
            dips, force = dips + 1, 0.8
        return {"force": force, "doubt": int(Doubt.AXIS)}

    decisions = walk(guarded((Approach(), Retract()), stroke_of(), Limits()), respond)
    assert dips == 1
    assert not any(isinstance(each.verdict, Stop) for each in decisions)


def test_unconfirmed_touch_is_not_a_missing_edge() -> None:
    def respond(state: LoopState, time: float, position: Vector) -> dict[str, Any]:
        if state.program.course.leg == 0:
            return {"force": press(position)}
        return {"force": 2.0 + 3e-3 * (round(time / 0.012) % 2), "doubt": int(Doubt.WEIGHT)}

    steps = (Approach(), Seek(direction_deg=0.0, until="edge", at_most_mm=50.0), Retract())
    reason = walk(guarded(steps, stroke_of(), Limits()), respond)[-1].intent.reason
    assert reason is not None
    assert (reason.cause, reason.step) == (Cause.UNANSWERED_TOUCH, "2 (seek)")


@pytest.mark.parametrize("offset", [0.0, -0.05, -0.3, 0.3])
def test_force_spike_does_not_block_retraction(offset: float) -> None:
    """60 N for three samples of a tool that is free. The force before and after them is about 0, or a little below."""
    spiked = 0

    def respond(state: LoopState, time: float, position: Vector) -> dict[str, Any]:
        nonlocal spiked
        free = state.program.phase is Phase.RETRACT and position[0] < 1e-3
        spiked += free
        return {"force": press(position) + offset + (60.0 if free and spiked <= 3 else 0.0)}

    decisions = walk(guarded((Approach(), Hold(for_s=0.5), Retract()), stroke_of(), Limits()), respond)
    assert decisions[-1].intent.reason is None
    assert any(each.verdict.holds for each in decisions if isinstance(each.verdict, Clamp))


# --- travel and limits


@pytest.mark.parametrize("end", [{"for_s": 2.0, "length_mm": 50.0}, {"length_mm": 8.0}])
def test_step_direction_applies_from_first_sample(end: dict[str, float]) -> None:
    """30 N act against the first track, which allows them. The second moves away from them."""
    length = end["length_mm"]
    there = Track(path=Line(length_mm=length), speed_mm_s=4.0, lateral_limit_n=60.0, for_s=end.get("for_s"))
    back = Track(path=Line(length_mm=4.0, direction_deg=180.0), speed_mm_s=4.0)

    def respond(state: LoopState, time: float, position: Vector) -> dict[str, Any]:
        return {"force": press(position), "force_travel": 30.0 if state.program.course.leg in (1, 2) else 0.0}

    decisions = walk(guarded((Approach(), there, back, Retract()), stroke_of(), Limits()), respond)
    assert decisions[-1].intent.reason is None
    assert not any(isinstance(each.verdict, Stop) for each in decisions)


@pytest.mark.parametrize("end", [{"for_s": 2.0, "length_mm": 50.0}, {"length_mm": 8.0}])
def test_step_against_force_stops_in_first_sample(end: dict[str, float]) -> None:
    length = end["length_mm"]
    there = Track(path=Line(length_mm=length), speed_mm_s=4.0, for_s=end.get("for_s"))
    back = Track(path=Line(length_mm=4.0, direction_deg=180.0), speed_mm_s=4.0)
    decisions = walk(
        guarded((Approach(), there, back, Retract()), stroke_of(), Limits()),
        lambda state, time, position: {
            "force": press(position),
            "force_travel": -40.0 * (state.program.course.leg in (1, 2)),
        },
    )
    stop = stop_of(decisions)
    number = next(i for i, each in enumerate(decisions) if each.verdict is stop)
    reason = decisions[number].intent.reason
    assert reason is not None
    assert (reason.cause, reason.step) == (Cause.WALL, "3 (track)")
    assert all(each.intent.leg < 2 for each in decisions[:number])


def test_seek_edge_needs_contact_in_same_step() -> None:
    """Contact is lost before the step begins and returns 4 mm deeper; the edge is where that surface ends."""

    def respond(state: LoopState, time: float, position: Vector) -> dict[str, Any]:
        ground = GROUND + 4e-3 * (time > 2.0) + 99.0 * (position[1] > 6e-3)
        return {"force": STIFFNESS * max(position[0] - ground, 0.0)}

    steps = (Approach(), Hold(for_s=1.5), Seek(direction_deg=0.0, until="edge", at_most_mm=20.0), Retract())
    loop = guarded(steps, stroke_of(loss_ms=100.0, search_depth_limit_mm=8.0), Limits())
    decisions = walk(loop, respond)
    assert decisions[-1].intent.reason is None
    sought = [each.intent.target.travel for each in decisions if each.intent.leg == 2]
    assert sought[-1] == pytest.approx(6e-3, abs=1e-3)


# --- a force that is not a number


@pytest.mark.parametrize("name", ["force", "force_travel"])
@pytest.mark.parametrize("samples", [1, 10_000])
def test_retraction_with_nan_force_continues_slowly(name: str, samples: int) -> None:
    """One sample, or all from there on. The run continues if the force is known again, else it ends by that cause."""
    left = samples

    def respond(state: LoopState, time: float, position: Vector) -> dict[str, Any]:
        nonlocal left
        began = state.program.course.leg >= 1 and state.program.course.began is not None
        if not left or (left == samples and not began):
            return {"force": press(position)}
        left -= 1
        return {"force": press(position), name: math.nan}

    row = (Approach(), Retract(back_mm=2.0), Move(to_mm=(5.0, 0.0)), Approach(), Retract())
    decisions = walk(guarded(row, stroke_of(), Limits()), respond, 6000)
    assert all(math.isfinite(part) for each in decisions for part in each.position)
    reason = decisions[-1].intent.reason
    if samples == 1:
        assert reason is None
    else:
        assert reason is not None
        assert reason.cause is Cause.FORCE_NOT_A_NUMBER
        first = [each.target.depth for each in decisions if each.intent.leg == 1]
        assert first[-1] <= GROUND - 2e-3 + 1e-9


def test_lost_contact_is_searched_in_next_step() -> None:
    """Also with a reliable sensor: the next step does not start in the state of contact."""
    decisions = walk(
        guarded(
            (Approach(), Hold(for_s=1.5), Hold(for_s=3.0), Retract()),
            stroke_of(loss_ms=100.0, search_depth_limit_mm=8.0),
            Limits(pull_limit_n=30.0),  # a contact 4 mm deeper at the same position looks like a false zero
        ),
        lambda state, time, position: {
            "force": STIFFNESS * max(position[0] - GROUND - 4e-3 * (time > 2.0), 0.0)
        },
    )
    second = [each.intent for each in decisions if each.intent.leg == 2]
    assert second[0].phase is Phase.APPROACH
    assert second[-1].phase is Phase.TRACK
    assert decisions[-1].intent.reason is None


def test_first_sample_of_step_has_its_own_travel() -> None:
    """10 mm along x, then 10 mm along y: the travel continues."""
    travels: list[float] = []

    class Notes(Careful):
        def step(self, state: Any, measurement: Measurement, reference: float) -> tuple[Any, Command]:
            travels.append(measurement.travel)
            return Careful.step(self, state, measurement, reference)

    legs = [Track(path=Line(length_mm=10.0, direction_deg=angle), speed_mm_s=4.0) for angle in (0.0, 90.0)]
    walk(
        guarded((Approach(), *legs, Retract()), stroke_of(Notes()), Limits()),
        lambda s, t, position: {"force": press(position)},
    )
    steps = [after - before for before, after in itertools.pairwise(travels)]
    assert travels[-1] == pytest.approx(20e-3, abs=0.2e-3)
    assert min(steps) >= -1e-9
    assert max(steps) < 0.06e-3


def test_limit_of_next_step_names_that_step() -> None:
    gentle = Hold(for_s=3.0, force_n=5.0, limits=StepLimits(force_limit_n=8.0))
    decisions = walk(
        guarded((Approach(), Hold(for_s=2.0), gentle, Retract()), stroke_of(), Limits()),
        lambda state, time, position: {"force": press(position)},
    )
    reason = decisions[-1].intent.reason
    assert reason is not None
    assert (reason.cause, reason.step) == (Cause.FORCE, "3 (hold)")


# --- clamps that hold no approach


@pytest.mark.parametrize("overdue", [0.0, 0.02])
def test_turn_limit_does_not_hold_depth(overdue: float) -> None:
    """A turn of 10° is requested and 1° allowed. A late force holds the depth until it arrives."""
    supervisor = Supervisor(Limits(turn_total_deg=1.0))
    half = math.radians(5.0)
    request = Request(1e-3, (0.0, 0.0, -1e-3), DOWN, quaternion=(math.sin(half), math.cos(half), 0.0, 0.0))
    sample = observed(observation(1.0, sensor_at=99.99), quaternion=(0.0, 1.0, 0.0, 0.0), overdue=overdue)
    state, verdict = supervisor.initial((0.0, 0.0, 0.0)), None
    for number in range(20):
        state, verdict = supervisor.step(state, observed(sample, sensor_sequence=number), request)
    assert isinstance(verdict, Clamp)
    assert verdict.is_for(Cause.TIP)
    assert verdict.is_for(Cause.OVERDUE) is bool(overdue)
    assert verdict.depth == (0.0 if overdue else 1e-3)
    assert verdict.goes_on


# --- controllers


@pytest.mark.parametrize("stiffness", [math.inf, math.nan, 1e308, -1e308])
def test_invalid_stiffness_is_controller_failure(stiffness: float) -> None:
    class Learns(Careful):
        def step(self, state: Any, measurement: Measurement, reference: float) -> tuple[Any, Command]:
            _, command = Careful.step(self, state, measurement, reference)
            return state, Command(command.position, command.correction, stiffness)

    decisions = walk(
        guarded((Approach(), Hold(for_s=1.0), Retract()), stroke_of(Learns()), Limits()),
        lambda state, time, position: {"force": press(position)},
    )
    stop = stop_of(decisions)
    assert stop.reason.cause is Cause.CONTROLLER
    assert f"reports a stiffness of {stiffness} N/m" in stop.reason.text


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_nan_across_the_path_is_controller_failure(value: float) -> None:
    class Aside(Careful):
        def step(self, state: Any, measurement: Measurement, reference: float) -> tuple[Any, Command]:
            if reference == 3.0:
                return state, Command(value, 0.0)
            return Careful.step(self, state, measurement, reference)

    track = Track(path=Line(length_mm=10.0), speed_mm_s=2.0, across="force", across_n=3.0)
    decisions = walk(
        guarded((Approach(), track, Retract()), stroke_of(Aside()), Limits()),
        lambda state, time, position: {"force": press(position), "force_across": 3.0},
    )
    stop = stop_of(decisions)
    assert stop.reason.cause is Cause.CONTROLLER
    assert f"it commands {value} m across the path" in stop.reason.text
    assert all(math.isfinite(part) for each in decisions for part in each.position)


@pytest.mark.parametrize("force", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("name", ["force_travel", "force_across"])
@pytest.mark.parametrize("across", ["position", "compliant", "force"])
def test_nan_side_force_orders_finite_position(name: str, force: float, across: Any) -> None:
    track = Track(
        path=Line(length_mm=10.0, direction_deg=40.0),
        speed_mm_s=2.0,
        across=across,
        across_n=3.0 * (across == "force"),
    )

    def respond(state: LoopState, time: float, position: Vector) -> dict[str, Any]:
        bad = {name: force} if state.program.phase is Phase.TRACK and time > 2.0 else {}
        return {"force": press(position), **bad}

    decisions = walk(guarded((Approach(), track, Retract()), stroke_of(), Limits()), respond)
    assert all(math.isfinite(part) for each in decisions for part in each.position)
    assert stop_of(decisions).reason.cause is Cause.FORCE_NOT_A_NUMBER
