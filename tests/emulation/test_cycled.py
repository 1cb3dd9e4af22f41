"""Tests of a path computed cycle by cycle: linear between positions, and independent of reads."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from emulators.arm.cycled import CycledPath
from protocol.geometry import Pose, Quaternion

T0, PERIOD = 1000.25, 0.002
LEVEL: Quaternion = (1.0, 0.0, 0.0, 0.0)


def height(cycle: int) -> float:
    """Return the height at the start of a cycle, m."""
    return 0.1 * math.sin(cycle / 40.0)


class Wave:
    """Controller whose arm oscillates, and turns every tenth cycle."""

    def __init__(self) -> None:
        self.steps = 0
        self.path = CycledPath(Pose((0.0, 0.0, 0.0), LEVEL), T0, PERIOD, self.step)

    def step(self, now: float) -> Pose:
        self.steps += 1
        assert now == pytest.approx(T0 + self.steps * PERIOD)
        turn = (self.steps + 1) // 10 * 0.01
        return Pose(
            (0.0, 0.0, height(self.steps + 1) - height(1)), (math.cos(turn), math.sin(turn), 0.0, 0.0)
        )


def test_path_is_linear_between_cycles() -> None:
    wave = Wave()
    times = T0 + PERIOD * (np.arange(400) / 4.0)
    places, speeds = wave.path.trajectory(times)
    assert wave.steps == 99
    assert places[::4, 2][2:] == pytest.approx([height(k) - height(1) for k in range(2, 100)])
    inside = np.diff(places[:, 2]) / (PERIOD / 4.0)
    assert inside == pytest.approx(speeds[:-1, 2], abs=1e-9)


@given(st.lists(st.floats(0.0, 0.3), min_size=1, max_size=8))
def test_reads_in_between_have_no_effect(reads: list[float]) -> None:
    one, other = Wave(), Wave()
    for read in sorted(reads):
        one.path.trajectory(np.array([T0 + read]))
        one.path.orientations(np.array([T0 + read]))
    times = T0 + np.linspace(0.0, 0.4, 333)
    for path in (one.path, other.path):
        path.advance(T0 + 0.4)
    assert one.path.trajectory(times)[0].tolist() == other.path.trajectory(times)[0].tolist()
    assert one.path.orientations(times) == other.path.orientations(times)


def test_orientations_cover_all_times_in_order() -> None:
    wave = Wave()
    times = T0 + np.linspace(0.0, 0.4, 777)
    parts = wave.path.orientations(times)
    assert [part.start for part, _ in parts] == [0, *(part.stop for part, _ in parts[:-1])]
    assert parts[-1][0].stop == 777
    assert len({turned for _, turned in parts}) == len(parts) == 21


def test_times_before_history_yield_oldest_state() -> None:
    wave = Wave()
    wave.path.advance(T0 + 12.0)
    places, _ = wave.path.trajectory(np.array([T0, T0 + 2.1, T0 + 12.0]))
    assert places[1, 2] == pytest.approx(height(1050) - height(1), abs=1e-6)
    assert places[0, 2] == pytest.approx(height(6001 - 5002 + 0) - height(1), abs=6e-3)


def test_path_is_committed_to_end_of_cycle() -> None:
    path = Wave().path
    now = T0 + 10.5 * PERIOD
    assert path.committed_until(now) == pytest.approx(T0 + 11 * PERIOD)
    assert path.predicted_until(now) == path.committed_until(now) < T0 + 11 * PERIOD


def test_superseded_targets_never_begin() -> None:
    path = Wave().path
    assert path.targets.begun_at(1) is None
    for _ in range(3):
        path.targets.accept(T0)
    path.targets.begin_newest(T0 + 1.0)
    path.targets.accept(T0 + 1.0)
    assert path.targets.accepted == 4
    assert math.isnan(path.targets.begun_at(1) or 0.0)
    assert path.targets.begun_at(3) == T0 + 1.0
    assert path.targets.begun_at(4) is None
    for _ in range(2000):
        path.targets.accept(T0 + 2.0)
        path.targets.begin_newest(T0 + 2.0)
    assert math.isnan(path.targets.begun_at(3) or 0.0), "long forgotten"
