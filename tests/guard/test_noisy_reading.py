"""Reading of a noisy sensor without motion: the mean of as many frames as its noise requires."""

import asyncio
import math
from itertools import pairwise
from typing import Any, cast

import numpy as np
import pytest

from hil_bridge.control import Reading, reading
from hil_bridge.runs.small_steps import ERROR_N, ERROR_PATIENCE_S, FRAMES_MIN, SmallSteps

RATE = 100.0
T0 = 50.0


class _Clock:
    """Time that goes as far as it is slept."""

    def __init__(self) -> None:
        self.time = T0

    def now(self) -> float:
        return self.time

    async def sleep_until(self, time: float) -> None:
        self.time = max(self.time, time)


class _Noisy:
    """A sensor of 100 Hz with this noise on each force."""

    name, delay = "noisy", 0.0

    def __init__(self, clock: _Clock, noise_n: float, seed: int) -> None:
        frames = np.random.default_rng(seed).normal(0.0, noise_n, (2000, 6))
        self._frames, self._clock = [tuple(row) for row in frames.tolist()], clock

    def window(self, since: float) -> list[tuple[float, ...]]:
        first, last = (math.floor((at - T0) * RATE + 1e-6) for at in (since, self._clock.time))
        return self._frames[first:last]

    def check(self) -> None:
        """It is well."""


def quiet(noise_n: float, seed: int = 0) -> tuple[Reading, float]:
    """A reading of a sensor with this noise, and how long it took, s."""
    clock = _Clock()
    steps = SmallSteps(cast(Any, clock), cast(Any, None), cast(Any, _Noisy(clock, noise_n, seed)))
    return asyncio.run(steps.quiet()), clock.time - T0


def test_reading_error_is_standard_error_of_mean() -> None:
    frames = np.random.default_rng(1).normal(0.0, (0.1, 1.0, 0.5, 3.0, 3.0, 3.0), (400, 6))
    assert reading(frames.tolist()).error_n == pytest.approx(1.0 / 20.0, rel=0.1)


def test_quiet_sensor_is_read_for_four_frames() -> None:
    for noise_n in (0.0, 0.02, 0.1):
        result, took_s = quiet(noise_n)
        assert result.error_n <= ERROR_N
        assert took_s == pytest.approx(0.06 if FRAMES_MIN == 4 else 0.0)


def test_noisy_sensor_is_read_until_error_is_small() -> None:
    """As noisy as the force of an old arm. Four frames differ by more than half a newton nearly each time."""
    readings = [quiet(1.1, seed) for seed in range(40)]
    assert all(result.error_n <= ERROR_N for result, _ in readings)
    assert all(1.0 < took_s < ERROR_PATIENCE_S for _, took_s in readings)
    apart = [math.dist(a.mean[:3], b.mean[:3]) for (a, _), (b, _) in pairwise(readings)]
    assert max(apart) < 0.5


def test_very_noisy_sensor_reading_times_out() -> None:
    result, took_s = quiet(20.0)
    assert result.error_n > ERROR_N
    assert took_s == pytest.approx(ERROR_PATIENCE_S, abs=0.1)
