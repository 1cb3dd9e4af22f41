"""Hysteresis and cross-talk of emulated sensors: closed forms, memory, and the same result for any order of reads."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from emulators.devices.ati_can import AtiCanBoard, AtiCanProfile
from emulators.devices.ft300 import Ft300, Ft300Profile
from emulators.devices.jr3 import Jr3Sensor, SensorProfile
from emulators.devices.netft import NetBox, NetFtProfile
from emulators.seams import Floats
from emulators.sensing import KnownWrench
from emulators.sensing.distortion import Distortion, cross_talk, follow
from emulators.sensing.unrest import SensorErrors
from protocol.marks import SettingError
from tests.emulation.quiet_sensor import QUIET, SETTLED

T0, SEED = 100.0, 7
FULL, SHARE = 200.0, 0.02
SCALES = np.array([200.0, 100.0, 400.0, 10.0, 5.0, 20.0])
LOAD = np.array([10.0, -20.0, 40.0, 1.0, -2.0, 0.5])


def rated(load: Floats, share: float = SHARE) -> Floats:
    """Return the readings (n,) of an axis with a full scale of 200, for its loads (n,) since power-up."""
    distortion = Distortion(SensorErrors(hysteresis_share=share), np.full(6, FULL), 1000.0, SEED)
    return distortion.loads(lambda first, stop: np.tile(load[first:stop], (6, 1)), 0, len(load))[2]


def cycle(peak: float, samples: int = 801) -> Floats:
    """Return loads that rise from 0 to a peak, fall to 0, and repeat that once."""
    rising = np.linspace(0.0, peak, samples)
    return np.tile(np.concatenate((rising, rising[::-1])), 2)


def widths(peak: float, samples: int = 801) -> Floats:
    """Return the differences of the second fall and the second rise, at rising loads."""
    rising, falling = rated(cycle(peak, samples)).reshape(4, samples)[2:]
    return falling[::-1] - rising


@pytest.mark.parametrize("peak", [FULL, 0.6 * FULL, FULL / 4, FULL / 8])
def test_hysteresis_loop_width_is_a_share_of_the_load(peak: float) -> None:
    width = widths(peak)
    assert width[400] == pytest.approx(SHARE * peak)
    assert width.max() == pytest.approx(SHARE * peak)
    assert width.min() == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("peak", [FULL / 64, FULL / 8, FULL, -FULL])
def test_first_rise_of_a_load_is_read_exactly(peak: float) -> None:
    loads = np.linspace(0.0, peak, 801)
    assert rated(loads) == pytest.approx(loads, abs=1e-9)


def test_hysteresis_loop_area_matches_closed_form() -> None:
    """A play of threshold r and weight w contributes 2 w r (peak - 2 r)."""
    area = sum(
        2.0 * SHARE * w * r * FULL * (FULL - 2.0 * r * FULL)
        for w, r in ((1, 1 / 4), (1, 1 / 8), (1, 1 / 16), (2, 1 / 32))
    )
    loads = np.linspace(0.0, FULL, 801)
    assert np.trapezoid(widths(FULL), loads) == pytest.approx(area, rel=1e-3)


def test_load_within_smallest_play_returns_to_zero() -> None:
    readings = rated(cycle(FULL / 32))
    assert readings[[0, 1601, 1602, 3203]] == pytest.approx(0.0, abs=1e-12)
    assert readings[:801] == pytest.approx(readings[801:1602][::-1])
    assert widths(FULL / 16) == pytest.approx(0.0, abs=1e-9)
    assert abs(rated(cycle(FULL))[1601]) == pytest.approx(0.5 * SHARE * FULL)


def test_hysteresis_is_independent_of_the_rate() -> None:
    slow, fast = rated(cycle(FULL, 1601)), rated(cycle(FULL, 401))
    assert slow.reshape(4, 1601)[:, ::4] == pytest.approx(fast.reshape(4, 401))


def test_sensor_begins_without_memory_at_power_up() -> None:
    distortion = Distortion(SensorErrors(since=2.0, hysteresis_share=SHARE), np.full(6, FULL), 100.0, SEED)
    requested: list[tuple[int, int]] = []

    def read(first: int, stop: int) -> Floats:
        requested.append((first, stop))
        return np.tile(np.where(np.arange(first, stop) < 250, 20.0, 8.0), (6, 1))

    plays, risen = 7.5 + 2.0 * 13.75, 2.0 * (8.0 - FULL / 32)
    assert distortion.loads(read, 300, 301)[0] == pytest.approx(8.0 + SHARE * (plays - risen))
    distortion.loads(read, 301, 400)
    distortion.loads(read, 5000, 5001)
    assert requested == [(200, 301), (301, 400), (4000, 5001)]


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 300))
def test_plays_equal_those_of_single_samples(seed: int, count: int) -> None:
    loads = np.random.default_rng(seed).normal(size=count).cumsum()
    play = start = np.array([0.5, -3.0])
    thresholds = np.array([0.3, 4.0])
    expected = []
    for load in loads:
        play = np.clip(play, load - thresholds, load + thresholds)
        expected.append(play)
    limits = thresholds[:, np.newaxis]
    np.testing.assert_array_equal(follow(start, loads - limits, loads + limits), np.array(expected).T)


def wandering(times: Floats) -> Floats:
    return np.outer(np.sin(9.0 * times) + 0.6 * np.sin(31.0 * times), LOAD)


@settings(max_examples=30, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 400), st.integers(1, 700)), min_size=1, max_size=8))
def test_jr3_distortion_is_independent_of_reads(blocks: list[tuple[int, int]]) -> None:
    """Blocks of any length, with samples in between that are never read, and a restart in the middle of each."""
    profile = SensorProfile(noise_counts=0.0, hysteresis_share=0.05, cross_talk_share=0.02)
    once, often = (Jr3Sensor(profile, KnownWrench(wandering), SEED, T0) for _ in range(2))
    first = round(T0 * 8000)
    expected, at = once.raw(first, first + 9000), 0
    for left_out, size in blocks:
        at += left_out
        assert np.array_equal(often.raw(first + at, first + at + size), expected[at : at + size])
        at += size // 2


def test_jr3_change_of_load_is_followed_from_its_time_on() -> None:
    profile = SensorProfile(noise_counts=0.0, hysteresis_share=0.05)
    factor = [1.0]

    def wrench(times: Floats) -> Floats:
        return wandering(times) * np.where(times < T0 + 0.1 - 1e-9, 1.0, factor[0])[:, np.newaxis]

    source = KnownWrench(wrench, predicted_until=lambda now: now + 0.5)
    sensor, first = Jr3Sensor(profile, source, SEED, T0), round(T0 * 8000)
    sensor.counts_from(first, first + 700)
    factor[0] = -2.0
    source.on_change(T0 + 0.1)
    changed = sensor.counts_from(first + 700, first + 2000)
    fresh = Jr3Sensor(profile, KnownWrench(wrench), SEED, T0).counts_from(first, first + 2000)
    assert np.array_equal(changed[:1301], fresh[700:2001])


# --- cross-talk


def test_cross_talk_is_reproduced_by_its_seed() -> None:
    matrix = cross_talk(SHARE, SCALES, SEED)
    shares = matrix * SCALES / SCALES[:, np.newaxis] - np.eye(6)
    assert np.array_equal(matrix, cross_talk(SHARE, SCALES, SEED))
    assert not np.allclose(matrix, cross_talk(SHARE, SCALES, SEED + 1))
    assert np.array_equal(np.diag(matrix), np.ones(6))
    assert np.abs(shares).max() == pytest.approx(SHARE)
    assert np.count_nonzero(np.abs(shares) > 1e-6) == 30


def of_netft(source: KnownWrench, **errors: Any) -> Floats:
    profile = NetFtProfile(**{**QUIET, **errors})
    return NetBox(profile, source, T0, SEED)._measured.outputs(701_000, 701_000)[0] * 1e-6


def of_ft300(source: KnownWrench, **errors: Any) -> Floats:
    profile = Ft300Profile(**{**QUIET, **errors})
    return Ft300(profile, source, T0, SEED)._measured.outputs(10_010, 10_010)[0] * ([0.01] * 3 + [0.001] * 3)


def of_ati_can(source: KnownWrench, **errors: Any) -> Floats:
    profile = AtiCanProfile(noise_gages=0.0, **{**SETTLED, **errors})
    gages = AtiCanBoard(profile, source, T0, SEED)._measured.outputs(400_400, 400_400)[0]
    return profile.coefficients @ gages * 1e-6


def of_jr3(source: KnownWrench, **errors: Any) -> Floats:
    sensor = Jr3Sensor(SensorProfile(noise_counts=0.0, adc_bits=16, **errors), source, SEED, T0)
    readings = sensor.raw(800_800, 800_801)[0] @ sensor.calibration
    assert sensor.counts_from(800_800, 800_800)[0] @ sensor.calibration == pytest.approx(readings, abs=1e-9)
    return readings


@pytest.mark.parametrize(
    ("reading_of", "scales", "resolution"),
    [
        (of_netft, (130.0, 130.0, 400.0, 10.0, 10.0, 10.0), 1e-6),
        (of_ft300, (327.67,) * 3 + (32.767,) * 3, 0.01),
        (of_ati_can, None, 0.03),
        (of_jr3, (115.0, 111.0, 185.0, 5.6, 5.2, 6.1), 0.01),
    ],
)
def test_every_sensor_has_cross_talk_and_hysteresis(
    reading_of: Callable[..., Floats], scales: tuple[float, ...] | None, resolution: float
) -> None:
    load = LOAD / 4.0
    source = KnownWrench(lambda times: np.outer(np.where(times < T0 + 0.05, 2.0, 1.0), load))
    exact = reading_of(source)
    assert exact == pytest.approx(load, abs=resolution)
    assert np.array_equal(reading_of(source, hysteresis_share=0.0, cross_talk_share=0.0), exact)
    mixed, slack = reading_of(source, cross_talk_share=0.1), reading_of(source, hysteresis_share=0.1)
    assert np.abs(mixed - exact).max() > 10.0 * resolution
    if scales is not None:
        assert mixed == pytest.approx(cross_talk(0.1, np.array(scales), SEED) @ load, abs=resolution)
        limits = np.outer(scales, (1 / 4, 1 / 8, 1 / 16, 1 / 32))
        at, peak = np.abs(load)[:, np.newaxis], 2.0 * np.abs(load)[:, np.newaxis]
        plays = np.clip(np.maximum(peak - limits, 0.0), at - limits, at + limits)
        excess = (plays - np.maximum(at - limits, 0.0)) @ (1.0, 1.0, 1.0, 2.0)
        assert slack == pytest.approx(load + 0.1 * np.sign(load) * excess, abs=resolution)


@pytest.mark.parametrize("profile", [NetFtProfile, Ft300Profile, AtiCanProfile, SensorProfile])
@pytest.mark.parametrize("name", ["hysteresis_share", "cross_talk_share"])
def test_distortion_is_limited_to_a_tenth(profile: Callable[..., Any], name: str) -> None:
    with pytest.raises(SettingError, match=f"{name} must be at most 0.1"):
        profile(**{name: 0.2})
