"""Output of a sensor's converter: the true wrench with faults of the signal, as whole numbers with noise and ends."""

import math
from collections import deque
from dataclasses import dataclass, field

import numpy as np

from emulators.seams import Floats, WrenchSource
from emulators.sensing.samples import NumberedNoise, Samples
from emulators.sensing.signal import Signal
from emulators.sensing.unrest import Mechanics, Unrest, ZeroWander

_AT_END_MAX = 4096
"""Chosen: samples at an end that are remembered, as many as are read ahead at most."""


@dataclass(frozen=True, slots=True, eq=False)
class Converter:
    """Conversion of a wrench to six whole numbers."""

    matrix: Floats
    """(6, 6): outputs, in rows, for one N or N·m of each axis, in columns."""
    noise: Floats
    """(6,), rms, in outputs."""
    low: Floats
    """(6,): the least outputs; there the converter is at its end."""
    high: Floats
    """(6,): the largest."""
    offset: float = 0.0
    """Output without a wrench."""
    unrest: Unrest = field(default_factory=Unrest)
    """Errors beside the noise."""


class MeasuredWrench:
    """Samples at `rate_hz` on the absolute grid, by number. `signal` has the handlers of the faults.

    A sample is that of its time when it is asked for, so ask for none ahead of its time.
    """

    def __init__(
        self, source: WrenchSource, rate_hz: float, converter: Converter, seed: int, noise_setting: str
    ) -> None:
        """`noise_setting` is the setting that gives noise to a sensor without any."""
        self._source = source
        self._rate = rate_hz
        self._converter = converter
        self._low, self._high = converter.low[:, np.newaxis], converter.high[:, np.newaxis]
        self._inside = float(converter.low.max()), float(converter.high.min())
        """Between these every output is inside the ends of its axis."""
        self._quiet = not converter.noise.any()
        self._noise = NumberedNoise(converter.noise[:, np.newaxis], seed)
        self._at_end: deque[int] = deque(maxlen=_AT_END_MAX)
        """Numbers, ascending, of samples of which an output is at an end of the converter."""
        unrest = converter.unrest
        self._mechanics = Mechanics(unrest, source, rate_hz, seed) if unrest.mechanical else None
        self._wander = ZeroWander(unrest, rate_hz, converter.matrix, seed) if unrest.of_zero else None
        self._samples = Samples(source, rate_hz, self._make)
        self.on_invalidate = self._samples.on_invalidate
        """Called with the number of the first output that may differ from the one that was read ahead."""
        if self._mechanics is not None:
            self.on_invalidate.append(self._mechanics.forget)
        needs = noise_setting if self._quiet else ""
        self.signal = Signal(rate_hz, needs, self._samples.invalidate_from)

    def number_at(self, time: float) -> int:
        """Return the number of the newest sample at a time, s."""
        return math.floor(time * self._rate + 1e-6)  # a millionth keeps rounding from missing one

    def first_after(self, time: float) -> int:
        """Return the number of the first sample later than a time, s."""
        return self.number_at(time) + 1

    def outputs(self, first: int, last: int) -> Floats:
        """Return outputs (n, 6) of the samples from one number to another, integers; numbers do not decrease."""
        return self._samples.starting(first, last)[: last - first + 1]

    def outputs_ahead(self, first: int, last: int) -> Floats:
        """Return the same, and those behind as far as they are predicted, for a reader that minds `on_invalidate`."""
        return self._samples.starting(first, last)

    def last_at_end(self, first: int, last: int) -> int | None:
        """Return the number of the newest sample in a range, read before, with an output at an end of the converter.

        None if there is none.
        """
        if not self._at_end:  # as nearly always
            return None
        return max((number for number in self._at_end if first <= number <= last), default=None)

    def _make(self, first: int, stop: int) -> Floats:
        wrench = self._source.wrench(np.arange(first, stop) / self._rate).T
        if self._mechanics is not None:
            wrench = np.array(wrench)
            self._mechanics.add(wrench, first)
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
        if not faulty and low < outputs.min() and outputs.max() < high:  # as nearly always
            self._forget_ends(first)
            return outputs.T
        np.maximum(outputs, self._low, out=outputs)  # np.clip takes half as long again
        np.minimum(outputs, self._high, out=outputs)
        if faulty:
            self.signal.output(outputs, first)
        self._note_ends(outputs, first)
        return outputs.T

    def _note_ends(self, outputs: Floats, first: int) -> None:
        """Remember which of these samples (6, n) are at an end; they replace those made of the same numbers before."""
        self._forget_ends(first)
        at_end = (outputs <= self._low) | (outputs >= self._high)
        if np.count_nonzero(at_end):
            self._at_end.extend((first + np.flatnonzero(at_end.any(axis=0))).tolist())

    def _forget_ends(self, first: int) -> None:
        """Make the samples from this number on again."""
        while self._at_end and self._at_end[-1] >= first:
            self._at_end.pop()
