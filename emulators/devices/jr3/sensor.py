"""JR3 sensor up to its serial link: it converts a wrench to samples at 8 kHz, with noise and saturation.

A gateway receives counts of the wrench. A receiver board receives the raw channels, which the sensor's calibration
decouples.
"""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from emulators.seams import WrenchSource
from emulators.sensing import NumberedNoise, Samples
from emulators.sensing import settings as errors
from emulators.sensing.distortion import Distortion
from emulators.sensing.signal import Signal
from emulators.sensing.unrest import SensorErrors
from protocol.devices.jr3 import FULL_SCALE_COUNTS
from protocol.geometry import Vector
from protocol.marks import Mark, SettingError, at_least, between, check_settings, setting

SENSOR_RATE_HZ = 8000
"""Sample rate, Hz. Source: JR3 manual 5907E."""
_AXES = 6
_SINGULAR = 1e6
"""Condition number from which six channels do not separate six axes."""


@dataclass(frozen=True)
class SensorProfile:
    """Type and quality of the sensor."""

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    full_scales_n: tuple[float, float, float] = setting(
        (115.0, 111.0, 185.0),
        Mark.OBSERVED,
        "full scales of fx fy fz, integer N (a wrist sensor on CAN)",
        between(1.0, 65535.0),
        unit="N",
    )
    full_scales_nm: tuple[float, float, float] = setting(
        (5.6, 5.2, 6.1),
        Mark.OBSERVED,
        "full scales of mx my mz, multiples of 0.1 N·m (a wrist sensor on CAN)",
        between(0.1, 6553.5),
        unit="N·m",
    )
    stiffness_n_m: Vector = setting((9.1e6, 9.1e6, 1.8e7), Mark.ASSUMED, *errors.STIFFNESS_N_M)
    """This and the next setting are those of a strain-gauge sensor with similar full scales, an ATI Gamma. JR3's tables
    are not public.
    """
    stiffness_nm_rad: Vector = setting((1.1e4, 1.1e4, 1.6e4), Mark.ASSUMED, *errors.STIFFNESS_NM_RAD)
    noise_counts: float = setting(
        1.0, Mark.DERIVED, "noise of each axis, rms; recordings show 0.5 … 2.8", at_least(0.0), unit="counts"
    )
    adc_bits: int = setting(
        14,
        Mark.ASSUMED,
        "resolution of the A/D converter in bits, which decides where counts saturate",
        between(12, 16),
    )
    connected: bool = setting(True, Mark.CHOSEN, "a sensor is connected")
    hysteresis_share: float = setting(0.0, Mark.ASSUMED, *errors.HYSTERESIS_SHARE)
    cross_talk_share: float = setting(0.0, Mark.ASSUMED, *errors.CROSS_TALK_SHARE)
    coupling: tuple[float, ...] = setting(
        (),
        Mark.ASSUMED,
        "signal of each axis, fx first, on the raw channels 1 … 6, as a fraction of full scale: "
        "36 values, six per axis; empty: each axis on its own channel",
    )

    def __post_init__(self) -> None:
        check_settings(self)
        for name in ("full_scales_n", "full_scales_nm"):
            if len(getattr(self, name)) != 3:
                raise SettingError(name, f"must be three values, got {len(getattr(self, name))}")
        if len(self.coupling) not in (0, _AXES * _AXES):
            raise SettingError("coupling", f"must be 36 values or none, got {len(self.coupling)}")
        if not (np.isfinite(self.coupling).all() and np.linalg.cond(self.coupling_matrix) < _SINGULAR):
            raise SettingError("coupling", "must be an invertible matrix")

    @property
    def full_scale_words(self) -> tuple[int, ...]:
        """Full scales as in calibration and messages, six words: N and N·m×10."""
        return (
            *(round(value) for value in self.full_scales_n),
            *(round(v * 10) for v in self.full_scales_nm),
        )

    @property
    def coupling_matrix(self) -> NDArray[np.float64]:
        """Signal on each raw channel (columns) at full scale of each axis (rows), as shares of full scale."""
        return np.reshape(self.coupling, (_AXES, _AXES)) if self.coupling else np.eye(_AXES)

    @property
    def saturation_counts(self) -> int:
        """Largest positive count: 32768 − 2^(16 − bits)."""
        return 32768 - (1 << (16 - self.adc_bits))


