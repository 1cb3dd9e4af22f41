"""Tests that every force controller must pass, for the author's test module.

    import pytest
    from hil_bridge.testing.controllers import *
    from my_package.control import MyController

    @pytest.fixture
    def controller():
        return MyController()

pytest then finds these tests in that module. They use only the interface `control.types.Controller`. The controller
should have the parameters that a run would use.
"""

import copy
import dataclasses
import itertools
import math
from typing import Any

import msgspec
import pytest
from pydantic import TypeAdapter

from hil_bridge.control.types import Command, Controller, Measurement

__all__ = [
    "test_contact_that_is_lost_is_not_chased_faster",
    "test_finite_measurements_give_finite_answers",
    "test_long_error_does_not_wind_up",
    "test_measurement_that_is_not_a_number_moves_nothing",
    "test_parameter_that_is_not_a_number_is_refused",
    "test_parameters_can_be_read_from_a_configuration",
    "test_same_inputs_give_the_same_answers",
    "test_state_is_not_changed_in_place",
    "test_too_little_force_never_moves_away",
    "test_too_much_force_never_pushes_deeper",
]

Steps = list[tuple[Any, Measurement, float, Any, Command]]
"""Record of the controller's steps: the state, measurement and reference that it received, and the state and
command that it returned.
"""

CYCLE = 0.18
"""Control cycle, s: the cycle of the computer link at 9600 baud."""
REFERENCES = (0.5, 10.0, 200.0)
"""Target forces, N."""
WINDING = 60
"""Number of samples with too little force: about ten seconds."""
_FACTORS = (-1.0, 0.0, 0.01, 0.9, 1.0, 1.1, 3.0, 1000.0)
_DEPTHS = (-0.05, -0.125e-3, 0.0, 0.125e-3, 2e-3, 1.5)


def test_same_inputs_give_the_same_answers(controller: Controller[Any]) -> None:
    for reference in REFERENCES:
        steps = _walk(controller, reference)
        assert steps == _walk(controller, reference), (
            "a second run over the same samples differs from the first: the controller keeps internal state"
        )
        for given, measurement, _, state, command in reversed(steps):
            again = controller.step(given, measurement, reference)
            assert again == (state, command), (
                f"repeated out of order, {measurement} gives another result: the controller keeps internal state"
            )


def test_state_is_not_changed_in_place(controller: Controller[Any]) -> None:
    state = controller.initial()
    for measurement in _grid(10.0):
        before = copy.deepcopy(state)
        after, _ = controller.step(state, measurement, 10.0)
        assert state == before, f"the input state was modified by {measurement}"
        state = after
    assert controller.initial() == controller.initial(), "two initial states differ"


def test_finite_measurements_give_finite_answers(controller: Controller[Any]) -> None:
    for reference in REFERENCES:
        for _, measurement, _, _, command in _walk(controller, reference):
            numbers = [command.position, command.correction, command.gain, *command.explanation.values()]
            if command.stiffness is not None:
                numbers.append(command.stiffness)
            assert all(math.isfinite(number) for number in numbers), f"{measurement} gives {command}"


def test_too_much_force_never_pushes_deeper(controller: Controller[Any]) -> None:
    for reference, factor in itertools.product(REFERENCES, (1.2, 2.0, 10.0)):
        motion = _hold(controller, reference, factor, 1)
        assert factor < 2.0 or motion < 0.0, (
            f"{factor:g} times the target force {reference:g} N causes no motion"
        )


def test_too_little_force_never_moves_away(controller: Controller[Any]) -> None:
    for reference, factor in itertools.product(REFERENCES, (0.8, 0.3, 0.0)):
        motion = _hold(controller, reference, factor, -1)
        assert factor > 0.5 or motion > 0.0, (
            f"{factor:g} times the target force {reference:g} N causes no motion"
        )


def test_contact_that_is_lost_is_not_chased_faster(controller: Controller[Any]) -> None:
    """Without contact, the controller moves at most as fast as in contact at zero force."""
    farthest = {}
    for in_contact in (True, False):
        state, commanded, steps = controller.initial(), 3e-3, [0.0]
        for k in range(20):
            force, touches = (8.0, True) if k < 5 else (0.0, in_contact)
            measurement = Measurement(k * CYCLE, force, commanded, commanded, touches)
            state, command = controller.step(state, measurement, 10.0)
            steps.append(command.position - commanded)
            commanded = command.position
        farthest[in_contact] = max(steps[6:])
    assert farthest[False] <= farthest[True] + 0.01 * abs(farthest[True]) + 1e-9, (
        f"without contact the tool moves by {farthest[False]:g} m per sample, in contact by "
        f"{farthest[True]:g} m"
    )


