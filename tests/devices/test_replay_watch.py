"""Detection of a stream that repeats a part of itself, without false alarms for a quiet sensor."""

import math
import random

import pytest

from hil_bridge.devices.sensors.replay_watch import ReplayWatch

PERIOD_S = 0.01


def noise(draw: random.Random, counts: float) -> tuple[int, ...]:
    """Return one frame of white noise with this standard deviation in counts."""
    return tuple(round(draw.gauss(0.0, counts)) for _ in range(6))


def detections(watch: ReplayWatch, frames: list[tuple[int, ...]], begin: int) -> list[float]:
    """Return `since` of the watch after each of these frames, the first of which has this number."""
    result = []
    for number, values in enumerate(frames, begin):
        watch.frame(values, number * PERIOD_S)
        result.append(watch.since)
    return result


@pytest.mark.parametrize(("counts", "frames"), [(50.0, 10), (1.0, 12), (0.5, 16)])
def test_replay_watch_finds_repeated_second_from_its_first_frame(counts: float, frames: int) -> None:
    draw, watch = random.Random(3), ReplayWatch(256)
    new = [noise(draw, counts) for _ in range(300)]
    assert all(math.isnan(since) for since in detections(watch, new, 0))
    result = detections(watch, new[200:], 300)
    assert result[frames] == pytest.approx(300 * PERIOD_S, abs=20 * PERIOD_S)


def test_replay_watch_ends_with_first_new_frame() -> None:
    draw, watch = random.Random(3), ReplayWatch(256)
    new = [noise(draw, 5.0) for _ in range(300)]
    detections(watch, new, 0)
    assert not math.isnan(detections(watch, new[200:], 300)[-1])
    assert math.isnan(detections(watch, [noise(draw, 5.0)], 400)[-1])


@pytest.mark.parametrize("counts", [0.0, 0.1, 0.2, 0.5, 1.0, 5.0])
def test_replay_watch_of_quiet_sensor_reports_nothing(counts: float) -> None:
    draw, watch = random.Random(4), ReplayWatch(256)
    frames = [noise(draw, counts) for _ in range(20_000)]
    assert all(math.isnan(since) for since in detections(watch, frames, 0))


def test_replay_watch_ignores_sensor_without_noise() -> None:
    """A force oscillates with a period of 36 frames, each identical to the previous period."""
    at_rest = [(0,) * 6] * 100
    cycle = [tuple(round(40 * math.sin(k + n / 36 * 2 * math.pi)) for k in range(6)) for n in range(36)]
    assert all(math.isnan(since) for since in detections(ReplayWatch(256), at_rest + cycle * 20, 0))


def test_replay_watch_of_aliased_hum_reports_nothing() -> None:
    """Two alternating values, and a hum with a period of seven frames, are normal."""
    for period in (2, 7):
        hum = [
            tuple(round(9 * math.sin(k + 2 * math.pi * n / period)) for k in range(6)) for n in range(2000)
        ]
        assert all(math.isnan(since) for since in detections(ReplayWatch(256), hum, 0))
