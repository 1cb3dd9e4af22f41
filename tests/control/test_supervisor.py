"""Supervisor, the final check before a command is sent."""

import itertools
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from hil_bridge.control import Allow, Clamp, Limits, Request, Stop, Supervisor
from hil_bridge.errors import Cause, ConfigError, Part, Reason
from hil_bridge.errors.cause_table import ROWS
from tests.observed import observation, observed

DOWN = (0.0, 0.0, -1.0)
LIMITS = Limits(
    correction_total_mm=20.0, workspace_min_m=(-0.1, -0.1, -0.015), workspace_max_m=(0.1, 0.1, 0.01)
)
SUPERVISOR = Supervisor(LIMITS)
START = SUPERVISOR.initial((0.0, 0.0, 0.0))
QUIET = observation(5.0, resultant=6.0, sensor_at=99.99)
MM = st.floats(-60, 60)


def request(depth_mm, across_mm=0.0):
    return Request(depth_mm * 1e-3, (across_mm * 1e-3, 0.0, -depth_mm * 1e-3), DOWN)


def step(requested, state=START, **facts):
    return SUPERVISOR.step(state, observed(QUIET, **facts), requested)


def test_supervisor_request_within_limits_is_unchanged():
    requested = request(1.5, 1.0)
    state, verdict = step(requested)
    assert verdict == Allow(requested.depth, requested.position)
    assert (state.depth, state.position) == (requested.depth, requested.position)


def test_supervisor_limits_speed_only_into_the_surface():
    _, verdict = step(request(5.0))
    assert isinstance(verdict, Clamp)
    assert verdict.depth == pytest.approx(11e-3 * 0.18)
    assert verdict.position == pytest.approx((0.0, 0.0, -11e-3 * 0.18))
    assert verdict.reasons == ("deeper faster than 11 mm/s",)
    _, verdict = step(request(-9.0))
    assert isinstance(verdict, Allow)


def test_supervisor_total_depth_is_clamped():
    supervisor = Supervisor(Limits(correction_total_mm=3.0))
    state = supervisor.initial((0.0, 0.0, 0.0))
    for _ in range(5):
        state, verdict = supervisor.step(
            state, observed(QUIET, sensor_sequence=round(state.still)), request(50.0)
        )
        state = replace(state, sensor_sequence=None)
    assert verdict.depth == pytest.approx(3e-3)
    assert verdict.reasons == ("deeper than 3 mm in total",)


def test_supervisor_clamped_travel_keeps_the_retraction():
    _, verdict = step(request(-4.0, 50.0))
    assert isinstance(verdict, Clamp)
    assert verdict.position == pytest.approx((27.5e-3 * 0.18, 0.0, 4e-3))
    assert verdict.depth == -4e-3


def test_supervisor_path_is_cut_at_workspace_border():
    _, verdict = step(request(-20.0))
    assert isinstance(verdict, Clamp)
    assert verdict.position == pytest.approx((0.0, 0.0, 0.01))
    assert verdict.depth == pytest.approx(-0.01)
    assert verdict.reasons == ("leaves the workspace",)


def test_supervisor_start_outside_workspace_is_config_error():
    with pytest.raises(ConfigError, match="outside"):
        SUPERVISOR.initial((0.0, 0.0, 0.5))


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_default_workspace_ends_3_m_from_the_base(axis, sign):
    supervisor = Supervisor(Limits())
    inside, outside = (tuple(sign * far if k == axis else 0.0 for k in range(3)) for far in (3.0, 3.001))
    assert supervisor.allows(inside)
    assert not supervisor.allows(outside)


def test_limits_workspace_in_millimetres_is_reported():
    box = Limits(workspace_min_m=(60.0, -90.0, -90.0), workspace_max_m=(99.0, 90.0, 90.0))
    with pytest.raises(
        ConfigError, match=r"did you mean \[0\.06, -0\.09, -0\.09\] and \[0\.099, 0\.09, 0\.09\]\?"
    ):
        Supervisor(box).initial((0.07, 0.0, 0.0))
    with pytest.raises(ConfigError) as outside:
        Supervisor(box).initial((0.02, 0.0, 0.0))
    assert "did you mean" not in str(outside.value)
    with pytest.raises(ValueError, match=r"workspace_max_m is in m, .* did you mean \[1\.2, 0\.3, 0\.9\]\?"):
        Limits(workspace_max_m=(1200.0, 300.0, 900.0))


