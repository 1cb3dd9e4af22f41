"""Tests that every step of a program must pass, for the author's test module.

    import pytest
    from hil_bridge.testing.steps import *
    from my_package.steps import MyStep

    @pytest.fixture
    def step():
        return MyStep()

pytest then finds these tests in that module. They use only the interface `control.steps.seam.Step`. They pass samples
of a spring under the tool, and random samples from seeds, to the step. No guard is involved.
"""

import copy
import dataclasses
import math
import random
import re
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import pytest
from pydantic import TypeAdapter, ValidationError

from hil_bridge.control.controllers import make_controller
from hil_bridge.control.course.contact_sample import ContactSample
from hil_bridge.control.course.intent import Intent, Phase
from hil_bridge.control.course.limits import Limits
from hil_bridge.control.course.parameters import TaskParameters
from hil_bridge.control.course.stroke import Stroke
from hil_bridge.control.geometry.work_frame import WorkFrame
from hil_bridge.control.program.leg import Row, StepFailed
from hil_bridge.control.program.legs import Ground, legs_of, seconds
from hil_bridge.control.program.program import Program
from hil_bridge.control.program.state import ProgramState
from hil_bridge.control.sample import Sample
from hil_bridge.control.steps.approach import Approach
from hil_bridge.control.steps.led import LedStep
from hil_bridge.control.steps.retract import Retract
from hil_bridge.control.steps.seam import Drawing, Step
from hil_bridge.errors import StepError
from hil_bridge.errors.failures import failure, method_location

__all__ = [
    "test_a_contact_that_is_not_there_ends_in_order",
    "test_a_force_far_off_is_survived",
    "test_a_setting_that_is_not_a_number_is_refused",
    "test_it_describes_itself",
    "test_it_ends_by_its_own_time",
    "test_its_settings_survive_a_recording",
    "test_places_and_forces_stay_in_bounds",
    "test_same_samples_give_the_same_orders",
    "test_the_state_of_a_step_is_not_changed_in_place",
]

CYCLE = 0.18
"""Time between samples, s, which is the cycle of the computer link at 9600 baud."""
SAMPLES = 120
"""Maximum number of random samples of one walk."""
SEEDS = (1, 2, 3)
ROBOT_MM_S = 50.0
"""Path velocity of the robot, mm/s."""
STIFFNESS, SURFACE = 5000.0, 2e-3
"""Stiffness of the spring under the tool, N/m, and depth of its surface, m."""
_DOWN = 0.0, 1.0, 0.0, 0.0
_FRAME = WorkFrame(approach=(0.0, 0.0, -1.0), x=(1.0, 0.0, 0.0), y=(0.0, 1.0, 0.0))
_FORCES = (0.0, 0.3, 2.0, 8.0, 10.0, 12.0, 25.0, 45.0)
_MOMENTS = 0.2, 4.0
"""Smallest and largest magnitude of a random moment, N·m."""
_TURNS = 4, 8
"""Smallest and largest number of samples for which a random moment keeps its sign. A step of 2 s gets both signs."""
_LONGEST_S = 600.0
"""Longest wait of a test for the end of a step, s on the run's clock."""
_COLOUR = re.compile(r"#[0-9a-fA-F]{6}")
_WORD = re.compile(r"[a-z][a-z0-9-]*")


class ToolContact(NamedTuple):
    """Force and position of the tool at one sample."""

    force: tuple[float, float, float]
    """Force along the approach, x and y, N."""
    aside: tuple[float, float] = (0.0, 0.0)
    """Deviation of the reported position from the commanded one, m."""
    moment: tuple[float, float, float] | None = (0.4, -0.3, 0.1)
    """Moment in the tool frame, N·m; None if the sensor reports none."""


ContactModel = Callable[[float], ToolContact]
"""Function that returns the force and position of the tool at its depth, m."""


class StepSample(NamedTuple):
    """One sample of the step, as the program processed it."""

    before: ProgramState
    contact: ContactSample
    after: ProgramState
    intent: Intent


def test_same_samples_give_the_same_orders(step: Step) -> None:
    for seed in SEEDS:
        program, walked = _walk(step, _drawn(seed))
        # a separate variable, because pytest takes a minute to compare two long walks if CI is set
        same = walked == _walk(step, _drawn(seed))[1]
        assert same, (
            "the step reads a clock or random numbers, or keeps internal state: a second run over the same "
            "samples differs from the first"
        )
        for each in reversed(walked):
            same = program.step(each.before, each.contact) == (each.after, each.intent)
            assert same, (
                "the step keeps internal state: repeated out of order, it gives another result for "
                f"{each.contact.sample}"
            )


def test_the_state_of_a_step_is_not_changed_in_place(step: Step) -> None:
    program, walked = _walk(step, _drawn(SEEDS[0]))
    for each in walked:
        before = copy.deepcopy(each.before)
        program.step(before, each.contact)
        assert before == each.before, f"the input state was modified by {each.contact.sample}"
    kept = [copy.deepcopy(each.after.step.memory) for each in walked]
    for each in walked:
        program.step(each.before, each.contact)
    same = kept == [each.after.step.memory for each in walked]
    assert same, "a returned state was modified later"


