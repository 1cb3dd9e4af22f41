"""How late the frames of a stream are, by their count."""

import pytest

from hil_bridge.devices.sensors.lateness_watch import LatenessWatch

PERIOD_S = 0.01


def fed(*arrivals: tuple[float, int], period: float | None = PERIOD_S) -> LatenessWatch:
    """A watch that saw frames with these numbers at these times, s."""
    watch = LatenessWatch(period)
    for at, count in arrivals:
        watch.frame(at, count)
    return watch


def steady(
    frames: int, period: float = PERIOD_S, late: float = 0.0, first: int = 0
) -> list[tuple[float, int]]:
    return [(k * period + late, k) for k in range(first, first + frames)]


def test_frames_in_time_are_not_late() -> None:
    assert fed(*steady(1000)).late == 0.0


def test_steps_of_a_delay_add_up() -> None:
    watch = fed(*steady(100), *steady(50, late=0.1, first=100), *steady(50, late=0.2, first=150))
    assert watch.late == pytest.approx(0.2, abs=0.025)


def test_a_delay_that_creeps_adds_up() -> None:
    watch = fed(*steady(100), *((1.0 + k * 0.011, 100 + k) for k in range(500)))
    assert watch.late == pytest.approx(0.39, abs=0.01)


@pytest.mark.parametrize("period", [0.0099, 0.0101])
def test_another_clock_is_no_delay(period: float) -> None:
    assert fed(*steady(20_000, period)).late == 0.0


def test_jitter_is_no_delay() -> None:
    assert fed(*((k * PERIOD_S + 0.04 * (k % 3 == 0), k) for k in range(1000))).late == 0.0


def test_lost_frames_that_are_counted_are_no_delay() -> None:
    assert fed(*steady(100), *steady(100, first=150)).late == 0.0


def test_a_delay_that_ends_is_forgotten() -> None:
    assert fed(*steady(100), *steady(50, late=0.2, first=100), *steady(10, first=170)).late == 0.0


def test_a_counter_that_leaps_hides_no_delay() -> None:
    late = steady(50, late=0.2, first=100)
    leapt = [(at, count + 5000) for at, count in steady(50, late=0.2, first=150)]
    assert fed(*steady(100), *late, *leapt).late == pytest.approx(0.2, abs=0.025)


def test_a_sensor_that_is_asked_has_no_cadence() -> None:
    assert fed((0.0, 0), (5.0, 1), period=None).late == 0.0


def test_a_zero_lets_the_count_begin_again() -> None:
    watch = fed(*steady(100))
    watch.begin()
    watch.frame(3.0, 101)
    assert watch.late == 0.0


def copied(frames: int, every: int, first: int) -> list[tuple[float, int]]:
    """Frames behind `first`, of which one of `every` comes twice and counts twice."""
    arrivals, count = [], first
    for k in range(frames):
        for _ in range(2 if k % every == 0 else 1):
            arrivals.append(((first + k) * PERIOD_S, count))
            count += 1
    return arrivals


def test_copies_hide_no_delay_that_begins_behind_them() -> None:
    arrivals = copied(300, 10, 100)
    late = [(at + 0.15 * (at > 3.0), count) for at, count in arrivals]
    assert fed(*steady(100), *late).late >= 0.15


def test_frames_too_many_count_as_a_delay_that_they_may_hide() -> None:
    watch = fed(*steady(200), *copied(300, 10, 200))
    assert watch.late == pytest.approx(0.3 - 3.0 * 0.02, abs=0.02)


def test_frames_that_waited_for_the_first_reading_hide_nothing() -> None:
    waited = [(0.3, k) for k in range(30)]
    assert fed(*waited, *steady(500, first=30)).late == 0.0


def test_a_burst_after_a_pause_hides_nothing() -> None:
    burst = [(3.0, k) for k in range(200, 300)]
    assert fed(*steady(200), *burst, *steady(100, first=300)).late == 0.0


@pytest.mark.parametrize("period", [0.00981, 0.01019])
def test_another_clock_with_jitter_hides_nothing(period: float) -> None:
    watch, latest = LatenessWatch(PERIOD_S), 0.0
    for at, count in steady(20_000, period):
        watch.frame(at + 0.03 * (count % 101 != 0), count)
        latest = max(latest, watch.late)
    assert latest == 0.0