def test_supervisor_tool_just_outside_may_only_return():
    """The tolerance for the reported start position is that of a run: 1 mm."""
    with pytest.raises(ConfigError, match="outside"):
        SUPERVISOR.initial((0.0, 0.0, 0.0111))
    state, frames = SUPERVISOR.initial((0.0, 0.0, 0.0109)), itertools.count()

    def to(height_mm, at):
        z = height_mm * 1e-3
        facts = {"position": (0.0, 0.0, 0.0109), "sensor_sequence": next(frames)}
        return step(Request(0.0109 - z, (0.0, 0.0, z), DOWN), at, **facts)

    stayed, verdict = to(10.9, state)
    assert isinstance(verdict, Allow)
    out, verdict = to(12.0, stayed)
    assert verdict.reasons == ("leaves the workspace",)
    assert out.position == pytest.approx((0.0, 0.0, 0.0109))
    assert out.depth == pytest.approx(0.0)
    nearer, verdict = to(10.5, stayed)
    assert isinstance(verdict, Allow)
    back, verdict = to(10.9, nearer)
    assert back.position[2] == pytest.approx(0.0105), "not even back to its previous position"
    inside, verdict = to(9.5, nearer)
    assert isinstance(verdict, Allow)
    border, _ = to(10.5, inside)
    assert border.position[2] == pytest.approx(0.01)


@pytest.mark.parametrize(
    ("observed", "cause"),
    [
        ({"force": 50.1}, Cause.FORCE),
        ({"force": -50.1}, Cause.FORCE),
        ({"peak_force": 50.1}, Cause.FORCE),
        ({"peak_force": -50.1}, Cause.FORCE),
        ({"force": -10.1}, Cause.PULL),
        ({"force": math.nan}, Cause.FORCE_NOT_A_NUMBER),
        ({"resultant": 100.1}, Cause.RESULTANT_FORCE),
        ({"peak_resultant": 100.1}, Cause.RESULTANT_FORCE),
        ({"peak_moment": 10.1}, Cause.MOMENT),
        ({"position": (0.0, 0.0, 0.0), "tilt": math.radians(LIMITS.tilt_deg + 0.1)}, Cause.TILT),
        ({"saturated": True}, Cause.SATURATED),
        ({"now": 100.21}, Cause.FORCE_TOO_OLD),
        ({"sensor_at": 100.1}, Cause.FORCE_TOO_OLD),
        ({"unchanged": 4.0}, Cause.SAME_COUNTS),
        ({"fault": Reason(Cause.ROBOT_STATE, "the sensor restarted")}, Cause.ROBOT_STATE),
        ({"dead_axis": "fz did not change"}, Cause.DEAD_AXIS),
        ({"depth": math.inf}, Cause.POSE_NOT_A_NUMBER),
    ],
)
def test_supervisor_stops_beyond_each_limit_only(observed, cause):
    _, verdict = step(request(0.5), **observed)
    assert isinstance(verdict, Stop)
    assert verdict.reason.cause is cause
    inside = {"force": 50.0, "resultant": 100.0, "now": 100.18, "unchanged": 3.99}
    assert isinstance(step(request(0.5), **inside)[1], Allow)
    assert isinstance(step(request(0.5), **inside | {"force": -10.0})[1], Allow)


def test_supervisor_side_force_limit_depends_on_step():
    """By default, `against_travel_n` limits a force from the side."""
    sideways = {"aside": LIMITS.against_travel_n + 5.0 * LIMITS.friction_share + 0.1}
    _, verdict = step(request(0.5), **sideways)
    assert isinstance(verdict, Stop)
    assert verdict.reason.cause is Cause.WALL
    pressing = Supervisor(LIMITS, presses_aside=True)
    _, verdict = pressing.step(START, observed(QUIET, **sideways), request(0.5))
    assert isinstance(verdict, Allow)


def test_supervisor_age_near_limit_has_enough_digits():
    for now, reported in ((100.1904, "is 200.40 ms old"), (100.24, "is 250 ms old")):
        _, verdict = step(request(0.5), now=now)
        assert reported in verdict.reason.text


def test_supervisor_frozen_or_decreasing_counter_stops():
    state, verdicts = START, []
    for _ in range(4):
        state, verdict = step(request(0.0), state)
        verdicts.append(verdict)
    assert [type(v) for v in verdicts] == [Allow, Allow, Allow, Stop]
    assert verdicts[-1].reason.cause is Cause.NO_NEW_FRAME
    state, _ = step(request(0.0))
    assert step(request(0.0), state, sensor_sequence=6)[1].reason.cause is Cause.SEQUENCE


def deepen(depths_mm, force=lambda k: 5.0, **observed):
    """Return the causes of the cycles in which the reported depth takes these values."""
    state, causes = START, []
    for k, depth in enumerate(depths_mm):
        state, verdict = step(
            request(0.0), state, depth=depth * 1e-3, force=force(k), sensor_sequence=10 + k, **observed
        )
        causes.append(verdict.reason.cause if isinstance(verdict, Stop) else None)
    return causes


def test_supervisor_force_constant_over_depth_stops():
    assert deepen([1.0, 2.0, 3.0, 3.01], pressing=True) == [None, None, None, Cause.UNANSWERED]
    # One count of change, no contact, or a tool that does not go deeper is enough to be believed.
    assert set(deepen(range(20), force=lambda k: 5.0 + 0.01 * k, pressing=True)) == {None}
    assert set(deepen(range(20))) == {None}
    assert set(deepen([3.0] * 500, pressing=True)) == {None}
    # Pulling back and coming again is depth too.
    assert deepen([5.0, 1.0, 2.9, 3.1], pressing=True)[-1] is Cause.UNANSWERED


