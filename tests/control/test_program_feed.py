"""Speed along the path of a step, and the axis across the path."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil_bridge.control import FuzzyPi, Measurement, Stroke, TaskParameters
from hil_bridge.control.course.state import StepState
from hil_bridge.control.course.yielding import yield_to
from hil_bridge.control.steps.across import sideways_position
from hil_bridge.control.steps.feed import STUCK_S, TrackMemory, feed_of, watch_progress
from hil_bridge.control.steps.paths import Line
from hil_bridge.control.steps.track import Track
from hil_bridge.errors import Cause, Reason
from tests.control.plain import contact_of

LINE = Line(length_mm=50.0)
DT = 0.02
FRICTION = 0.6

# --- feed


def test_feed_without_limits_is_full():
    assert feed_of(Track(path=LINE), 100.0, 100.0, 0.0) == (1.0, None)


@pytest.mark.parametrize(
    ("error", "feed"), [(0.0, 1.0), (2.0, 0.55), (-2.0, 0.55), (4.0, 0.1), (-4.0, 0.1), (40.0, 0.1)]
)
def test_feed_falls_with_error_to_a_tenth(error, feed):
    result, trouble = feed_of(Track(path=LINE, feed_error_n=4.0), error, 0.0, 0.0)
    assert (result, trouble) == (pytest.approx(feed), None)


@pytest.mark.parametrize(
    ("lateral", "feed"),
    [(0.0, 1.0), (5.0, 1.0), (7.5, 0.5), (10.0, 0.0), (12.5, -0.5), (100.0, -0.5)],
)
def test_feed_reverses_beyond_lateral_limit(lateral, feed):
    result, trouble = feed_of(Track(path=LINE, lateral_limit_n=10.0), 0.0, lateral, 0.0)
    assert (result, trouble) == (pytest.approx(feed), None)


def test_feed_is_the_smaller_of_both():
    step = Track(path=LINE, lateral_limit_n=10.0, feed_error_n=4.0)
    assert feed_of(step, 2.0, 6.0, 0.0)[0] == pytest.approx(0.55)
    assert feed_of(step, 2.0, 9.0, 0.0)[0] == pytest.approx(0.2)


def test_feed_at_wall_stop_fails_at_limit():
    step = Track(path=LINE, lateral_limit_n=10.0, at_wall="stop")
    assert feed_of(step, 0.0, 9.9, 0.0)[1] is None
    text = "the lateral force of 10.0 N is beyond 10 N, 12.5 mm along the path: there is an obstacle"
    assert feed_of(step, 0.0, 10.04, 0.0125) == (0.0, Reason(Cause.STEP_WALL, text))


@given(
    error=st.floats(-1e3, 1e3),
    lateral=st.floats(0.0, 1e3),
    feed_error=st.none() | st.floats(0.1, 100.0),
    limit=st.none() | st.floats(0.1, 100.0),
)
def test_feed_is_within_half_back_and_full(error, lateral, feed_error, limit):
    step = Track(path=LINE, feed_error_n=feed_error, lateral_limit_n=limit)
    feed, trouble = feed_of(step, error, lateral, 0.0)
    assert -0.5 <= feed <= 1.0
    assert trouble is None
    if limit is not None and lateral > limit:
        assert feed <= 0.0
    elif limit is None or lateral < limit / 2:
        assert feed >= 0.1 - 1e-12


def test_progressing_tool_is_not_stuck():
    memory, local = TrackMemory(), 0.0
    for _ in range(round(20.0 / DT)):
        local += 0.1 * 5e-3 * DT
        memory = watch_progress(memory, 5.0, DT, local)
        assert memory.stuck < STUCK_S


def test_oscillating_tool_at_wall_is_stuck():
    memory = TrackMemory()
    for k in range(round(STUCK_S / DT) + 1):
        memory = watch_progress(memory, 5.0, DT, 0.2e-3 * math.sin(k))
    assert memory.stuck >= STUCK_S


# --- yielding to side forces


def yielding(state, force, distance, works_aside=True):
    pressed, *aside = force
    contact = contact_of(Measurement(0.0, pressed, 0.0, 0.0), aside=tuple(aside))
    return yield_to(state, contact, (distance, FRICTION), works_aside)


def test_retracting_tool_yields_to_side_force():
    state = yielding(StepState(at=(1e-3, 2e-3)), (4.0, 6.0, 8.0), 1e-4)
    assert state.at == pytest.approx((1e-3 - 0.6e-4, 2e-3 - 0.8e-4))
    assert state.yielded == pytest.approx(1e-4)


def test_retracting_tool_yields_back_along_path():
    state = yielding(StepState(at=(1e-3, 2e-3)), (4.0, 8.0, 30.0), 1e-4, works_aside=False)
    assert state.at == pytest.approx((1e-3 - 1e-4, 2e-3))
    aside = StepState(at=(1e-3, 2e-3))
    assert yielding(aside, (4.0, 0.0, 30.0), 1e-4, works_aside=False) == aside


@pytest.mark.parametrize("works_aside", [False, True])
def test_retracting_tool_ignores_friction(works_aside):
    state = StepState(at=(1e-3, 2e-3))
    assert yielding(state, (20.0, 12.0, 5.0), 1e-4, works_aside) == state
    assert yielding(state, (20.0, 18.0, 5.0), 1e-4, works_aside) != state


@pytest.mark.parametrize("works_aside", [False, True])
def test_yielding_continues_until_released(works_aside):
    yielded = yielding(StepState(), (0.0, 6.0, 0.0), 1e-4, works_aside)
    again = yielding(yielded, (0.0, 2.0, 0.0), 1e-4, works_aside)
    assert again.yielded == pytest.approx(2e-4)
    assert yielding(again, (0.0, 0.9, 0.0), 1e-4, works_aside) == again
    assert yielding(StepState(), (0.0, 2.0, 0.0), 1e-4, works_aside) == StepState()


@pytest.mark.parametrize("works_aside", [False, True])
def test_retracting_tool_never_advances_on_path(works_aside):
    assert yielding(StepState(), (0.0, -20.0, 0.0), 1e-4, works_aside) == StepState()
    turned = StepState(heading=(-1.0, 0.0))
    assert yielding(turned, (0.0, -20.0, 0.0), 1e-4, works_aside).at == pytest.approx((1e-4, 0.0))
    aside = yielding(StepState(), (0.0, -20.0, 20.0), 1e-4)
    assert aside.at == pytest.approx((0.0, -1e-4))


@given(st.lists(st.tuples(st.floats(-100.0, 100.0), st.floats(-100.0, 100.0)), max_size=40), st.booleans())
def test_yielding_is_limited_to_10_mm(forces, works_aside):
    state = StepState()
    for x, y in forces:
        state = yielding(state, (0.0, x, y), 1e-3, works_aside)
    assert math.hypot(*state.at) <= 10e-3 + 1e-9
    assert state.yielded <= 10e-3 + 1e-9


# --- across


def stroke_of():
    return Stroke(TaskParameters(approach_speed_mm_s=5.0), FuzzyPi(), 50.0, 0.01e-3)


def across(step, force_of, seconds=10.0):
    """Distance to the left, m, at each sample of a tool that follows at once; it determines the force."""
    stroke, aside, memory, positions = stroke_of(), 0.0, None, []
    for k in range(round(seconds / DT)):
        sample = Measurement(k * DT, 10.0, 0.0, 0.0, dt=DT)
        aside, memory = sideways_position(stroke, step, (aside, memory), sample, (force_of(aside), aside))
        positions.append(aside)
    return positions


@pytest.mark.parametrize("force", [4.0, -4.0])
def test_compliant_tool_yields_in_proportion(force):
    positions = across(Track(path=LINE, across="compliant", across_n_mm=2.0), lambda position: force)
    assert positions[-1] == pytest.approx(-force / 2.0 * 1e-3, rel=1e-3)
    assert max(abs(b - a) for a, b in zip([0.0, *positions], positions, strict=False)) <= 5e-3 * DT + 1e-12


def test_compliant_tool_returns_without_force():
    step = Track(path=LINE, across="compliant", across_n_mm=1.0)
    positions = across(step, lambda position: 0.0)
    assert positions[-1] == 0.0
    spring = across(step, lambda position: 3.0 if position > -1e-3 else 0.0)
    assert spring[-1] == pytest.approx(-1e-3, abs=0.1e-3)


@pytest.mark.parametrize("mode", [{"across": "compliant"}, {"across": "force", "across_n": 5.0}])
def test_across_motion_is_limited(mode):
    positions = across(
        Track(path=LINE, across_mm=2.0, **mode), lambda position: -50.0 if "across_n" not in mode else 0.0
    )
    assert max(map(abs, positions)) == pytest.approx(2e-3)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_across_force_presses_against_wall(side):
    wall, stiffness = 1.5e-3, 5000.0
    step = Track(path=LINE, across="force", across_n=side * 5.0)

    def force(position):
        return side * stiffness * max(side * position - wall, 0.0)

    positions = across(step, force, seconds=20.0)
    # the controller stops once the force is within one position step of the S3, 0.125 mm
    assert force(positions[-1]) == pytest.approx(side * 5.0, abs=0.125e-3 * stiffness)
    assert max(abs(force(position)) for position in positions) < 10.0
