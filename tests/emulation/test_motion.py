"""Tests of interpolator, position loop and dead band, on a simulated clock."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from emulators.arm.loops import ServoProfile
from emulators.arm.waypoints import Waypoint, WaypointArm
from protocol.geometry import Pose, angle_between, slerp

T0 = 1234.5
TICK = 0.02
DELAY = 0.02
STEP = 0.000125
DOWN = (0.0, 1.0, 0.0, 0.0)
START = (0.9, -0.1, 0.6)
AT_ONCE = 1000.0
"""Speed in m/s that reaches any point within one tick."""


def robot(profile: ServoProfile | None = None) -> WaypointArm:
    return WaypointArm(profile or ServoProfile(), Pose(START, DOWN), T0, look_ahead=0.14)


def shifted(x: float = 0.0, y: float = 0.0, z: float = 0.0) -> tuple[float, float, float]:
    return START[0] + x, START[1] + y, START[2] + z


def test_step_response_is_critically_damped() -> None:
    motion = robot()
    motion.enqueue(Waypoint(shifted(x=0.005), DOWN, AT_ONCE), T0 + 0.001)
    # Next tick 20 ms after power-up, transport delay 20 ms more.
    started_at = T0 + TICK + 0.02
    tau = np.linspace(-0.03, 0.1, 400)
    positions, velocities = motion.path.trajectory(started_at + tau)
    after = np.maximum(tau, 0.0)
    expected = START[0] + 0.005 * (1.0 - (1.0 + 40.0 * after) * np.exp(-40.0 * after))
    np.testing.assert_allclose(positions[:, 0], expected, rtol=0, atol=1e-12)
    np.testing.assert_allclose(
        velocities[:, 0], 0.005 * 1600.0 * after * np.exp(-40.0 * after), rtol=0, atol=1e-10
    )
    np.testing.assert_allclose(positions[:, 1:], [[-0.1, 0.6]] * 400, rtol=0, atol=1e-15)


@pytest.mark.parametrize("damping", [0.4, 0.999999, 1.0, 2.5])
def test_line_matches_independent_integration(damping: float) -> None:
    motion = robot(ServoProfile(damping_ratio=damping))
    motion.enqueue(Waypoint(shifted(z=-0.05), DOWN, 0.1), T0)
    state, times, expected = np.array([START[2], 0.0]), [], []
    for tick in range(1, 21):
        # 0.1 m/s for 20 ms a tick is 16 resolution steps exactly.
        target = START[2] - tick * 16 * STEP
        solution = solve_ivp(
            lambda _, s, u=target: [s[1], -1600.0 * (s[0] - u) - 80.0 * damping * s[1]],
            (0.0, TICK),
            state,
            rtol=1e-10,
            atol=1e-13,
            dense_output=True,
        )
        inside = np.linspace(0.0, TICK * 0.99, 7)
        times.append(T0 + tick * TICK + 0.02 + inside)
        expected.append(solution.sol(inside).T)
        state = solution.y[:, -1]
    positions, velocities = motion.path.trajectory(np.concatenate(times))
    reference = np.concatenate(expected)
    np.testing.assert_allclose(positions[:, 2], reference[:, 0], rtol=0, atol=1e-9)
    np.testing.assert_allclose(velocities[:, 2], reference[:, 1], rtol=0, atol=1e-7)


def test_velocity_is_derivative_of_position() -> None:
    motion = robot()
    motion.enqueue(Waypoint(shifted(0.003, 0.004, -0.002), DOWN, 0.02), T0)
    times = T0 + np.arange(0.0, 1.0, 1e-5)
    positions, velocities = motion.path.trajectory(times)
    middle = (velocities[1:] + velocities[:-1]) / 2.0
    np.testing.assert_allclose(np.diff(positions, axis=0) / 1e-5, middle, rtol=0, atol=2e-5)


@settings(max_examples=30, deadline=None)
@given(st.lists(st.floats(1e-4, 0.15), min_size=1, max_size=30))
def test_path_is_independent_of_reads(gaps: list[float]) -> None:
    once, often = robot(), robot()
    for motion in (once, often):
        motion.enqueue(Waypoint(shifted(x=0.004, z=-0.01), DOWN, 0.013), T0)
        motion.enqueue(Waypoint(shifted(y=0.01), (0.0, 0.8, 0.6, 0.0), 0.03), T0)
    times = T0 + np.linspace(0.0, 1.4, 300)
    expected = once.path.trajectory(times)
    now = T0
    blocks: list[tuple[NDArray[np.float64], NDArray[np.float64]]] = []
    for gap in gaps:
        block = times[(times > now) & (times <= now + gap)] if blocks else times[times <= now + gap]
        blocks.append(often.path.trajectory(block) if len(block) else (np.empty((0, 3)), np.empty((0, 3))))
        often.reported(now + gap)
        now += gap
    observed = np.concatenate([b[0] for b in blocks]), np.concatenate([b[1] for b in blocks])
    count = len(observed[0])
    np.testing.assert_allclose(observed[0], expected[0][:count], rtol=0, atol=1e-15)
    np.testing.assert_allclose(observed[1], expected[1][:count], rtol=0, atol=1e-13)


def test_lines_are_followed_without_stops_at_points() -> None:
    motion = robot()
    for k in range(1, 5):
        motion.enqueue(Waypoint(shifted(y=0.0125 * k), DOWN, 0.05), T0)
    assert motion.waiting(T0) == 4
    assert motion.waiting(T0 + 0.5) == 2
    # The staircase of set points leaves a ripple on the speed, but no dip at a point on the way.
    _, velocities = motion.path.trajectory(T0 + np.arange(0.5, 0.9, 0.001))
    np.testing.assert_allclose(velocities[:, 1], 0.05, rtol=0, atol=0.02)
    assert velocities[:, 1].mean() == pytest.approx(0.05, rel=0.01)
    assert motion.waiting(T0 + 1.0) == 0
    assert not motion.settled(T0 + 1.0)
    assert motion.settled(T0 + 1.3)
    assert motion.reported(T0 + 1.3) == pytest.approx(shifted(y=0.05), abs=1e-12)


def rest_after(motion: WaypointArm, steps: int, now: float) -> float:
    """Return the true z in resolution steps above the start, half a second after a one-point move to `steps`."""
    motion.enqueue(Waypoint(shifted(z=steps * STEP), DOWN, AT_ONCE), now)
    positions, _ = motion.path.trajectory(now + 0.5 + np.linspace(0.0, 0.2, 50))
    assert np.ptp(positions[:, 2]) < 1e-9, "a loop inside the dead band must not creep"
    assert motion.reported(now + 0.7)[2] == pytest.approx(START[2] + steps * STEP, abs=1e-12)
    return float((positions[-1, 2] - START[2]) / STEP)


def test_loop_does_not_react_inside_dead_band() -> None:
    motion = robot()
    from_below = rest_after(motion, 1, T0)
    assert 0.5 <= from_below < 0.99
    assert rest_after(motion, 1, T0 + 1.0) == from_below
    rest_after(motion, 2, T0 + 2.0)
    from_above = rest_after(motion, 1, T0 + 3.0)
    assert 1.01 < from_above <= 1.5
    # So one reported position is two true ones, at most one step apart. On a stiffness k_e they are
    # two forces at most k_e times the resolution apart, which is the paper's limit cycle.
    assert 0.02 < from_above - from_below <= 1.0


def test_wider_dead_band_reports_with_hysteresis() -> None:
    motion = robot(ServoProfile(dead_band_steps=0.8))
    motion.enqueue(Waypoint(shifted(z=STEP), DOWN, AT_ONCE), T0)
    times = T0 + np.arange(0.0, 0.5, 0.0005)
    heights = (motion.path.trajectory(times)[0][:, 2] - START[2]) / STEP
    changed = [motion.reported(float(t))[2] > START[2] + STEP / 2 for t in times]
    assert heights[changed.index(True)] == pytest.approx(0.8, abs=0.02)


def test_reported_position_is_on_grid_near_true_one() -> None:
    motion = robot()
    motion.enqueue(Waypoint(shifted(0.0031, -0.0017, 0.0023), DOWN, 0.01), T0)
    for k in range(80):
        now = T0 + 0.007 * k
        reported = np.array(motion.reported(now))
        truth = motion.path.trajectory(np.array([now]))[0][0]
        np.testing.assert_allclose(reported / STEP, np.round(reported / STEP), rtol=0, atol=1e-9)
        assert np.abs(reported - truth).max() <= STEP / 2 + 1e-12


def test_halt_stops_within_delay_and_lag() -> None:
    motion = robot()
    motion.enqueue(Waypoint(shifted(x=0.1), DOWN, 0.1), T0)
    motion.halt(T0 + 0.405)
    assert motion.waiting(T0 + 0.405) == 0
    assert motion.settled(T0 + 1.0)
    # 20 ticks of 2 mm were interpolated.
    assert motion.reported(T0 + 1.0)[0] == pytest.approx(START[0] + 0.04, abs=1e-9)


def test_turn_takes_its_time() -> None:
    motion = robot()
    turned = (0.0, math.cos(math.pi / 4), math.sin(math.pi / 4), 0.0)
    motion.enqueue(Waypoint(START, turned, AT_ONCE), T0)
    # 90° at 90°/s; half of it after 0.5 s of interpolation and 20 ms of transport.
    assert angle_between(DOWN, motion.path.orientation(T0 + 0.521)) == pytest.approx(math.pi / 4, abs=1e-9)
    assert not motion.waiting(T0 + 1.0)
    assert motion.path.orientation(T0 + 1.05) == pytest.approx(turned, abs=1e-12)
    times = T0 + np.array([0.105, 0.106, 0.125, 1.045, 1.1, 1.2])
    stretches = motion.path.orientations(times)
    assert [(part.start, part.stop) for part, _ in stretches][:2] == [(0, 2), (2, 3)]
    for part, quaternion in stretches:
        assert {motion.path.orientation(now) for now in times[part].tolist()} == {quaternion}
    assert motion.path.orientations(times[3:]) == [(slice(0, 3), motion.path.orientation(T0 + 1.2))]


def test_slerp_takes_shorter_arc() -> None:
    half = slerp((1.0, 0.0, 0.0, 0.0), (-math.cos(0.5), 0.0, 0.0, -math.sin(0.5)), 0.5)
    assert half == pytest.approx((math.cos(0.25), 0.0, 0.0, math.sin(0.25)))
    assert slerp(DOWN, DOWN, 0.3) == DOWN


def test_long_pause_has_no_effect() -> None:
    short, long = robot(), robot()
    for motion in (short, long):
        motion.enqueue(Waypoint(shifted(x=0.002), DOWN, 0.01), T0)
        motion.path.advance(T0 + 2.0)
    at_rest = short.path.trajectory(np.array([T0 + 2.0]))[0]
    later = T0 + 3600.0 * 24.0
    np.testing.assert_array_equal(long.path.trajectory(np.array([later - 0.5, later]))[0], [at_rest[0]] * 2)
    long.path.advance(later)
    assert later < long.next_tick() <= later + TICK + 1e-9
    long.enqueue(Waypoint(START, DOWN, AT_ONCE), later)
    assert long.reported(later + 1.0) == pytest.approx(START, abs=1e-12)


def test_times_before_history_yield_first_state() -> None:
    motion = robot()
    motion.enqueue(Waypoint(shifted(x=0.5), DOWN, 0.02), T0)
    motion.path.advance(T0 + 20.0)
    positions, _ = motion.path.trajectory(T0 + np.array([1.0, 5.0, 10.1, 15.0]))
    assert positions[0, 0] == positions[1, 0] == pytest.approx(START[0] + 0.02 * 10.0, abs=0.003)
    assert positions[2, 0] == pytest.approx(START[0] + 0.02 * 10.03, abs=0.001)
    assert positions[3, 0] == pytest.approx(START[0] + 0.02 * 14.93, abs=0.001)


def test_invalid_waypoints_raise() -> None:
    motion = robot()
    with pytest.raises(ValueError, match="speed"):
        motion.enqueue(Waypoint(START, DOWN, 0.0), T0)
    with pytest.raises(ValueError, match="zero quaternion"):
        WaypointArm(ServoProfile(), Pose(START, (0.0, 0.0, 0.0, 0.0)), T0)
    with pytest.raises(ValueError, match="damping_ratio"):
        ServoProfile(damping_ratio=0.0)


def test_committed_path_is_final() -> None:
    watched, other = robot(), robot()
    for motion in (watched, other):
        motion.enqueue(Waypoint(shifted(x=0.01), DOWN, 0.05), T0)
    now = T0 + 0.033
    until = watched.path.committed_until(now)
    assert now + DELAY < until < now + DELAY + TICK
    times = np.linspace(now, until, 50)
    ahead = watched.path.trajectory(times)
    for motion in (watched, other):
        motion.halt(now)
        motion.enqueue(Waypoint(shifted(y=-0.02), DOWN, 0.2), now)
    for previewed, came in zip(ahead, other.path.trajectory(times), strict=True):
        np.testing.assert_array_equal(previewed, came)
    # and both continue alike: looking ahead took no point before its time
    later = np.linspace(until, until + 0.5, 100)
    np.testing.assert_array_equal(watched.path.trajectory(later)[0], other.path.trajectory(later)[0])


def test_reader_ahead_is_notified_of_change() -> None:
    watched, other = robot(), robot()
    reported: list[float] = []
    watched.path.on_change = reported.append
    for motion in (watched, other):
        motion.enqueue(Waypoint(shifted(x=0.01), DOWN, 0.05), T0)
    now = T0 + 0.033
    times = np.arange(now, watched.path.predicted_until(now), 1e-3)
    assert times[-1] > watched.path.committed_until(now) + 0.1
    observed = watched.path.trajectory(times)[0]
    assert not reported
    for motion in (watched, other):
        motion.halt(now)
    assert reported == [watched.path.committed_until(now)]
    came = other.path.trajectory(times)[0]
    kept = times < reported[0]
    np.testing.assert_array_equal(observed[kept], came[kept])
    assert not np.array_equal(observed, came)
    np.testing.assert_array_equal(watched.path.trajectory(times)[0], came)
    watched.enqueue(Waypoint(shifted(y=-0.02), DOWN, 0.2), now)
    assert reported == [watched.path.committed_until(now)] * 2, (
        "what was computed again is not true any more either"
    )
    watched.freeze(now, now + 1.0)
    assert len(reported) == 2, "no reader has looked ahead since"


def test_prediction_takes_no_point_early() -> None:
    motion = robot()
    motion.enqueue(Waypoint(shifted(x=0.0015), DOWN, 0.05), T0 + 0.001)
    motion.enqueue(Waypoint(shifted(x=0.003), DOWN, 0.05), T0 + 0.001)
    motion.path.trajectory(np.array([T0, motion.path.predicted_until(T0 + 0.002)]))
    assert motion.path.targets.begun_at(1) is None
    assert motion.waiting(T0 + 0.002) == 2
    assert motion.goal(T0 + 0.002)[0] == shifted(x=0.003)
    assert motion.path.targets.begun_at(1) is None
    assert motion.waiting(T0 + 0.05) == 1
    assert motion.path.targets.begun_at(2) == pytest.approx(T0 + 2 * TICK + DELAY)