class Jr3Sensor:
    """Samples on the absolute grid k/8000 s, computed as arrays when a receiver reads them."""

    def __init__(
        self, profile: SensorProfile, source: WrenchSource, seed: int, powered_at: float = 0.0
    ) -> None:
        """`powered_at` is the time from which hysteresis acts, s."""
        self._source, self._seed, self._powered_at = source, seed, powered_at
        self._samples = samples = Samples(source, SENSOR_RATE_HZ, self._counts)
        self.on_invalidate = samples.on_invalidate
        """Functions to call with the number of the first sample that may differ from the one read ahead."""
        self.invalidate = samples.invalidate
        """Declare that samples from a time on, s, differ from the samples read ahead."""
        self.committed_until = samples.committed_until
        """Return the time up to which samples may be read ahead, s; never earlier than the current time passed to
        it.
        """
        self.predicted_until = samples.predicted_until
        """Return the time up to which a reader may read ahead if it handles `on_invalidate`, s."""
        self.counts_from = samples.starting
        """Return the six counts of each sample, integers (n, 6), from the first number to the second, which is the
        newest sample now. Further samples follow as far as they are predicted.
        """
        self.on_invalidate.append(self._forget)
        self._noise = NumberedNoise(profile.noise_counts, seed)
        self._become(profile)
        needs = "" if profile.noise_counts else "cell.jr3.sensor.noise_counts"
        self.signal = Signal(SENSOR_RATE_HZ, needs, samples.invalidate_from)
        """Faults that act before the converter."""

    def exchange(self, profile: SensorProfile, now: float) -> None:
        """Replace the sensor at a time, s, by another one with equal noise. Only full scales and coupling differ."""
        if profile != self.profile:
            self._become(profile)
            self.invalidate(now)

    def _become(self, profile: SensorProfile) -> None:
        self.profile = profile
        words = np.array(profile.full_scale_words, dtype=np.float64)
        full_scales = words * [1, 1, 1, 0.1, 0.1, 0.1]
        self._counts_per_unit = FULL_SCALE_COUNTS / full_scales
        distortion = SensorErrors(
            since=self._powered_at,
            hysteresis_share=profile.hysteresis_share,
            cross_talk_share=profile.cross_talk_share,
        )
        self._distortion = (
            Distortion(distortion, full_scales, SENSOR_RATE_HZ, self._seed) if distortion.distorting else None
        )
        self._saturation_counts = float(profile.saturation_counts)
        self._raw_per_wrench = self._counts_per_unit[:, np.newaxis] * profile.coupling_matrix
        self.calibration: NDArray[np.float64] = np.asarray(np.linalg.inv(self._raw_per_wrench), np.float64)
        """Matrix (6, 6) from raw channels 1 … 6 to N and N·m: wrench = raw @ calibration."""

    def counts(self, indices: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the six counts (n, 6) of the samples with these numbers, which do not decrease.

        Noise depends only on the sample number, not on the blocks in which samples are read.
        """
        if not len(indices):
            return np.empty((0, _AXES), dtype=np.int64)
        first, last = int(indices[0]), int(indices[-1])
        return self.counts_from(first, last).take(indices - first, axis=0).astype(np.int64)

    def _counts(self, first: int, stop: int) -> NDArray[np.float64]:
        """Return the six counts (n, 6) of the samples `first` … `stop` − 1."""
        # One row per axis: numpy is fastest along the last dimension, and a length of six is too short.
        counts = self._wrench(first, stop) * self._counts_per_unit[:, np.newaxis]
        self._add_noise(counts, first)
        # Assumed: rounded to nearest.
        np.rint(counts, out=counts)
        counts.clip(-32768.0, self._saturation_counts, out=counts)
        if self.signal.faulty:
            self.signal.output(counts, first)
        return counts.T

    def _wrench(self, first: int, stop: int) -> NDArray[np.float64]:
        """Return the wrench (6, n) before the converter of the samples `first` … `stop` − 1, N and N·m."""
        distortion = self._distortion
        wrench = self._load(first, stop) if distortion is None else distortion.loads(self._load, first, stop)
        return self.signal.wrench(wrench, first) if self.signal.faulty else wrench

    def _load(self, first: int, stop: int) -> NDArray[np.float64]:
        return self._source.wrench(np.arange(first, stop) / SENSOR_RATE_HZ).T

    def _forget(self, number: int) -> None:
        if self._distortion is not None:
            self._distortion.forget(number)

    def raw(self, first: int, stop: int) -> NDArray[np.int64]:
        """Return the converter readings (n, 6) of raw channels 1 … 6 for the samples `first` … `stop` − 1.

        They are left-justified in 16 bits, hence in steps of 2^(16 − bits). Assumed: the converter's range is twice
        the full scale of an axis, and an axis has the noise of its channel before conversion.
        """
        step = 1 << (16 - self.profile.adc_bits)
        channels = self._raw_per_wrench.T @ self._wrench(first, stop)
        self._add_noise(channels, first)
        if step > 1:
            channels /= step
        np.rint(channels, out=channels)
        if step > 1:
            channels *= step
        channels.clip(-32768.0, self._saturation_counts, out=channels)
        if self.signal.faulty:
            self.signal.output(channels, first)
        return channels.T.astype(np.int64)

    def _add_noise(self, counts: NDArray[np.float64], first: int) -> None:
        """Add noise to six rows (6, n) of the samples from number `first` on."""
        if self.profile.noise_counts:
            self._noise.add(counts, first, self.signal.noise if self.signal.faulty else None)
