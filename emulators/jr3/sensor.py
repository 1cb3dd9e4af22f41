"""A JR3 sensor up to its serial link: wrench in, samples at 8 kHz out, with noise and saturation.

A gateway takes counts of the wrench; a receiver board takes the raw channels, which the sensor's calibration
decouples.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from emulators.jr3.signal import Signal
from protocol.jr3 import FULL_SCALE_COUNTS
from protocol.marks import Mark, check_settings, setting

SENSOR_RATE_HZ = 8000
"""Source: JR3 manual 5907E."""
_AXES = 6
_SINGULAR = 1e6
"""Condition number from which six channels do not tell six axes apart."""
_AHEAD = 4096
"""Chosen: most samples computed before anybody asks for them."""
_CHUNK = 1024
"""Samples of noise drawn at once; part of what a seed means, so not to be changed."""
_CHUNKS = 4
"""Chosen: as many as what may be forgotten and asked for again lies in."""


def _nobody(time: float) -> None:
    """The wrench has no memory."""


@dataclass(frozen=True)
class SensorProfile:
    """Which sensor, and how good."""

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    full_scales_n: tuple[float, float, float] = setting(
        (115.0, 111.0, 185.0),
        Mark.OBSERVED,
        "fx fy fz, whole N (a wrist sensor on CAN)",
        unit="N",
        minimum=1.0,
        maximum=65535.0,
    )
    full_scales_nm: tuple[float, float, float] = setting(
        (5.6, 5.2, 6.1),
        Mark.OBSERVED,
        "mx my mz, whole 0.1 N·m (a wrist sensor on CAN)",
        unit="N·m",
        minimum=0.1,
        maximum=6553.5,
    )
    noise_counts: float = setting(
        1.0, Mark.DERIVED, "noise of every axis, rms; recordings show 0.5 … 2.8", unit="counts", minimum=0.0
    )
    adc_bits: int = setting(
        14, Mark.ASSUMED, "resolution of the converter: sets where counts saturate", minimum=12, maximum=16
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
                raise ValueError(f"{name} must be three values, got {len(getattr(self, name))}")
        if len(self.coupling) not in (0, _AXES * _AXES):
            raise ValueError(f"coupling must be 36 values or none, got {len(self.coupling)}")
        if not (np.isfinite(self.coupling).all() and np.linalg.cond(self.coupling_matrix) < _SINGULAR):
            raise ValueError("coupling must be a matrix that can be inverted")

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
    """Samples on the absolute grid k/8000 s, computed as arrays when somebody reads them.

    `wrench_at` is given times (n,) in s that never run backwards as long as the reader's do not, and
    answers with the wrench (n, 6) on the sensor in the sensor frame, N and N·m. `certain_until` is given the
    present time and tells up to which time the wrench can be asked for already and will not change any more;
    `foreseen_until` likewise up to which time it can be asked for by whoever has it say by `forget` when it changes.
    """

    def __init__(
        self,
        profile: SensorProfile,
        wrench_at: Callable[[NDArray[np.float64]], NDArray[np.float64]],
        seed: int,
        certain_until: Callable[[float], float] | None = None,
        foreseen_until: Callable[[float], float] | None = None,
    ) -> None:
        self.profile = profile
        self.on_forget: list[Callable[[int], object]] = []
        """Told the number of the first sample that may be another than was read ahead of what is certain."""
        self.on_change: Callable[[float], object] = _nobody
        """Told the time, s, from which on samples are computed anew, for the wrench at these times is asked again."""
        self._wrench_at = wrench_at
        self._certain_until = certain_until
        self._foreseen_until = foreseen_until
        # A counter-based generator reaches every chunk at once; the upper words keep chunks apart.
        self._bits = np.random.Philox(key=seed % 2**128, counter=0)
        self._bits_begin = self._bits.state
        self._random = np.random.Generator(self._bits)
        words = np.array(profile.full_scale_words, dtype=np.float64)
        self._counts_per_unit = FULL_SCALE_COUNTS / (words * [1, 1, 1, 0.1, 0.1, 0.1])
        self._saturation_counts = float(profile.saturation_counts)
        self._raw_per_wrench = self._counts_per_unit[:, np.newaxis] * profile.coupling_matrix
        self.calibration: NDArray[np.float64] = np.asarray(np.linalg.inv(self._raw_per_wrench), np.float64)
        """What makes a wrench in N and N·m of raw channels 1 … 6: wrench = raw @ calibration."""
        self._ready = np.empty((0, _AXES))
        """Counts of the samples from number `_ready_from` on that were computed already."""
        self._ready_from = 0
        self._chunks: dict[int, NDArray[np.float64]] = {}
        """Noise that was drawn last, by its number."""
        self.signal = Signal(SENSOR_RATE_HZ, profile.noise_counts, self.change)
        """What can go wrong before the converter."""

    def counts(self, indices: NDArray[np.int64]) -> NDArray[np.int64]:
        """Six counts (n, 6) of the samples with these numbers k, which do not fall.

        Noise belongs to the sample number: it is the same whatever the blocks in which samples are read.
        """
        if not len(indices):
            return np.empty((0, _AXES), dtype=np.int64)
        first, last = int(indices[0]), int(indices[-1])
        return self.counts_from(first, last).take(indices - first, axis=0).astype(np.int64)

    def counts_from(self, first: int, last: int) -> NDArray[np.float64]:
        """Six counts (n, 6), whole numbers, of sample number `first` and all after it: to `last`, the newest that
        there is at present, and on behind it as far as they are certain, or foreseen: see `on_forget`.
        """
        begin, ready = self._ready_from, self._ready_from + len(self._ready)
        if not begin <= first <= ready:
            begin = ready = first
        if last >= ready:
            ahead = math.floor(self.foreseen_until(last / SENSOR_RATE_HZ) * SENSOR_RATE_HZ)
            fresh = self._counts(ready, max(last + 1, min(ahead, last + _AHEAD)))
            # What was read last is kept: a reader may begin anew at the same moment.
            self._ready = np.concatenate((self._ready[first - begin :], fresh)) if ready > first else fresh
            begin = self._ready_from = first
        return self._ready[first - begin :]

    def forget(self, certain_until: float) -> None:
        """What was foreseen comes otherwise from this time on, s."""
        self._forget_from(math.floor(certain_until * SENSOR_RATE_HZ))

    def change(self, number: int) -> None:
        """Samples from this number on are others, whatever was certain or foreseen of them."""
        self.on_change(number / SENSOR_RATE_HZ)
        self._forget_from(number)

    def _forget_from(self, certain: int) -> None:
        """The same by the number of the first sample that is not certain."""
        self._ready = self._ready[: max(certain - self._ready_from, 0)]
        for tell in self.on_forget:
            tell(certain)

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
        wrench = self._wrench_at(np.arange(first, stop) / SENSOR_RATE_HZ).T
        return self.signal.wrench(wrench, first) if self.signal.faulty else wrench

    def certain_until(self, now: float) -> float:
        """Time up to which samples may be read ahead, at least `now`, s."""
        return now if self._certain_until is None else max(now, self._certain_until(now))

    def foreseen_until(self, now: float) -> float:
        """Time up to which samples may be read ahead by whoever minds `on_forget`, at least `now`, s."""
        return (
            self.certain_until(now) if self._foreseen_until is None else max(now, self._foreseen_until(now))
        )

    def raw(self, first: int, stop: int) -> NDArray[np.int64]:
        """Converter readings (n, 6) of raw channels 1 … 6 of the samples from number `first` to before `stop`.

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
        """To six rows (6, n) of the samples from number `first` on."""
        if not self.profile.noise_counts:
            return
        stop = first + counts.shape[1]
        for number in range(first // _CHUNK, (stop - 1) // _CHUNK + 1):
            begin = number * _CHUNK
            here, end = max(first, begin), min(stop, begin + _CHUNK)
            noise = self._noise_chunk(number)[:, here - begin : end - begin]
            counts[:, here - first : end - first] += (
                self.signal.noise(noise, here) if self.signal.faulty else noise
            )

    def _noise_chunk(self, number: int) -> NDArray[np.float64]:
        chunk = self._chunks.get(number)
        if chunk is None:
            self._bits_begin["state"]["counter"][2] = number % 2**64
            self._bits.state = self._bits_begin
            noise = self._random.standard_normal((_CHUNK, _AXES))
            chunk = np.ascontiguousarray(noise.T)
            chunk *= self.profile.noise_counts
            self._chunks[number] = chunk
            if len(self._chunks) > _CHUNKS:
                del self._chunks[next(iter(self._chunks))]
        return chunk
