"""Tests of the errors of emulated sensors by the analysis that was applied to recordings of real ones."""

import itertools
import math
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from emulators.devices.ati_can import AtiCanProfile
from emulators.devices.ft300 import Ft300Profile
from emulators.devices.netft import NetBox, NetFtProfile
from emulators.seams import Floats
from emulators.sensing import Converter, KnownWrench, MeasuredWrench
from emulators.sensing.settings import per_axis, unrest
from emulators.sensing.unrest import SensorErrors
from protocol.marks import SettingError
from tests.emulation.quiet_sensor import SETTLED

T0 = 100.0
Profile = NetFtProfile | Ft300Profile
MOVING = SensorErrors(since=T0, motion=(0.65, 0.32, 0.21))


class MovingWrench(KnownWrench):
    """Wrench of an arm that moves at a speed given by time, m/s."""

    def __init__(self, wrench_at: Callable[[Floats], Floats], speed_at: Callable[[Floats], Floats]) -> None:
        super().__init__(wrench_at)
        self.speeds = speed_at


def unloaded(times: Floats) -> Floats:
    return np.zeros((len(times), 6))


def pressed(times: Floats) -> Floats:
    """Return a wrench of 10 N and 1 N·m from the eleventh second on."""
    return np.outer(np.where(times < T0 + 10.0, 0.0, 1.0), (0.0, 0.0, -10.0, 1.0, 0.0, 0.0))


def sensor_of(
    errors: SensorErrors,
    rate: float,
    source: KnownWrench | None = None,
    seed: int = 7,
    noise: Floats | None = None,
) -> MeasuredWrench:
    """Return a sensor with a million counts per N and N·m, and full scales of 30 N and 30 N·m."""
    ends = np.full(6, 1e12)
    rms = np.zeros(6) if noise is None else noise
    scales = np.full(6, 30.0)
    converter = Converter(np.eye(6) * 1e6, rms * 1e6, -ends, ends, unrest=errors, full_scale=scales)
    return MeasuredWrench(source or KnownWrench(unloaded), rate, converter, seed, "noise")


def sensor_with(profile: Profile, rate: float, seed: int = 7) -> MeasuredWrench:
    """Return a sensor with the errors of a profile, without rounding to counts."""
    noise = np.array((*per_axis(profile.noise_n), *per_axis(profile.noise_nm)))
    return sensor_of(unrest(profile, T0), rate, seed=seed, noise=noise)


def values(sensor: MeasuredWrench, rate: float, seconds: float, since: float = T0) -> Floats:
    """Return the wrench (n, 6) over this many seconds, N and N·m."""
    first = math.ceil(since * rate)
    return sensor.outputs(first, first + round(seconds * rate) - 1) / 1e6


def white(samples: Floats) -> Floats:
    """Return the standard deviation of the differences of successive samples, divided by √2, of each axis."""
    return np.std(np.diff(samples, axis=0), axis=0) / math.sqrt(2.0)


def share_below(samples: Floats, rate: float, hz: float) -> Floats:
    """Return the share of the variance of each axis below a frequency."""
    power = np.abs(np.fft.rfft(samples - samples.mean(axis=0), axis=0)) ** 2
    return power[np.fft.rfftfreq(len(samples), 1.0 / rate) < hz].sum(axis=0) / power.sum(axis=0)


# --- as they were recorded


def test_ft300_noise_matches_recordings() -> None:
    """60 samples at 10 Hz gave these figures, so their uncertainty is 10 %."""
    samples = values(sensor_with(Ft300Profile(), 100.0), 100.0, 200.0)[::10]
    assert white(samples) == pytest.approx((0.08, 0.10, 0.04, 0.0065, 0.0055, 0.004), rel=0.1)


def test_net_box_vibration_matches_recording() -> None:
    """698 samples at 698 Hz: 91 % of the variance of fz below 20 Hz, peaks at 9 … 16 Hz and at 71 Hz.

    The vibration adds a tenth to the differences of fz.
    """
    samples = values(sensor_with(NetFtProfile(), 7000.0), 7000.0, 20.0)[::10]
    assert white(samples) == pytest.approx((0.018, 0.019, 0.018, 0.0012, 0.0010, 0.0003), rel=0.12)
    seconds = samples.reshape(20, 700, 6)
    assert seconds.std(axis=1).mean(axis=0)[:3] == pytest.approx((0.035, 0.021, 0.075), rel=0.1)
    fz = samples[:, 2:3]
    assert share_below(fz, 700.0, 20.0) == pytest.approx(0.91, abs=0.02)
    peaks = np.argsort(np.abs(np.fft.rfft(fz[:, 0] - fz.mean())))[::-1][:30] / 20.0
    assert 71.0 in peaks
    assert np.all(((peaks >= 9.0) & (peaks <= 16.0)) | (peaks == 71.0))


