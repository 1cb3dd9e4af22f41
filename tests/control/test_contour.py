"""The estimated normal of a contour: exact geometry in, the angle and the normal force out."""

import math

import pytest

from hil_bridge.control import Contour, ContourState, normal_force


def reaction(angle: float, normal: float, friction: float) -> tuple[float, float]:
    """Reaction along approach and travel of a surface at `angle` that is pressed with `normal` N."""
    sine, cosine = math.sin(angle), math.cos(angle)
    return (
        normal * cosine + friction * normal * sine,
        -normal * sine + friction * normal * cosine,
    )


def walk(slopes: list[float], normal: float = 10.0, friction: float = 0.3) -> list[ContourState]:
    """A millimetre of travel a sample over a surface of these slopes, pressed with a constant normal force."""
    state, depth, states = ContourState(), 0.0, []
    for k, slope in enumerate(slopes):
        state = Contour().step(state, k * 1e-3, depth, *reaction(math.atan(slope), normal, friction))
        depth += slope * 1e-3
        states.append(state)
    return states


@pytest.mark.parametrize("slope", [-0.5, -0.1, 0.0, 0.2, 0.6])
@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_on_a_slope_normal_and_friction_are_found(slope: float, friction: float) -> None:
    state = walk([slope] * 40, friction=friction)[-1]
    assert state.angle == pytest.approx(math.atan(slope), abs=1e-6)
    assert state.friction_angle == pytest.approx(math.atan(friction), abs=1e-6)
    assert normal_force(state.angle, *reaction(math.atan(slope), 10.0, friction)) == pytest.approx(10.0)


def test_on_a_wave_the_normal_is_followed_without_the_paths_lag() -> None:
    slopes = [0.314 * math.cos(2 * math.pi * k / 200) for k in range(400)]
    states = walk(slopes)[60:]
    errors = [abs(state.angle - math.atan(slope)) for state, slope in zip(states, slopes[60:], strict=True)]
    assert max(errors) < math.radians(1.0)
    # A line through the path alone lags by half its window of 6 mm.
    assert 3 * 0.314 * 2 * math.pi / 200 > math.radians(1.0)


def test_before_there_is_a_path_the_approach_direction_is_the_normal() -> None:
    states = walk([0.4] * 3)
    assert [state.angle for state in states] == [0.0, 0.0, 0.0]
    assert normal_force(0.0, 7.0, 2.0) == 7.0


@pytest.mark.parametrize(
    "sample", [(0.04, 0.0, math.nan, 0.0), (0.04, math.inf, 1.0, 0.0), (0.04, 0.0, -1.0, 5.0)]
)
def test_what_is_no_contact_or_no_number_is_left_out(sample: tuple[float, float, float, float]) -> None:
    state = walk([0.2] * 40)[-1]
    assert Contour().step(state, *sample) == state


def test_standing_and_going_back_keep_the_points_ascending() -> None:
    state = walk([0.2] * 40)[-1]
    for _ in range(100):
        state = Contour().step(state, 0.039, 0.0078, *reaction(math.atan(0.2), 10.0, 0.3))
    assert len(state.points) <= 7
    assert state.angle == pytest.approx(math.atan(0.2), abs=1e-3)


def test_no_normal_beyond_the_steepest_is_believed() -> None:
    state = ContourState()
    for k in range(40):
        state = Contour(steepest_deg=20.0).step(state, k * 1e-3, k * 1e-3, *reaction(math.pi / 4, 10.0, 0.0))
    assert math.degrees(state.angle) == pytest.approx(20.0)


@pytest.mark.parametrize(
    "wrong", [{"window_mm": 0.0}, {"learning_share": 1.5}, {"smoothing_share": 0.0}, {"steepest_deg": 90.0}]
)
def test_parameters_out_of_range_are_named(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=next(iter(wrong))):
        Contour(**wrong)


@pytest.mark.parametrize(("dt", "taken"), [(0.18, 20), (0.02, 4), (0.004, 1)])
def test_a_quick_loop_takes_samples_for_the_normal_at_the_pace_of_the_slow_one(dt: float, taken: int) -> None:
    """The tool moves by a millimetre in each of twenty cycles; only the samples of the estimate's pace count."""
    contour = Contour(window_mm=100.0)
    state = ContourState()
    for k in range(20):
        state = contour.after(state, dt, (k * 1e-3, 0.0), (10.0, 0.0))
    assert len(state.points) == taken
