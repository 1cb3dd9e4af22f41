"""Estimate of a contour's normal in a run without steps: exact geometry in, angle and normal force out."""

import math
from typing import Any

import pytest

from hil_bridge.control.course.facing import PACE_S, Contour, FacingSample, FacingState, inward

CYCLE_S = 0.18
"""Cycle of the paper's setup, s."""


def reaction(angle: float, normal: float, friction: float) -> tuple[float, float]:
    """Reaction along approach and travel of a surface at `angle` that is pressed with `normal` N."""
    sine, cosine = math.sin(angle), math.cos(angle)
    return (
        normal * cosine + friction * normal * sine,
        -normal * sine + friction * normal * cosine,
    )


def after_sample(
    state: FacingState,
    position: tuple[float, float],
    force: tuple[float, float],
    contour: Contour = Contour(),  # noqa: B008
    dt: float = CYCLE_S,
) -> FacingState:
    """Return the state after one sample: reported travel and depth, m, reaction along approach and travel, N."""
    return contour.after(state, FacingSample(dt, *position, (*force, 0.0), (1.0, 0.0)), 1.0)


def angle_of(state: FacingState) -> float:
    """Estimated angle of the surface to the travel direction, rad."""
    assert state.fall[1] == 0.0
    return math.atan(state.fall[0])


def normal_force(state: FacingState, force: tuple[float, float]) -> float:
    """The part of a reaction along the estimated normal, N."""
    into, along, _ = inward(state.fall)
    return force[0] * into + force[1] * along


def walk(slopes: list[float], normal: float = 10.0, friction: float = 0.3) -> list[FacingState]:
    """A millimetre of travel a sample over a surface of these slopes, pressed with a constant normal force."""
    state, depth, states = FacingState(), 0.0, []
    for k, slope in enumerate(slopes):
        state = after_sample(state, (k * 1e-3, depth), reaction(math.atan(slope), normal, friction))
        depth += slope * 1e-3
        states.append(state)
    return states


@pytest.mark.parametrize("slope", [-0.5, -0.1, 0.0, 0.2, 0.6])
@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_contour_slope_gives_normal_and_friction(slope: float, friction: float) -> None:
    state = walk([slope] * 40, friction=friction)[-1]
    assert angle_of(state) == pytest.approx(math.atan(slope), abs=1e-6)
    assert state.friction_angle == pytest.approx(math.atan(friction), abs=1e-6)
    assert normal_force(state, reaction(math.atan(slope), 10.0, friction)) == pytest.approx(10.0)


def test_contour_wave_normal_has_no_path_lag() -> None:
    slopes = [0.314 * math.cos(2 * math.pi * k / 200) for k in range(400)]
    states = walk(slopes)[60:]
    errors = [
        abs(angle_of(state) - math.atan(slope)) for state, slope in zip(states, slopes[60:], strict=True)
    ]
    assert max(errors) < math.radians(1.0)
    # A line through the path alone lags by half its window of 6 mm.
    assert 3 * 0.314 * 2 * math.pi / 200 > math.radians(1.0)


def test_contour_normal_without_path_is_approach() -> None:
    states = walk([0.4] * 3)
    assert [angle_of(state) for state in states] == [0.0, 0.0, 0.0]
    assert normal_force(states[-1], (7.0, 2.0)) == 7.0


@pytest.mark.parametrize(
    "sample", [(0.04, 0.0, math.nan, 0.0), (0.04, math.inf, 1.0, 0.0), (0.04, 0.0, -1.0, 5.0)]
)
def test_contour_ignores_free_or_nan_samples(sample: tuple[float, float, float, float]) -> None:
    state = walk([0.2] * 40)[-1]
    assert after_sample(state, sample[:2], sample[2:]) == state


def test_contour_points_stay_ascending() -> None:
    state = walk([0.2] * 40)[-1]
    for _ in range(100):
        state = after_sample(state, (0.039, 0.0078), reaction(math.atan(0.2), 10.0, 0.3))
    assert len(state.points) <= 7
    assert angle_of(state) == pytest.approx(math.atan(0.2), abs=1e-3)


def test_contour_normal_is_limited_to_steepest() -> None:
    state, contour = FacingState(), Contour(steepest_deg=20.0)
    for k in range(40):
        state = after_sample(state, (k * 1e-3, k * 1e-3), reaction(math.pi / 4, 10.0, 0.0), contour)
    assert math.degrees(angle_of(state)) == pytest.approx(20.0)


@pytest.mark.parametrize(
    "wrong", [{"window_mm": 0.0}, {"learning_share": 1.5}, {"smoothing_share": 0.0}, {"steepest_deg": 90.0}]
)
def test_contour_invalid_parameter_is_named(wrong: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=next(iter(wrong))):
        Contour(**wrong)


@pytest.mark.parametrize("dt", [CYCLE_S, 0.02, 0.004])
def test_contour_reading_rate_is_independent_of_cycle(dt: float) -> None:
    """The tool moves by a millimetre in each of twenty cycles; only the readings at the estimate's pace count."""
    contour, state = Contour(window_mm=100.0), FacingState()
    for k in range(20):
        state = after_sample(state, (k * 1e-3, 0.0), (10.0, 0.0), contour, dt)
    cycles = max(math.ceil(PACE_S / dt - 1e-9), 1)
    assert len(state.points) == 20 // cycles


def test_contour_is_estimated_only_along_the_path() -> None:
    """A lateral force and the moments of the tool's face contain no information about it."""
    state = walk([0.2] * 40)[-1]
    sample = FacingSample(
        CYCLE_S, 0.04, 0.008, (*reaction(math.atan(0.2), 10.0, 0.3), 5.0), (1.0, 0.0), skew=(0.1, 0.1)
    )
    after = Contour().after(state, sample, 1.0)
    assert angle_of(after) == pytest.approx(math.atan(0.2), abs=1e-6)
