"""Lateness of a stream's frames, by their count."""

import pytest

from hil_bridge.devices.sensors.lateness_watch import LatenessWatch

PERIOD_S = 0.01


def watch_of(*arrivals: tuple[float, int], period: float | None = PERIOD_S) -> LatenessWatch:
    """Return a watch after frames with these numbers at these times, s."""
    watch = LatenessWatch(period)
    for at, count in arrivals:
        watch.frame(at, count)
    return watch


def steady(
    frames: int, period: float = PERIOD_S, late: float = 0.0, first: int = 0
) -> list[tuple[float, int]]:
    return [(k * period + late, k) for k in range(first, first + frames)]


def test_lateness_watch_punctual_frames_are_not_late() -> None:
    assert watch_of(*steady(1000)).late == 0.0


def test_lateness_watch_adds_up_steps_of_delay() -> None:
    watch = watch_of(*steady(100), *steady(50, late=0.1, first=100), *steady(50, late=0.2, first=150))
    assert watch.late == pytest.approx(0.2, abs=0.025)


def test_lateness_watch_adds_up_creeping_delay() -> None:
    watch = watch_of(*steady(100), *((1.0 + k * 0.011, 100 + k) for k in range(500)))
    assert watch.late == pytest.approx(0.39, abs=0.01)


@pytest.mark.parametrize("period", [0.0099, 0.0101])
def test_lateness_watch_ignores_clock_drift(period: float) -> None:
    assert watch_of(*steady(20_000, period)).late == 0.0


def test_lateness_watch_ignores_jitter() -> None:
    assert watch_of(*((k * PERIOD_S + 0.04 * (k % 3 == 0), k) for k in range(1000))).late == 0.0


def test_lateness_watch_ignores_counted_losses() -> None:
    assert watch_of(*steady(100), *steady(100, first=150)).late == 0.0


def test_lateness_watch_resets_after_end_of_delay() -> None:
    assert watch_of(*steady(100), *steady(50, late=0.2, first=100), *steady(10, first=170)).late == 0.0


def test_lateness_watch_counter_jump_hides_no_delay() -> None:
    late = steady(50, late=0.2, first=100)
    leapt = [(at, count + 5000) for at, count in steady(50, late=0.2, first=150)]
    assert watch_of(*steady(100), *late, *leapt).late == pytest.approx(0.2, abs=0.025)


def test_lateness_watch_of_polled_sensor_is_inactive() -> None:
    assert watch_of((0.0, 0), (5.0, 1), period=None).late == 0.0


def test_lateness_watch_restarts_after_zero() -> None:
    watch = watch_of(*steady(100))
    watch.begin()
    watch.frame(3.0, 101)
    assert watch.late == 0.0


def with_duplicates(frames: int, every: int, first: int) -> list[tuple[float, int]]:
    """Return frames after `first`, of which one of `every` arrives twice and counts twice."""
    arrivals, count = [], first
    for k in range(frames):
        for _ in range(2 if k % every == 0 else 1):
            arrivals.append(((first + k) * PERIOD_S, count))
            count += 1
    return arrivals


def test_lateness_watch_duplicates_hide_no_later_delay() -> None:
    arrivals = with_duplicates(300, 10, 100)
    late = [(at + 0.15 * (at > 3.0), count) for at, count in arrivals]
    assert watch_of(*steady(100), *late).late >= 0.15


def test_lateness_watch_counts_surplus_frames_as_delay() -> None:
    watch = watch_of(*steady(200), *with_duplicates(300, 10, 200))
    assert watch.late == pytest.approx(0.3 - 3.0 * 0.02, abs=0.02)


def test_lateness_watch_initial_backlog_hides_no_delay() -> None:
    waited = [(0.3, k) for k in range(30)]
    assert watch_of(*waited, *steady(500, first=30)).late == 0.0


def test_lateness_watch_burst_after_pause_hides_no_delay() -> None:
    burst = [(3.0, k) for k in range(200, 300)]
    assert watch_of(*steady(200), *burst, *steady(100, first=300)).late == 0.0


@pytest.mark.parametrize("period", [0.00981, 0.01019])
def test_lateness_watch_drift_with_jitter_hides_no_delay(period: float) -> None:
    watch, latest = LatenessWatch(PERIOD_S), 0.0
    for at, count in steady(20_000, period):
        watch.frame(at + 0.03 * (count % 101 != 0), count)
        latest = max(latest, watch.late)
    assert latest == 0.0
