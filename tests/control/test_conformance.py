"""Conformance suite of controllers: built-in ones pass, and faulty ones fail."""

from dataclasses import dataclass
from typing import Any

import pytest
from pydantic import ValidationError

from hil_bridge.control import CONTROLLERS, Command, make_controller
from hil_bridge.testing import controllers
from hil_bridge.testing.controllers import *  # noqa: F403

OURS: list[tuple[str, dict[str, Any]]] = [(name, {}) for name in CONTROLLERS]
VARIANTS: list[tuple[str, dict[str, Any]]] = [
    ("fuzzy", {"surface": "continuous"}),
    ("fuzzy-adaptive", {"surface": "rules", "feedforward_limit_mm": 1.0}),
    ("resolution-aware", {"feedforward_limit_mm": None}),
    ("pi", {"gain_scheduling": True}),
    ("admittance", {"gain_scheduling": True, "spring_n_m": 100.0}),
]


@pytest.fixture(params=OURS + VARIANTS, ids=lambda p: "-".join([p[0], *p[1]]))
def controller(request):
    name, parameters = request.param
    return make_controller(name, **parameters)


@dataclass(frozen=True)
class Proportional:
    """A correct controller, used as the base of faulty ones."""

    name = "proportional"
    gain: float = 1e-5

    def __post_init__(self):
        if not self.gain > 0:
            raise ValueError("gain")

    def initial(self):
        return {"n": 0}

    def step(self, state, measurement, reference):
        if not measurement.is_finite:
            return state, Command(measurement.commanded, 0.0)
        move = self.gain * (reference - measurement.force)
        return {"n": state["n"] + 1}, Command(measurement.commanded + move, move)


class WrongSign(Proportional):
    def step(self, state, measurement, reference):
        after, command = super().step(state, measurement, reference)
        return after, Command(2 * measurement.commanded - command.position, -command.correction)


class InPlace(Proportional):
    def step(self, state, measurement, reference):
        state["n"] += 1
        return super().step(state, measurement, reference)


class Lazy(Proportional):
    def step(self, state, measurement, reference):
        return state, Command(measurement.commanded, 0.0)


class Trusting(Proportional):
    def step(self, state, measurement, reference):
        move = self.gain * (reference - measurement.force)
        return state, Command(measurement.commanded + move, move)


class Dividing(Proportional):
    def step(self, state, measurement, reference):
        after, command = super().step(state, measurement, reference)
        return after, Command(command.position, 0.0, explanation={"inverse": float("inf")})


class Secretive(Proportional):
    seen = 0

    def step(self, state, measurement, reference):
        type(self).seen += 1
        after, command = super().step(state, measurement, reference)
        return after, Command(command.position, 0.0, explanation={"seen": self.seen})


class Careless(Proportional):
    def __post_init__(self):
        pass


@dataclass(frozen=True)
class Mistyped(Proportional):
    gain: int = 1.5  # type: ignore[assignment]


@pytest.mark.parametrize(
    ("kind", "test"),
    [
        (WrongSign, "test_too_much_force_never_pushes_deeper"),
        (WrongSign, "test_too_little_force_never_moves_away"),
        (Lazy, "test_too_much_force_never_pushes_deeper"),
        (Lazy, "test_too_little_force_never_moves_away"),
        (InPlace, "test_state_is_not_changed_in_place"),
        (Secretive, "test_same_inputs_give_the_same_answers"),
        (Dividing, "test_finite_measurements_give_finite_answers"),
        (Careless, "test_parameter_that_is_not_a_number_is_refused"),
        (Mistyped, "test_parameters_can_be_read_from_a_configuration"),
    ],
)
def test_suite_faulty_controller_fails(kind, test):
    with pytest.raises((AssertionError, pytest.fail.Exception, ValidationError)):
        getattr(controllers, test)(kind())


def test_suite_controller_without_input_checks_fails():
    with pytest.raises(AssertionError, match="force nan"):
        controllers.test_measurement_that_is_not_a_number_moves_nothing(Trusting(), "force", float("nan"))


def test_suite_contains_every_test():
    assert set(controllers.__all__) == {name for name in dir(controllers) if name.startswith("test_")}


def test_suite_retreating_controller_passes_chasing_test():
    controllers.test_contact_that_is_lost_is_not_chased_faster(WrongSign())
