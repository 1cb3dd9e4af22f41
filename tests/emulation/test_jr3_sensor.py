"""Tests of the emulated sensor: grid, counts, noise that depends on the sample number, saturation."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from emulators.devices.jr3 import Jr3Sensor, SensorProfile
from emulators.sensing import KnownWrench

FIRST = 8_000 * 1000 + 17
"""Sample number after an odd epoch of 1000 s."""


def constant(*wrench: float) -> Callable[[NDArray[np.float64]], NDArray[np.float64]]:
    return lambda times: np.tile(np.array(wrench), (len(times), 1))


def indices(first: int, count: int) -> NDArray[np.int64]:
    return np.arange(first, first + count, dtype=np.int64)


def test_count_is_full_scale_over_16384() -> None:
    wrench = (115.0, -111.0 / 2, 185.0 * 1.4 / 16384, 5.6, 5.2 / 4, -6.1 * 1.6 / 16384)
    sensor = Jr3Sensor(SensorProfile(noise_counts=0.0), KnownWrench(constant(*wrench)), seed=1)
    assert sensor.counts(indices(FIRST, 2)).tolist() == [[16384, -8192, 1, 16384, 4096, -2]] * 2
    assert sensor.profile.full_scale_words == (115, 111, 185, 56, 52, 61)


def test_samples_are_on_absolute_grid() -> None:
    requested: list[float] = []

    def wrench_at(times: NDArray[np.float64]) -> NDArray[np.float64]:
        requested.extend(times.tolist())
        return np.zeros((len(times), 6))

    Jr3Sensor(SensorProfile(), KnownWrench(wrench_at), seed=1).counts(np.array([FIRST, FIRST + 3]))
    assert requested == [k / 8000 for k in range(FIRST, FIRST + 4)]


def test_committed_samples_are_read_once() -> None:
    requested: list[float] = []

    def wrench_at(times: NDArray[np.float64]) -> NDArray[np.float64]:
        requested.extend(times.tolist())
        return np.outer(times % 1.0, np.arange(1.0, 7.0))

    def committed_until(now: float) -> float:
        return now + 0.0101

    ahead = Jr3Sensor(SensorProfile(), KnownWrench(wrench_at, committed_until), 3)
    parts = [ahead.counts(np.arange(FIRST + 17 * k, FIRST + 17 * (k + 1))) for k in range(40)]
    again = ahead.counts(np.arange(FIRST + 17 * 39, FIRST + 17 * 41))
    assert requested == [k / 8000 for k in range(FIRST, FIRST + len(requested))]
    assert FIRST + 17 * 41 <= FIRST + len(requested) <= FIRST + 17 * 41 + 81
    plain = Jr3Sensor(SensorProfile(), KnownWrench(wrench_at), 3)
    expected = plain.counts(np.arange(FIRST, FIRST + 17 * 41))
    assert np.array_equal(np.concatenate((*parts[:-1], again)), expected)
    assert np.array_equal(parts[-1], again[:17])
    # samples that are not asked for are left out, and the stream continues where it is asked for again
    requested.clear()
    assert np.array_equal(ahead.counts(np.array([FIRST + 9000])), plain.counts(np.array([FIRST + 9000])))
    assert requested[0] == (FIRST + 9000) / 8000


@settings(max_examples=30, deadline=None)
@given(st.lists(st.integers(0, 1500), max_size=6), st.integers(0, 2**32))
def test_noise_is_independent_of_blocks(sizes: list[int], seed: int) -> None:
    complete = Jr3Sensor(SensorProfile(), KnownWrench(constant(*[1.0] * 6)), seed).counts(
        indices(FIRST, sum(sizes))
    )
    sensor, first, blocks = (
        Jr3Sensor(SensorProfile(), KnownWrench(constant(*[1.0] * 6)), seed),
        FIRST,
        [np.empty((0, 6), np.int64)],
    )
    for size in sizes:
        blocks.append(sensor.counts(indices(first, size)))
        first += size
    assert np.array_equal(np.concatenate(blocks), complete)


def test_noise_is_white_with_rms_and_seed() -> None:
    profile = SensorProfile(noise_counts=2.8)
    noise = Jr3Sensor(profile, KnownWrench(constant(*[0.0] * 6)), seed=5).counts(indices(FIRST, 40_000))
    assert np.std(noise, axis=0) == pytest.approx(np.full(6, np.hypot(2.8, 12**-0.5)), rel=0.03)
    assert np.abs(np.mean(noise, axis=0)).max() < 0.1
    for lag in (1, 1024):
        correlation = np.corrcoef(np.column_stack([noise[:-lag], noise[lag:]]).T) - np.eye(12)
        assert np.abs(correlation).max() < 0.03
    other = Jr3Sensor(profile, KnownWrench(constant(*[0.0] * 6)), seed=6).counts(indices(FIRST, 100))
    assert not np.array_equal(noise[:100], other)


@pytest.mark.parametrize(("bits", "highest"), [(12, 32752), (14, 32764), (16, 32767)])
def test_saturation_follows_converter(bits: int, highest: int) -> None:
    wrench = (1e6, -1e6, 0.0, 0.0, 0.0, 0.0)
    sensor = Jr3Sensor(SensorProfile(adc_bits=bits), KnownWrench(constant(*wrench)), seed=1)
    assert sensor.counts(indices(FIRST, 1))[0, :2].tolist() == [highest, -32768]


def test_raw_channels_are_counts_in_converter_steps() -> None:
    wrench = (115.0, -111.0 / 2, 185.0 * 7 / 16384, 5.6 * 3, -5.2 * 3, 0.0)
    sensor = Jr3Sensor(SensorProfile(noise_counts=0.0), KnownWrench(constant(*wrench)), seed=1)
    assert sensor.raw(FIRST, FIRST + 2).tolist() == [[16384, -8192, 8, 32764, -32768, 0]] * 2
    assert np.allclose(np.array([16384, 0, 0, 0, 0, -16384]) @ sensor.calibration, [115, 0, 0, 0, 0, -6.1])


def test_raw_noise_matches_noise_of_counts() -> None:
    profile = SensorProfile(noise_counts=2.0, adc_bits=16)
    raw = Jr3Sensor(profile, KnownWrench(constant(*[0.0] * 6)), seed=5).raw(FIRST, FIRST + 3000)
    assert np.array_equal(
        raw, Jr3Sensor(profile, KnownWrench(constant(*[0.0] * 6)), seed=5).counts(indices(FIRST, 3000))
    )


def test_calibration_removes_coupling() -> None:
    coupling = np.eye(6)
    coupling[0, 1], coupling[2, 5] = 0.05, -0.02
    sensor = Jr3Sensor(
        SensorProfile(noise_counts=0.0, adc_bits=16, coupling=tuple(coupling.ravel())),
        KnownWrench(constant(11.5, 0.0, 18.5, 0.0, 0.0, 0.0)),
        seed=1,
    )
    assert sensor.raw(FIRST, FIRST + 1).tolist() == [[1638, 82, 1638, 0, 0, -33]]
    assert np.allclose(sensor.raw(FIRST, FIRST + 1) @ sensor.calibration, [11.5, 0, 18.5, 0, 0, 0], atol=0.01)


def test_committed_time_is_never_in_past() -> None:
    sensor = Jr3Sensor(SensorProfile(), KnownWrench(constant(*[0.0] * 6)), seed=1)
    assert sensor.committed_until(5.0) == 5.0
    ahead = Jr3Sensor(SensorProfile(), KnownWrench(constant(*[0.0] * 6), lambda now: 7.0), 1)
    assert (ahead.committed_until(5.0), ahead.committed_until(8.0)) == (7.0, 8.0)


@pytest.mark.parametrize(
    "wrong",
    [
        {"coupling": (1.0,) * 36},
        {"coupling": (1.0,)},
        {"coupling": (float("nan"),) * 36},
        {"full_scales_n": (115.0, 0.0, 185.0)},
        {"full_scales_nm": (1.0, 2.0)},
        {"noise_counts": -1.0},
    ],
)
def test_invalid_profile_is_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ValueError, match=next(iter(wrong))):
        SensorProfile(**wrong)  # type: ignore[arg-type]