def test_axia_means_match_recording() -> None:
    """Means of 0.1 s differed by 0.0006 … 0.0008 N and 0.00005 N·m. The noise of a Net Box at 7 kHz gives that."""
    still = NetFtProfile(family="axia", vibration_n=0.0, wander_n=0.0)
    means = values(sensor_with(still, 7000.0), 7000.0, 30.0).reshape(-1, 700, 6).mean(axis=1)
    assert np.all((white(means)[:3] > 0.0006) & (white(means)[:3] < 0.0008))
    assert white(means)[3:] == pytest.approx((0.00005, 0.00004, 0.00001), rel=0.2)


def test_net_ft_wander_is_within_axia_recording() -> None:
    """Means of 0.1 s of that recording differ by no more than 0.0008 N, walk included."""
    profile = NetFtProfile(vibration_n=0.0)
    means = values(sensor_with(profile, 7000.0), 7000.0, 30.0).reshape(-1, 700, 6).mean(axis=1)
    assert np.all(white(means)[:3] < 0.0011)


def test_creep_of_10_n_matches_axia() -> None:
    """0.02 … 0.13 N within 15 s, after a change of load of 10 … 15 N."""
    errors = unrest(NetFtProfile(vibration_n=0.0, wander_n=0.0), T0)
    sensor = sensor_of(errors, 1000.0, KnownWrench(pressed))
    forces = values(sensor, 1000.0, 60.0)
    before, at_once, later, at_last = forces[[9999, 10001, 25000, 59999], 2]
    assert (before, at_once) == pytest.approx((0.0, -9.9), abs=1e-3)
    assert 0.02 < at_once - later < 0.13
    assert later == pytest.approx(-10.0 + 0.1 * math.exp(-3.0), abs=1e-3)
    assert at_last == pytest.approx(-10.0, abs=1e-4)
    assert forces[10001, 3] == pytest.approx(0.99, abs=1e-4)


def test_motion_noise_is_proportional_to_speed() -> None:
    for speed, share in ((0.2, 1.0), (0.1, 1.0), (0.02, 0.2), (0.0, 0.0)):
        source = MovingWrench(unloaded, lambda times, speed=speed: np.full(len(times), speed))  # type: ignore[misc]
        samples = values(sensor_of(MOVING, 700.0, source), 700.0, 20.0)[:, :3]
        assert white(samples) == pytest.approx(np.array((0.65, 0.32, 0.21)) * share, rel=0.03)


def test_random_walk_has_rms_and_starts_at_power_up() -> None:
    errors = SensorErrors(since=T0, wander=(0.05, 0.1, 0.2))
    ends = []
    for seed in range(200):
        sensor = sensor_of(errors, 10.0, seed=seed)
        first = math.ceil(T0 * 10.0)
        ends.append(sensor.outputs(first, first + 100)[[0, 100], :3] / 1e6)
    begun, changed = np.array(ends).transpose(1, 0, 2)
    assert not begun.any()
    assert changed.std(axis=0) == pytest.approx((0.05, 0.1, 0.2), rel=0.15)


def test_slope_is_steady_from_power_up() -> None:
    sensor = sensor_of(SensorErrors(since=T0, slope=(0.05 / 60.0, 0.03 / 60.0, -0.08 / 60.0)), 10.0)
    first = math.ceil(T0 * 10.0)
    assert sensor.outputs(first + 6000, first + 6000)[0, :3] / 1e6 == pytest.approx((0.5, 0.3, -0.8))


# --- they belong to the number of a sample

ALL = SensorErrors(
    since=T0,
    wander=(0.1, 0.2, 0.3),
    slope=(0.1, 0.0, -0.1),
    creep_share=0.1,
    creep_s=2.0,
    vibration=(0.1, 0.1, 0.1),
    peak_share=0.1,
    motion=(0.5, 0.5, 0.5),
    hysteresis_share=0.05,
    cross_talk_share=0.02,
)


