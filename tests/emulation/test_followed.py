"""Tests of an arm that follows a stream of targets, on a simulated clock."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from emulators.arm.followed import FollowedArm, FollowedProfile
from protocol.geometry import Pose, angle_between

T0 = 1234.5
CYCLE, DELAY = 0.004, 0.008
FREQUENCY = 60.0
DOWN = (0.0, 1.0, 0.0, 0.0)
START = (0.9, -0.1, 0.6)


def arm(look_ahead: float = 0.0, **profile: float) -> FollowedArm:
    return FollowedArm(FollowedProfile(**profile), Pose(START, DOWN), T0, look_ahead)


def at(x: float = 0.0, z: float = 0.0) -> Pose:
    return Pose((START[0] + x, START[1], START[2] + z), DOWN)


def stream(followed: FollowedArm, place: Callable[[float], Pose], seconds: float) -> float:
    """Send a target in the middle of every cycle; return the time of the last one."""
    now = T0
    for k in range(round(seconds / CYCLE)):
        now = T0 + (k + 0.5) * CYCLE
        followed.follow(place(now - T0), now)
    return now


def test_step_response_is_critically_damped() -> None:
    followed = arm(speed_mm_s=1e6)
    followed.follow(at(x=0.005), T0 + 0.001)
    started_at = T0 + CYCLE + DELAY
    tau = np.linspace(-0.02, 0.2, 300)
    positions, velocities = followed.path.trajectory(started_at + tau)
    after = np.maximum(tau, 0.0)
    expected = START[0] + 0.005 * (1.0 - (1.0 + FREQUENCY * after) * np.exp(-FREQUENCY * after))
    np.testing.assert_allclose(positions[:, 0], expected, rtol=0, atol=1e-12)
    expected = 0.005 * FREQUENCY**2 * after * np.exp(-FREQUENCY * after)
    np.testing.assert_allclose(velocities[:, 0], expected, rtol=0, atol=1e-10)
    assert np.ptp(positions[:, 1:], axis=0) == pytest.approx([0.0, 0.0], abs=1e-15)


def test_ramp_lag_is_sum_of_stream_delay_and_loop() -> None:
    followed = arm()
    speed = 0.1
    last = stream(followed, lambda elapsed: at(x=speed * elapsed), 1.0)
    # A target comes half a cycle before its tick, is taken after the delay and held for a cycle; the loop lags 2ζ/ω.
    lag = CYCLE / 2.0 + DELAY + CYCLE / 2.0 + 2.0 / FREQUENCY
    times = last - 0.4 + np.arange(0.0, 0.4, CYCLE / 10.0)
    positions, velocities = followed.path.trajectory(times)
    behind = START[0] + speed * (times - T0) - positions[:, 0]
    assert behind.mean() == pytest.approx(speed * lag, rel=0.01)
    assert velocities[:, 0] == pytest.approx(np.full(len(times), speed), rel=0.2)


def test_arm_stays_at_last_target_when_stream_stops() -> None:
    followed = arm()
    last = stream(followed, lambda elapsed: at(x=0.1 * elapsed), 0.5)
    target = 0.1 * (last - T0)
    assert followed.set_point(last + CYCLE).position[0] == pytest.approx(START[0] + target, abs=1e-12)
    positions, velocities = followed.path.trajectory(last + np.array([1.0, 2.0, 60.0]))
    assert positions[:, 0] == pytest.approx([START[0] + target] * 3, abs=1e-9)
    assert np.abs(velocities).max() < 1e-8


def test_hold_stops_at_set_point_and_drops_targets() -> None:
    followed = arm()
    followed.follow(at(x=0.1), T0 + 0.001)
    now = T0 + 0.2002
    followed.follow(at(x=0.2), now)
    followed.hold(now)
    place = followed.set_point(now).position[0]
    # 50 ticks at 250 mm/s.
    assert place == pytest.approx(START[0] + 50 * 0.001, abs=1e-12)
    assert followed.pose(now + 1.0).position[0] == pytest.approx(place, abs=1e-9)
    abandoned = followed.path.targets.begun_at(2)
    assert abandoned is not None
    assert math.isnan(abandoned)


@pytest.mark.parametrize("speed_mm_s", [50.0, 250.0])
def test_set_point_speed_is_limited(speed_mm_s: float) -> None:
    followed = arm(speed_mm_s=speed_mm_s)
    followed.follow(Pose((START[0] + 0.3, START[1] - 0.4, START[2]), DOWN), T0)
    ticks = T0 + 0.001 + CYCLE * np.arange(1, 100)
    places = np.array([followed.set_point(now).position for now in ticks.tolist()])
    steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
    assert steps == pytest.approx(np.full(98, speed_mm_s * 1e-3 * CYCLE), rel=1e-9)
    # and from cycle to cycle so moves the tool, for a critically damped loop does not overshoot
    positions, _ = followed.path.trajectory(T0 + 0.0013 + CYCLE * np.arange(100.0))
    steps = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    assert steps.max() <= speed_mm_s * 1e-3 * CYCLE * (1.0 + 1e-9)
    assert steps.max() > speed_mm_s * 1e-3 * CYCLE * 0.99


def test_turn_rate_is_limited() -> None:
    followed = arm()
    turned = (0.0, math.cos(math.pi / 8), math.sin(math.pi / 8), 0.0)  # 45° about z
    followed.follow(Pose(START, turned), T0)
    # 90°/s: a quarter of a second after 62 of the 125 ticks, taken after the delay.
    half = followed.path.orientation(T0 + 62 * CYCLE + DELAY + 0.001)
    assert math.degrees(angle_between(DOWN, half)) == pytest.approx(62 * 0.36, abs=1e-9)
    assert angle_between(followed.path.orientation(T0 + 1.0), turned) < 1e-9
    with pytest.raises(ValueError, match="zero quaternion"):
        followed.follow(Pose(START, (0.0, 0.0, 0.0, 0.0)), T0 + 1.0)


def test_target_begins_with_first_set_point() -> None:
    followed = arm()
    followed.follow(at(x=0.01), T0 + 0.001)
    followed.follow(at(x=0.02), T0 + 0.002)
    assert followed.path.targets.accepted == 2
    assert followed.path.targets.begun_at(1) is None
    followed.path.advance(T0 + 0.005)
    overtaken, begun = followed.path.targets.begun_at(1), followed.path.targets.begun_at(2)
    assert overtaken is not None
    assert math.isnan(overtaken)
    assert begun == pytest.approx(T0 + CYCLE + DELAY)
    assert begun is not None
    positions, _ = followed.path.trajectory(begun + np.array([0.0, 0.001]))
    assert positions[0, 0] == pytest.approx(START[0], abs=1e-15)
    assert positions[1, 0] > START[0]


def test_committed_path_is_final() -> None:
    watched, other = arm(), arm()
    for followed in (watched, other):
        followed.follow(at(x=0.05), T0 + 0.001)
    now = T0 + 0.0501
    until = watched.path.committed_until(now)
    assert now + DELAY < until < now + DELAY + CYCLE
    assert watched.path.predicted_until(now) == until, "a stream is not worth looking ahead"
    times = np.linspace(now, until, 40)
    observed = watched.path.trajectory(times)[0]
    for followed in (watched, other):
        followed.follow(at(x=-0.05), now)
    np.testing.assert_array_equal(observed, other.path.trajectory(times)[0])


Targets = list[tuple[float, float]]


@settings(max_examples=30, deadline=None)
@given(
    st.lists(st.tuples(st.floats(0.0005, 0.05), st.floats(-0.05, 0.05)), min_size=1, max_size=12),
    st.lists(st.floats(0.0, 0.7), max_size=30),
    st.sampled_from((0.0, 0.05)),
)
def test_path_is_independent_of_reads(targets: Targets, read_times: list[float], look_ahead: float) -> None:
    once, often = arm(), arm(look_ahead)
    changes: list[float] = []
    often.path.on_change = changes.append
    questions = sorted(T0 + gap for gap in read_times)
    now = T0
    for pause, place in targets:
        now += pause
        while questions and questions[0] < now:
            at_most = often.path.predicted_until(questions[0])
            often.path.trajectory(np.linspace(questions[0], at_most, 7))
            questions.pop(0)
        for followed in (once, often):
            followed.follow(at(x=place, z=-place), now)
    times = np.linspace(T0, now + 1.0, 400)
    expected = once.path.trajectory(times)
    for part in np.split(times, [1, 90, 200, 380]):
        often.path.trajectory(part)
    for alike, other in zip(often.path.trajectory(times), expected, strict=True):
        np.testing.assert_allclose(alike, other, rtol=0, atol=1e-12)
    assert not changes or look_ahead