def test_supervisor_dead_force_with_jitter_is_detected():
    steps = [1.0, 2.0, 3.0, 3.01]
    assert deepen(steps, force=lambda k: 9.03 + 1e-4 * (-1) ** k, pressing=True)[-1] is Cause.UNANSWERED
    # Not one count changed on any axis, while a program turns the tool.
    turning = deepen(steps, force=lambda k: 9.0 + 0.1 * k, pressing=True, unchanged=0.5)
    assert turning[-1] is Cause.UNANSWERED
    assert set(deepen(steps, force=lambda k: 9.0 + 0.1 * k, pressing=True)) == {None}


def test_supervisor_depth_position_mismatch_stops():
    lying = Request(0.0, (0.0, 0.0, -1e-3), DOWN)
    assert step(lying)[1].reason.cause is Cause.INCONSISTENT
    assert step(Request(0.0, (0.0, 0.0, 0.0), (0.0, 0.0, -2.0)))[1].reason.cause is Cause.INCONSISTENT


@given(st.floats(), st.floats(allow_nan=True), MM, MM)
def test_supervisor_force_above_limit_always_stops(force, resultant, depth, across):
    _, verdict = step(request(depth, across), force=force, resultant=resultant)
    fine = (
        -LIMITS.pull_limit_n <= force <= LIMITS.force_limit_n
        and -math.inf < resultant <= LIMITS.resultant_limit_n
    )
    assert isinstance(verdict, Stop) != fine


@given(
    st.sampled_from(["now", "force", "resultant", "sensor_at", "depth", 0, 1, 2]),
    st.sampled_from([math.nan, math.inf]),
)
def test_supervisor_nan_anywhere_stops(where, value):
    requested, observed = request(0.5), {}
    if where == "depth":
        requested = replace(requested, depth=value)
    elif isinstance(where, int):
        requested = replace(
            requested, position=tuple(value if i == where else x for i, x in enumerate(requested.position))
        )
    else:
        observed = {where: value}
    verdict = step(requested, **observed)[1]
    assert isinstance(verdict, Stop)
    of_sensor = where in ("force", "resultant", "sensor_at")
    part = Part.SENSOR if of_sensor else Part.POSE if where == "now" else Part.CONTROLLER
    if where == "depth" or isinstance(where, int) or of_sensor:
        assert ROWS[verdict.reason.cause].part is part


@given(st.lists(st.tuples(MM, st.floats(-20, 20)), min_size=1, max_size=30))
def test_supervisor_allowed_path_stays_within_limits(requested):
    state = START
    for k, (depth, across) in enumerate(requested):
        expected = request(depth, across)
        after, verdict = step(expected, state, sensor_sequence=100 + k)
        assert verdict.depth <= max(expected.depth, state.depth) + 1e-9
        assert verdict.depth - state.depth <= 2e-3 + 1e-9
        assert verdict.depth <= 20e-3 + 1e-9
        assert all(
            low <= x <= high
            for low, x, high in zip(
                LIMITS.workspace_min_m, verdict.position, LIMITS.workspace_max_m, strict=True
            )
        )
        assert verdict.position[2] == pytest.approx(-verdict.depth, abs=1e-9)
        _, again = step(Request(verdict.depth, verdict.position, DOWN), state, sensor_sequence=100 + k)
        assert again == Allow(verdict.depth, verdict.position)
        state = after


@given(st.lists(st.tuples(MM, st.floats(-100, 100)), max_size=10))
def test_supervisor_stop_is_latched(later):
    state, stop = step(request(0.0), force=60.0)
    for k, (depth, force) in enumerate(later):
        state, verdict = step(request(depth), state, force=force, sensor_sequence=k)
        assert verdict == stop


@pytest.mark.parametrize(
    "wrong",
    [
        {"force_limit_n": 0.0},
        {"stale_after_ms": math.nan},
        {"correction_total_mm": -1.0},
        {"workspace_min_m": (0.0, 0.0, 9.0)},
    ],
)
def test_limits_invalid_values_are_refused(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        Limits(**wrong)


@pytest.mark.parametrize(
    ("pressed", "goal_mm"),
    [(None, 0.0), ((20.0, 10e-3), 0.0), ((20.0, 3e-3), 0.0), ((20.0, 1e-3), -2.0), ((20.0, -4e-3), -7.0)],
)
def test_blind_retraction_reaches_at_least_the_start(pressed, goal_mm):
    """`blind_retract_mm` is 3 mm from where the tool pressed; that may not end it below the start."""
    deep = 10e-3
    state = replace(SUPERVISOR.initial((0.0, 0.0, -deep), deep), pressed=pressed)
    verdict = None
    for _ in range(100):
        state, verdict = SUPERVISOR.retreat(state, observed(QUIET, force=math.nan), request(-9.0))
    assert state.depth * 1e3 == pytest.approx(goal_mm)
    assert verdict.is_for(Cause.NO_FORCE)
    assert not verdict.goes_on