def swinging(times: Floats) -> Floats:
    return np.outer(np.sin(7.0 * times), (1.0, -2.0, 10.0, 0.1, 0.2, 0.3))


@cache
def all_samples(rate: float) -> Floats:
    """Return all samples of more than a minute, read at once."""
    first = math.ceil(T0 * rate)
    return sensor_of(ALL, rate, swing_source()).outputs(first, first + 6000)


def swing_source() -> MovingWrench:
    return MovingWrench(swinging, lambda times: 0.1 * np.abs(np.sin(3.0 * times)))


@given(
    st.lists(st.tuples(st.integers(0, 30), st.integers(1, 400)), min_size=1, max_size=12),
    st.sampled_from((100.0, 700.0)),
)
def test_errors_are_independent_of_blocks(blocks: list[tuple[int, int]], rate: float) -> None:
    """Blocks of any length, with samples in between that are never read."""
    first = math.ceil(T0 * rate)
    pieces, at = sensor_of(ALL, rate, swing_source()), 0
    for left_out, size in blocks:
        at += left_out
        read = pieces.outputs(first + at, first + at + size - 1)
        assert np.array_equal(read, all_samples(rate)[at : at + size])
        at += size


def test_recomputed_samples_ignore_predicted_ones() -> None:
    rate, first = 100.0, math.ceil(T0 * 100.0)
    for changed, requested in itertools.product((37, 250), (0, 3)):
        load = [1.0]
        source = KnownWrench(
            lambda times, load=load, changed=changed: np.outer(  # type: ignore[misc]
                np.where(times < T0 + changed / rate - 1e-6, 1.0, load[0]), np.full(6, 10.0)
            ),
            predicted_until=lambda now: now + 8.0,
        )
        sensor = sensor_of(ALL, rate, source)
        sensor.outputs(first, first + changed - 1)
        load[0] = 3.0
        source.on_change(T0 + changed / rate)
        again = sensor.outputs(first + changed + requested, first + 500)
        fresh = sensor_of(ALL, rate, source).outputs(first, first + 500)
        assert np.array_equal(again, fresh[changed + requested :])


def test_seeds_give_different_errors() -> None:
    one, other = (values(sensor_of(ALL, 100.0, swing_source(), seed), 100.0, 5.0) for seed in (1, 2))
    assert np.all(np.std(one - other, axis=0)[:3] > 0.1)


def test_long_unread_sensor_assumes_constant_load() -> None:
    errors = SensorErrors(since=T0, creep_share=0.01, creep_s=5.0)
    sensor = sensor_of(errors, 100.0, KnownWrench(pressed))
    first = math.ceil(T0 * 100.0)
    sensor.outputs(first, first + 1)
    assert sensor.outputs(first + 20000, first + 20000)[0, 2] / 1e6 == pytest.approx(-10.0, abs=1e-6)


# --- settings


@pytest.mark.parametrize(("profile"), [NetFtProfile, Ft300Profile])
def test_one_number_applies_to_all_axes(profile: Callable[..., Any]) -> None:
    assert per_axis(profile(noise_n=0.1).noise_n) == (0.1, 0.1, 0.1)
    with pytest.raises(SettingError, match=r"noise_nm must be one value or three, got 2"):
        profile(noise_nm=(0.1, 0.2))
    with pytest.raises(SettingError, match=r"vibration_hz must be two ascending frequencies"):
        profile(vibration_hz=(16.0, 9.0))


@pytest.mark.parametrize("profile", [NetFtProfile, Ft300Profile, AtiCanProfile])
def test_errors_can_be_turned_off(profile: Callable[..., Any]) -> None:
    errors = unrest(profile(**SETTLED), T0)
    assert not errors.mechanical
    assert not errors.of_zero
    assert not errors.distorting


def test_errors_appear_in_net_box_records() -> None:
    """A bias removes the present value, including the random walk."""
    profile = NetFtProfile(boot_s=0.0, noise_n=0.0, noise_nm=0.0, **{**SETTLED, "wander_n": 1.0})
    box = NetBox(profile, KnownWrench(unloaded), T0, 7)
    measured = sensor_of(unrest(profile, T0), 7000.0)
    number = math.ceil((T0 + 20.0) * 7000.0)
    assert box._measured.outputs(number, number)[0] == pytest.approx(measured.outputs(number, number)[0])
    assert measured.outputs(number, number)[0, :3].any()
