"""The control laws, one sample at a time and on the paper's wall."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError

from hil_bridge.control import (
    CONTROLLERS,
    FuzzyAdaptive,
    FuzzyPi,
    Measurement,
    ResolutionAware,
    Surface,
    make_controller,
    scheduled_gain,
)
from hil_bridge.errors import ConfigError

NUMBERS = st.floats(-1e3, 1e3)
ALL = pytest.mark.parametrize("controller", [kind() for kind in CONTROLLERS.values()], ids=list(CONTROLLERS))


def sample(force, position=0.0, commanded=0.0, in_contact=True):
    return Measurement(0.0, force, position, commanded, in_contact)


def learnt(controller, stiffness, force=10.0):
    """State after a pair of samples with this stiffness, ending at `force` and position 1 mm."""
    state, _ = controller.step(controller.initial(), sample(force - stiffness * 1e-3, 0.0), 10.0)
    state, command = controller.step(state, sample(force, 1e-3, 1e-3), 10.0)
    assert command.stiffness == pytest.approx(stiffness)
    return state, command


@ALL
def test_controller_moves_against_the_force_error(controller):
    for force, sign in ((20.0, -1), (0.0, 1)):
        _, command = controller.step(controller.initial(), sample(force, commanded=3e-3), 10.0)
        assert (command.position - 3e-3) * sign > 0
        assert command.correction == pytest.approx(command.position - 3e-3)


def test_fuzzy_output_is_table_times_step_plus_command():
    controller = FuzzyPi()
    state, first = controller.step(controller.initial(), sample(0.0), 50.0)
    assert first.explanation.items() >= {"level_error": -6, "level_change": 0, "level_output": 4}.items()
    assert first.position == pytest.approx(4 * 0.125e-3)
    # −75 % after −100 %: levels −6 and +5 (an edge belongs to the level nearer zero), G = 0.
    _, second = controller.step(state, sample(12.5, commanded=first.position), 50.0)
    assert second.explanation.items() >= {"level_error": -6, "level_change": 5, "level_output": 0}.items()
    assert second.position == first.position


def test_surface_and_scale_are_parameters():
    _, printed = FuzzyPi().step(FuzzyPi().initial(), sample(100.0), 10.0)
    _, computed = FuzzyPi(surface=Surface.RULES).step(FuzzyPi().initial(), sample(100.0), 10.0)
    _, doubled = FuzzyPi(output_step_mm=0.25).step(FuzzyPi().initial(), sample(100.0), 10.0)
    assert (printed.correction, computed.correction) == pytest.approx((-5 * 0.125e-3, -4 * 0.125e-3))
    assert doubled.correction == pytest.approx(2 * printed.correction)


@pytest.mark.parametrize(
    ("stiffness", "gain"), [(9e3, 1.0), (1e4, 1.0), (1.1e4, 0.5), (9.9e4, 0.5), (1e5, 0.5), (1.1e5, 0.25)]
)
def test_scheduled_gain_follows_the_paper(stiffness, gain):
    assert scheduled_gain(stiffness) == gain


def test_adaptive_command_is_equation_5_plus_scaled_correction():
    _, command = learnt(FuzzyAdaptive(), 2e4, force=40.0)
    expected = 1e-3 - (40.0 - 10.0) / 2e4
    assert command.gain == 0.5
    assert command.explanation["level_output"] != 0
    assert command.correction == pytest.approx(0.5 * command.explanation["level_output"] * 0.125e-3)
    assert command.explanation["feedforward_m"] == pytest.approx(expected)
    assert command.position == pytest.approx(expected + command.correction)


def test_resolution_aware_commands_only_feedforward():
    _, command = learnt(ResolutionAware(), 2e4, force=40.0)
    assert command.position == pytest.approx(1e-3 - 30.0 / 2e4)
    assert command.correction == 0.0
    assert not command.held


def test_resolution_aware_holds_within_dead_band():
    controller = ResolutionAware(force_uncertainty_n=0.5)
    state, _ = learnt(controller, 2e4)
    band = 2e4 * 0.125e-3 / 2 + 0.5
    _, inside = controller.step(state, sample(10.0 + 0.99 * band, 1e-3, 1.03e-3), 10.0)
    _, outside = controller.step(state, sample(10.0 + 1.01 * band, 1e-3, 1.03e-3), 10.0)
    assert inside.held
    assert inside.position == 1.03e-3
    assert not outside.held
    assert outside.position < 1e-3


@pytest.mark.parametrize("kind", [FuzzyAdaptive, ResolutionAware])
def test_adaptive_estimate_survives_contact_loss(kind):
    controller = kind()
    state, _ = learnt(controller, 5e3)
    state, command = controller.step(state, sample(0.0, 1e-3, 1e-3, in_contact=False), 10.0)
    assert command.stiffness == pytest.approx(5e3)
    assert "feedforward_m" not in command.explanation
    assert command.position == pytest.approx(1e-3 + command.correction)
    _, command = controller.step(state, sample(2.0, 2e-3, 2e-3), 10.0)
    assert command.stiffness == pytest.approx(5e3)
    assert "feedforward_m" in command.explanation


@pytest.mark.parametrize("kind", [FuzzyAdaptive, ResolutionAware])
def test_feedforward_limit_bounds_move_of_wrong_estimate(kind):
    controller = kind(feedforward_limit_mm=0.5)
    state, _ = learnt(controller, 2000.0, force=6.0)
    _, command = controller.step(state, sample(6.0, 1e-3, 1e-3), 10.0)
    assert command.explanation["feedforward_m"] == pytest.approx(1.5e-3)
    _, command = controller.step(state, sample(14.0, 1e-3, 1e-3), 10.0)
    assert command.explanation["feedforward_m"] == pytest.approx(0.5e-3)


@ALL
@pytest.mark.parametrize("field", ["force", "position"])
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_non_finite_measurement_causes_no_motion(controller, field, value):
    state, _ = controller.step(controller.initial(), sample(2.0), 10.0)
    bad = Measurement(**{"time": 0.0, "force": 1.0, "position": 0.0, "commanded": 7e-3} | {field: value})
    after, command = controller.step(state, bad, 10.0)
    assert after is state
    assert command.position == 7e-3


@ALL
@pytest.mark.parametrize("reference", [0.0, -1.0, math.nan, math.inf])
def test_reference_must_be_above_zero(controller, reference):
    with pytest.raises(ValueError, match="above 0"):
        controller.step(controller.initial(), sample(1.0), reference)


@ALL
@given(samples=st.lists(st.tuples(NUMBERS, NUMBERS, NUMBERS, st.booleans()), max_size=8))
def test_controllers_are_pure_and_finite(controller, samples):
    answers = []
    for _ in range(2):
        state, commands = controller.initial(), []
        for force, position, commanded, touching in samples:
            state, command = controller.step(state, sample(force, position, commanded, touching), 10.0)
            assert math.isfinite(command.position)
            commands.append(command)
        answers.append(commands)
    assert answers[0] == answers[1]


def test_make_controller_by_name_reports_errors():
    assert make_controller("fuzzy", output_step_mm=0.25) == FuzzyPi(output_step_mm=0.25)
    assert all(make_controller(name).name == name for name in CONTROLLERS)
    with pytest.raises(ConfigError, match="choose one of fuzzy, fuzzy-adaptive, resolution-aware"):
        make_controller("clever")
    with pytest.raises(ConfigError, match="resolution_mm must be a number above 0"):
        make_controller("resolution-aware", resolution_mm=0.0)
    with pytest.raises(ConfigError, match="colour"):
        make_controller("fuzzy", colour="red")
    with pytest.raises(ConfigError, match="surface"):
        make_controller("fuzzy", surface="smooth")
    with pytest.raises(ConfigError, match="output_step_mm"):
        make_controller("fuzzy", output_step_mm="wide")


FUZZY = pytest.mark.parametrize("kind", [FuzzyPi, FuzzyAdaptive, ResolutionAware])


@FUZZY
def test_controller_parameters_are_validated_by_pydantic(kind):
    model = TypeAdapter(kind)
    assert model.validate_python({"surface": "rules"}) == kind(surface=Surface.RULES)
    for wrong in ({"surface": "smooth"}, {"output_step_mm": -1}):
        with pytest.raises(ValidationError):
            model.validate_python(wrong)


@pytest.mark.parametrize("kind", CONTROLLERS.values())
def test_unknown_controller_parameter_is_refused(kind):
    model = TypeAdapter(kind)
    assert model.json_schema()["additionalProperties"] is False
    with pytest.raises(ValidationError):
        model.validate_python({"output": 1})
