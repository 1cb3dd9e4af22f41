"""A JR3 sensor up to its serial link: wrench in, samples at 8 kHz out, with noise and saturation.

A gateway takes counts of the wrench; a receiver board takes the raw channels, which the sensor's calibration
decouples.
"""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from emulators.seams import WrenchSource
from emulators.sensing import NumberedNoise, Samples
from emulators.sensing.signal import Signal
from protocol.devices.jr3 import FULL_SCALE_COUNTS
from protocol.marks import Mark, SettingError, at_least, between, check_settings, setting

SENSOR_RATE_HZ = 8000
"""Source: JR3 manual 5907E."""
_AXES = 6
_SINGULAR = 1e6
"""Condition number from which six channels do not tell six axes apart."""


@dataclass(frozen=True)
class SensorProfile:
    """Which sensor, and how good."""

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    full_scales_n: tuple[float, float, float] = setting(
        (115.0, 111.0, 185.0),
        Mark.OBSERVED,
        "fx fy fz, whole N (a wrist sensor on CAN)",
        between(1.0, 65535.0),
        unit="N",
    )
    full_scales_nm: tuple[float, float, float] = setting(
        (5.6, 5.2, 6.1),
        Mark.OBSERVED,
        "mx my mz, whole 0.1 N·m (a wrist sensor on CAN)",
        between(0.1, 6553.5),
        unit="N·m",
    )
    noise_counts: float = setting(
        1.0, Mark.DERIVED, "noise of every axis, rms; recordings show 0.5 … 2.8", at_least(0.0), unit="counts"
    )
    adc_bits: int = setting(
        14, Mark.ASSUMED, "resolution of the converter: sets where counts saturate", between(12, 16)
    )
    connected: bool = setting(True, Mark.CHOSEN, "whether the sensor is plugged in")
    coupling: tuple[float, ...] = setting(
        (),
        Mark.ASSUMED,
        "what each axis, fx first, shows on the raw channels 1 … 6, as parts of full scale: 36 values, "
        "six for every axis; empty = every axis on its own channel",
    )

    def __post_init__(self) -> None:
        check_settings(self)
        for name in ("full_scales_n", "full_scales_nm"):
            if len(getattr(self, name)) != 3:
                raise SettingError(name, f"must be three values, got {len(getattr(self, name))}")
        if len(self.coupling) not in (0, _AXES * _AXES):
            raise SettingError("coupling", f"must be 36 values or none, got {len(self.coupling)}")
        if not (np.isfinite(self.coupling).all() and np.linalg.cond(self.coupling_matrix) < _SINGULAR):
            raise SettingError("coupling", "must be a matrix that can be inverted")

    @property
    def full_scale_words(self) -> tuple[int, ...]:
        """The six full scales as calibration and wire hold them: N and N·m×10."""
        return (
            *(round(value) for value in self.full_scales_n),
            *(round(v * 10) for v in self.full_scales_nm),
        )

    @property
    def coupling_matrix(self) -> NDArray[np.float64]:
        """Parts of full scale on the raw channels (columns) for full scale of each axis (rows)."""
        return np.reshape(self.coupling, (_AXES, _AXES)) if self.coupling else np.eye(_AXES)

    @property
    def saturation_counts(self) -> int:
        """Most positive count: 32768 − 2^(16 − bits)."""
        return 32768 - (1 << (16 - self.adc_bits))


class Jr3Sensor:
    """Samples on the absolute grid k/8000 s, computed as arrays when a receiver reads them."""

    def __init__(self, profile: SensorProfile, source: WrenchSource, seed: int) -> None:
        self._source = source
        self._samples = samples = Samples(source, SENSOR_RATE_HZ, self._counts)
        self.on_invalidate = samples.on_invalidate
        """Called with the number of the first sample that may differ from the one that was read ahead."""
        self.invalidate = samples.invalidate
        """Samples from a time on, s, are others than could be read."""
        self.committed_until = samples.committed_until
        """Time up to which samples may be read ahead, at least the given present, s."""
        self.predicted_until = samples.predicted_until
        """The same for a reader that minds `on_invalidate`."""
        self.counts_from = samples.starting
        """Six counts of each sample, whole numbers (n, 6). The samples are those from the first number to the second,
        the newest at present, and further ones as far as they are predicted.
        """
        self._noise = NumberedNoise(profile.noise_counts, seed)
        self._become(profile)
        needs = "" if profile.noise_counts else "cell.jr3.sensor.noise_counts"
        self.signal = Signal(SENSOR_RATE_HZ, needs, samples.invalidate_from)
        """Faults before the converter."""

    def exchange(self, profile: SensorProfile, now: float) -> None:
        """From now on, s, another sensor measures, as noisy as this one: only full scales and coupling differ."""
        if profile != self.profile:
            self._become(profile)
            self.invalidate(now)

    def _become(self, profile: SensorProfile) -> None:
        self.profile = profile
        words = np.array(profile.full_scale_words, dtype=np.float64)
        self._counts_per_unit = FULL_SCALE_COUNTS / (words * [1, 1, 1, 0.1, 0.1, 0.1])
        self._saturation_counts = float(profile.saturation_counts)
        self._raw_per_wrench = self._counts_per_unit[:, np.newaxis] * profile.coupling_matrix
        self.calibration: NDArray[np.float64] = np.asarray(np.linalg.inv(self._raw_per_wrench), np.float64)
        """Matrix (6, 6) from raw channels 1 … 6 to N and N·m: wrench = raw @ calibration."""

    def counts(self, indices: NDArray[np.int64]) -> NDArray[np.int64]:
        """Six counts (n, 6) of the samples with these numbers k, which do not fall.

        Noise belongs to the sample number: it is the same whatever the blocks in which samples are read.
        """
        if not len(indices):
            return np.empty((0, _AXES), dtype=np.int64)
        first, last = int(indices[0]), int(indices[-1])
        return self.counts_from(first, last).take(indices - first, axis=0).astype(np.int64)

    def _counts(self, first: int, stop: int) -> NDArray[np.float64]:
        """Six counts (n, 6) of the samples from number `first` to before `stop`."""
        # One row an axis: numpy is quickest along the last dimension, and six is too short for it.
        counts = self._wrench(first, stop) * self._counts_per_unit[:, np.newaxis]
        self._add_noise(counts, first)
        # Assumed: rounded to nearest.
        np.rint(counts, out=counts)
        counts.clip(-32768.0, self._saturation_counts, out=counts)
        if self.signal.faulty:
            self.signal.output(counts, first)
        return counts.T

    def _wrench(self, first: int, stop: int) -> NDArray[np.float64]:
        """Wrench (6, n) before the converter of the samples from number `first` to before `stop`, N and N·m."""
        wrench = self._source.wrench(np.arange(first, stop) / SENSOR_RATE_HZ).T
        return self.signal.wrench(wrench, first) if self.signal.faulty else wrench

    def raw(self, first: int, stop: int) -> NDArray[np.int64]:
        """Return the converter readings (n, 6) of raw channels 1 … 6.

        They belong to the samples from number `first` to before `stop`.

        Left-justified in 16 bits, so that they rise in steps of 2^(16 − bits). Assumed: twice full scale of an
        axis is the converter's range, and the noise of an axis is that of its channel before conversion.
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