def test_places_and_forces_stay_in_bounds(step: Step) -> None:
    limits = Limits()
    fastest = limits.travel_mm_s if step.controls else ROBOT_MM_S
    for seed in SEEDS:
        for each in _walk(step, _drawn(seed))[1]:
            target, reference = each.intent.target, each.intent.reference
            place = target.depth, target.travel, target.across
            assert all(map(math.isfinite, place)), f"it moves to {place} m, for {each.contact.sample}"
            deeper = target.depth - each.contact.measurement.commanded
            assert each.intent.phase is not Phase.RETRACT or deeper <= 1e-9, (
                f"it declares an order a retraction that moves {deeper * 1e3:g} mm deeper, for {each.contact.sample}"
            )
            distance = math.dist(each.before.step.at, each.after.step.at)
            assert distance <= fastest * 1e-3 * CYCLE + 1e-9, (
                f"one sample moves the tool {distance * 1e3:g} mm along the surface: faster than {fastest:g} mm/s"
            )
            assert reference is None or 0.0 < reference < limits.force_limit_n, (
                f"it requests a force of {reference} N, for {each.contact.sample}"
            )


def test_a_contact_that_is_not_there_ends_in_order(step: Step) -> None:
    """Without contact, the step or the run ends in an orderly manner; it never fails."""
    _walk(step, lambda depth: ToolContact((0.0, 0.0, 0.0), moment=None))
    _walk(step, lambda depth: ToolContact((-3.0, 0.0, 0.0)))


def test_a_force_far_off_is_survived(step: Step) -> None:
    for force in (1e3, -1e3, 1e6):
        _walk(step, lambda depth, force=force: ToolContact((force, -force, force), (0.05, -0.05), None))  # type: ignore[misc]


def test_it_ends_by_its_own_time(step: Step) -> None:
    """The step ends after `for_s` if this setting has a value; otherwise the step states its approximate duration.
    A led step needs `for_s`.
    """
    assert not (isinstance(step, LedStep) and step.for_s is None), (
        "a led step needs for_s: without it, the step may never end"
    )
    row = _row(step)
    assert sum(seconds(row)) < math.inf
    if step.for_s is None:
        return
    assert 0.0 < step.for_s <= _LONGEST_S, (
        f"for_s is {step.for_s} s; give the test a step of at most {_LONGEST_S:g} s"
    )
    most = round(step.for_s / CYCLE) + 4
    for feel in (_spring, lambda depth: ToolContact((8.0, 0.0, 0.0))):
        _, walked = _walk(step, feel, most)
        assert len(walked) < most, f"it continues after its {step.for_s:g} s"


def test_a_setting_that_is_not_a_number_is_refused(step: Step) -> None:
    settings = _settings(step)
    for field in dataclasses.fields(step):  # type: ignore[arg-type]
        if (
            field.init
            and "float" in str(field.type)
            and isinstance(settings[field.name], (float, type(None)))
        ):
            try:
                type(step)(**settings | {field.name: math.nan})
            except ValueError:
                continue
            pytest.fail(f"the setting {field.name} accepts NaN: it must raise ValueError", pytrace=False)


def test_its_settings_survive_a_recording(step: Step) -> None:
    adapter: TypeAdapter[Any] = TypeAdapter(type(step))
    again = adapter.validate_json(adapter.dump_json(step))
    assert again == step, f"read back from a recording, it is {again}, not {step}"
    encoded = adapter.dump_python(step, mode="json")
    with pytest.raises(ValidationError):
        adapter.validate_python({**encoded, "no_such_setting_mm": 1.0})


def test_it_describes_itself(step: Step) -> None:
    kind = type(step)
    assert _WORD.fullmatch(step.do), (
        f"its word {step.do!r} must consist of lower-case letters, digits and hyphens"
    )
    summary = inspect_doc(kind)
    assert summary, f"{kind.__name__} has no docstring: `hil-bridge list plugins` shows its first line"
    (leg,) = (leg for leg in _row(step).legs if leg.step is step)
    texts = [*step.describe(leg.stroke.parameters)]
    for text in texts:
        assert isinstance(text, str), f"describe returns {text!r}, which is not a text"
        assert [text.strip()] == text.splitlines(), f"describe must return single lines, got {text!r}"
    assert step.drawing is None or isinstance(step.drawing, Drawing)
    for colour in (step.band, *(() if step.drawing is None else (step.drawing.colour,))):
        assert _COLOUR.fullmatch(colour), f"{colour!r} is not a colour such as #d3e9c9"
    assert all(math.isfinite(part) for place in step.sketch_mm for part in place)


def inspect_doc(kind: type) -> str:
    """Return the first line of a class's own docstring; empty for the docstring that dataclasses generate."""
    text = " ".join((vars(kind).get("__doc__") or "").split("\n\n")[0].split())
    return "" if text.startswith(f"{kind.__name__}(") else text


