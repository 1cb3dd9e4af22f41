"""Output of a sensor's converter: the true wrench with signal faults and noise, rounded to integers and clipped."""

import math
from collections import deque
from dataclasses import dataclass, field

import numpy as np

from emulators.seams import Floats, WrenchSource
from emulators.sensing.distortion import Distortion
from emulators.sensing.samples import NumberedNoise, Samples
from emulators.sensing.signal import Signal
from emulators.sensing.unrest import Mechanics, SensorErrors, ZeroWander

_AT_END_MAX = 4096
"""Maximum number of clipped samples that are remembered. Chosen: the maximum number of samples that are read ahead."""


@dataclass(frozen=True, slots=True, eq=False)
class Converter:
    """Conversion of a wrench to six integer outputs."""

    matrix: Floats
    """Outputs, in rows, per N or N·m of each axis, in columns (6, 6)."""
    noise: Floats
    """Noise of the outputs (6,), rms, in units of the output."""
    low: Floats
    """Smallest possible outputs (6,), at which the converter clips."""
    high: Floats
    """Largest possible outputs (6,), at which the converter clips."""
    offset: float = 0.0
    """Output of every axis for a zero wrench."""
    unrest: SensorErrors = field(default_factory=SensorErrors)
    """Errors in addition to the white noise."""
    full_scale: Floats | None = None
    """Full scale of each axis (6,), N and N·m; by default the load of this axis alone at which an output clips."""

    @property
    def full_scales(self) -> Floats:
        """Full scale of each axis (6,), N and N·m."""
        if self.full_scale is not None:
            return self.full_scale
        with np.errstate(divide="ignore"):
            scales: Floats = np.abs(self.high[:, np.newaxis] / self.matrix).min(axis=0)
        return scales


class MeasuredWrench:
    """Samples at `rate_hz` on the absolute time grid, by number. `signal` has the handlers of the faults.

    A sample gets its value when it is read, so do not read a sample before its time.
    """

    def __init__(
        self, source: WrenchSource, rate_hz: float, converter: Converter, seed: int, noise_setting: str
    ) -> None:
        """`noise_setting` is the name of the setting that adds noise to a noiseless sensor."""
        self._source = source
        self._rate = rate_hz
        self._converter = converter
        self._low, self._high = converter.low[:, np.newaxis], converter.high[:, np.newaxis]
        self._inside = float(converter.low.max()), float(converter.high.min())
        """Range of outputs in which no axis clips."""
        self._quiet = not converter.noise.any()
        self._noise = NumberedNoise(converter.noise[:, np.newaxis], seed)
        self._at_end: deque[int] = deque(maxlen=_AT_END_MAX)
        """Numbers, in ascending order, of the samples with an output at a limit of the converter."""
        unrest = converter.unrest
        self._mechanics = Mechanics(unrest, source, rate_hz, seed) if unrest.mechanical else None
        self._distortion = (
            Distortion(unrest, converter.full_scales, rate_hz, seed) if unrest.distorting else None
        )
        self._wander = ZeroWander(unrest, rate_hz, converter.matrix, seed) if unrest.of_zero else None
        self._samples = Samples(source, rate_hz, self._make)
        self.on_invalidate = self._samples.on_invalidate
        """Callback for the number of the first output that may differ from the output that was read ahead."""
        if self._mechanics is not None:
            self.on_invalidate.append(self._mechanics.forget)
        if self._distortion is not None:
            self.on_invalidate.append(self._distortion.forget)
        needs = noise_setting if self._quiet else ""
        self.signal = Signal(rate_hz, needs, self._samples.invalidate_from)

    def number_at(self, time: float) -> int:
        """Return the number of the newest sample at a given time, s."""
        return math.floor(time * self._rate + 1e-6)  # a margin of one millionth allows for rounding

    def first_after(self, time: float) -> int:
        """Return the number of the first sample after a given time, s."""
        return self.number_at(time) + 1

    def outputs(self, first: int, last: int) -> Floats:
        """Return integer outputs (n, 6) of the samples from `first` to `last`.

        Successive calls must not decrease the numbers.
        """
        return self._samples.starting(first, last)[: last - first + 1]

    def outputs_ahead(self, first: int, last: int) -> Floats:
        """Return outputs from `first` on, including predicted outputs, for a reader that handles `on_invalidate`."""
        return self._samples.starting(first, last)

    def last_at_end(self, first: int, last: int) -> int | None:
        """Return the number of the newest sample in a range that has an output at a limit of the converter.

        The result is None if there is no such sample. The samples must have been read before.
        """
        if not self._at_end:  # nearly always
            return None
        return max((number for number in self._at_end if first <= number <= last), default=None)

    def _make(self, first: int, stop: int) -> Floats:
        distortion = self._distortion
        wrench = self._load(first, stop) if distortion is None else distortion.loads(self._load, first, stop)
        faulty = self.signal.faulty
        outputs = self._converter.matrix @ (self.signal.wrench(wrench, first) if faulty else wrench)
        if self._converter.offset:
            outputs += self._converter.offset
        if self._wander is not None:
            self._wander.add(outputs, first)
        if not self._quiet:
            self._noise.add(outputs, first, self.signal.noise if faulty else None)
        np.rint(outputs, out=outputs)
        low, high = self._inside
        if not faulty and low < outputs.min() and outputs.max() < high:  # nearly always
            self._forget_ends(first)
            return outputs.T
        np.maximum(outputs, self._low, out=outputs)  # np.clip takes 1.5 times as long
        np.minimum(outputs, self._high, out=outputs)
        if faulty:
            self.signal.output(outputs, first)
        self._record_ends(outputs, first)
        return outputs.T

    def _load(self, first: int, stop: int) -> Floats:
        """Return the load (6, n) of the samples `first` … `stop` − 1, including creep and vibration."""
        wrench = self._source.wrench(np.arange(first, stop) / self._rate).T
        return wrench if self._mechanics is None else self._mechanics.load(wrench, first)

    def _record_ends(self, outputs: Floats, first: int) -> None:
        """Record which of these samples (6, n) are clipped. They replace earlier samples with the same numbers."""
        self._forget_ends(first)
        at_end = (outputs <= self._low) | (outputs >= self._high)
        if np.count_nonzero(at_end):
            self._at_end.extend((first + np.flatnonzero(at_end.any(axis=0))).tolist())

    def _forget_ends(self, first: int) -> None:
        """Drop the records of the samples from this number on."""
        while self._at_end and self._at_end[-1] >= first:
            self._at_end.pop()