def test_long_error_does_not_wind_up(controller: Controller[Any]) -> None:
    """After ten seconds of too little force, the controller responds to too much force: it retracts within two
    samples.
    """
    for reference in REFERENCES:
        state, commanded = controller.initial(), 3e-3
        for k in range(WINDING):
            measurement = Measurement(k * CYCLE, 0.3 * reference, commanded, commanded)
            state, command = controller.step(state, measurement, reference)
            commanded = command.position
        before = commanded
        for k in range(WINDING, WINDING + 2):
            measurement = Measurement(k * CYCLE, 2.0 * reference, commanded, commanded)
            state, command = controller.step(state, measurement, reference)
            commanded = command.position
        assert commanded < before, (
            f"the controller winds up: after {WINDING * CYCLE:g} s of too little force, twice the target force "
            f"{reference:g} N moves the tool by {commanded - before:g} m, not away"
        )


@pytest.mark.parametrize("field", ["force", "position"])
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_measurement_that_is_not_a_number_moves_nothing(
    controller: Controller[Any], field: str, value: float
) -> None:
    state = controller.initial()
    for k, force in enumerate((0.0, 4.0, 8.0, 9.0)):
        good = Measurement(k * CYCLE, force, k * 1e-3, 3e-3)
        changed: Any = {field: value}
        bad = msgspec.structs.replace(good, **changed)
        after, command = controller.step(state, bad, 10.0)
        assert command.position == good.commanded, (
            f"the controller responds to an invalid measurement: {field} {value} gives {command}"
        )
        _, undisturbed = controller.step(state, good, 10.0)
        _, behind = controller.step(after, good, 10.0)
        assert undisturbed == behind, f"{field} {value} still affects the next sample"
        state, _ = controller.step(state, good, 10.0)


def test_parameter_that_is_not_a_number_is_refused(controller: Controller[Any]) -> None:
    for name, value in _parameters(controller).items():
        if isinstance(value, float):
            changed = _parameters(controller) | {name: math.nan}
            with pytest.raises(ValueError):  # noqa: PT011 - the words are the controller's own
                type(controller)(**changed)


def test_parameters_can_be_read_from_a_configuration(controller: Controller[Any]) -> None:
    kind: Any = type(controller)
    assert isinstance(kind.name, str), "the class itself must have the name"
    assert TypeAdapter(kind).validate_python(_parameters(controller)) == controller


def _grid(reference: float) -> list[Measurement]:
    """Return samples in time order with all combinations of forces and depths; contact is lost occasionally."""
    combinations = itertools.product(_DEPTHS, _FACTORS)
    return [
        Measurement(k * CYCLE, factor * reference, depth, depth + 0.25e-3, k % 7 != 6)
        for k, (depth, factor) in enumerate(combinations)
    ]


def _walk(controller: Controller[Any], reference: float) -> Steps:
    steps: Steps = []
    state = controller.initial()
    for measurement in _grid(reference):
        after, command = controller.step(state, measurement, reference)
        steps.append((state, measurement, reference, after, command))
        state = after
    return steps


def _hold(controller: Controller[Any], reference: float, factor: float, excess: int) -> float:
    """Return how far the command moves in twenty samples of a steady force, m, and check the direction of every
    step.
    """
    start = commanded = 3e-3
    state = controller.initial()
    for k in range(20):
        measurement = Measurement(k * CYCLE, factor * reference, commanded, commanded)
        state, command = controller.step(state, measurement, reference)
        step = command.position - commanded
        assert step * excess <= 1e-12, (
            f"wrong direction: too {'much' if excess > 0 else 'little'} force, and it moves "
            f"{'deeper' if step > 0.0 else 'away'}. {measurement} for the target {reference:g} N moves by {step:g} m"
        )
        commanded = command.position
    return commanded - start


def _parameters(controller: Controller[Any]) -> dict[str, Any]:
    fields = dataclasses.fields(controller)  # type: ignore[arg-type]
    return {field.name: getattr(controller, field.name) for field in fields if field.init}