# --- samples


def _drawn(seed: int) -> ContactModel:
    """Return random forces, positions and moments, reproducible by seed.

    The moments of an even seed have the opposite sign to the moments of the preceding odd seed, so that steps begin
    with either sign.
    """
    chance = random.Random(seed)
    pair, even = divmod(seed + 1, 2)
    x, y, z = (_turning(random.Random(f"{pair} {axis}"), -1.0 if even else 1.0) for axis in "xyz")

    def feel(depth: float) -> ToolContact:
        aside = chance.uniform(-20.0, 20.0), chance.uniform(-20.0, 20.0)
        place = chance.gauss(0.0, 2e-4), chance.gauss(0.0, 2e-4)
        moment = next(x), next(y), next(z)
        force = chance.choice(_FORCES)
        return ToolContact((force, *aside), place, moment if chance.random() < 0.8 else None)

    return feel


def _turning(chance: random.Random, sign: float) -> Iterator[float]:
    """Return moments about an axis, N·m: waves of alternating sign, each with a different amplitude and length.

    The moment is zero between two waves.
    """
    sign = chance.choice((-sign, sign))
    while True:
        height, length = chance.uniform(*_MOMENTS), chance.randint(*_TURNS)
        yield 0.0
        for place in range(1, length):
            yield sign * height * math.sin(math.pi * place / length)
        sign = -sign


def _spring(depth: float) -> ToolContact:
    return ToolContact((STIFFNESS * max(depth - SURFACE, 0.0), 0.0, 0.0))


def _settings(step: Step) -> dict[str, Any]:
    return {
        field.name: getattr(step, field.name)
        for field in dataclasses.fields(step)  # type: ignore[arg-type]
        if field.init
    }


def _stroke() -> Stroke:
    # a retract moves back farther than an approach moves by default
    parameters = TaskParameters(approach_depth_limit_mm=40.0)
    return Stroke(parameters, make_controller("predictive"), Limits().force_limit_n)


def _row(step: Step) -> Row:
    """Return a short program with the step at an index where the step is allowed. Fails with the last refusal if
    there is no such index.
    """
    refused = ""
    for steps in _programs(step):
        try:
            return legs_of(steps, Ground(_stroke(), Limits(), ROBOT_MM_S))
        except StepError as error:
            refused = str(error)
    pytest.fail(f"no program can hold it: {refused}", pytrace=False)


def _programs(step: Step) -> Iterator[tuple[Step, ...]]:
    if step.do == "approach":
        yield step, Retract()
    if not step.presses:
        yield step, Approach(), Retract()
        yield Approach(), step
    yield Approach(), step, Retract()


def _walk(step: Step, feel: ContactModel, most: int = SAMPLES) -> tuple[Program, list[StepSample]]:
    """Run the step from its first sample, after the tool has pressed on a spring with the same moments."""
    row, stroke = _row(step), _stroke()
    program = Program(row, stroke, _FRAME)
    own = next(number for number, leg in enumerate(row.legs) if leg.step is step)
    state, depth, place = program.initial(), 0.0, (0.0, 0.0)
    walked: list[StepSample] = []
    for number in range(most + SAMPLES):
        begun, measured = state.course.leg == own and state.course.began is not None, feel(depth)
        if not begun:
            measured = _spring(depth)._replace(moment=measured.moment)
        sample = _sample(number * CYCLE, depth, place, measured)
        before, contact = program.sense(state, sample, (0.0, 0.0, 0.0), depth, CYCLE)
        try:
            state, intent = program.step(before, contact)
        except StepFailed as error:
            raised = error.__cause__ or error
            reason = failure(raised, method_location(step, "steer"))
            pytest.fail(
                f"it fails: {reason}; measured: {measured}, in contact: {before.in_contact}", pytrace=False
            )
        depth, place = intent.target.depth, (intent.target.travel, intent.target.across)
        if state.course.leg == own or begun:
            walked.append(StepSample(before, contact, state, intent))
        if walked and (_is_left(state, own) or len(walked) >= most):
            break
    assert walked, f"the step {step.do} never began"
    return program, walked


def _is_left(state: ProgramState, own: int) -> bool:
    """Return whether the leg with this number has ended, or the run retracts."""
    return state.course.leg != own or state.course.began is None or state.course.reason is not None


def _sample(now: float, depth: float, place: tuple[float, float], contact: ToolContact) -> Sample:
    """Return the sample of a tool that is close to the commanded position."""
    force, x, y = contact.force
    wrench = () if contact.moment is None else (-x, y, -force, *contact.moment)
    at = place[0] + contact.aside[0], place[1] + contact.aside[1]
    return Sample(
        now,
        (*at, -depth),
        force,
        math.hypot(*contact.force),
        now,
        round(now / CYCLE),
        force_travel=x,
        wrench=wrench,
        quaternion=_DOWN,
        force_across=y,
    )
