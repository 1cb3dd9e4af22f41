"""Computation of every word from the raw channels, a block of samples at a time.

raw channels → decoupled, translated and rotated, in counts of full scale → minus offsets → filter0 → filter1 → … →
filter6; in parallel vectors, rate, load envelope, peaks and saturation.

Known: the order of the steps, the rates, the shape of the filters. Assumed: the arithmetic. Words are rounded to
nearest and saturate at 16 bits; the filters pass on unrounded values. Vectors are Euclidean norms of rounded words;
the rate is the difference between two calculations. Saturation bits refer to the newest sample only. A filter keeps
its state when settings change, so that the change acts as a step.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from emulators.devices.jr3.board.filters import FILTER_STEPS, ORDER, run_stage
from emulators.devices.jr3.board.plan import Plan, plan_of
from emulators.devices.jr3.board.traces import NEVER, NEWEST, TRACE_WORDS, Place, Places, Traces, Words
from emulators.devices.jr3.board.watch import latch, peaks, watched
from protocol.devices.jr3 import AXES
from protocol.devices.jr3.board import FILTERS, VECTORS, WORD_MODULUS, LoadEnvelope

Floats = NDArray[np.float64]
Samples = TypeVar("Samples", int, NDArray[np.int64])
"""Number of one sample, or of many."""

_LOWEST, _HIGHEST = -32768.0, 32767.0


@dataclass(frozen=True)
class PathSettings:
    """Settings of the computation, constant within a block."""

    counts_per_raw: Floats
    """Calibration, transform and full scales in one matrix (6 axes, 6 channels)."""
    wraps: NDArray[np.bool_]
    """Axes whose full scale is so small that their words overflow instead of saturating (6,)."""
    offsets: Floats
    """Offsets (6,), counts."""
    vector_weights: Floats
    """Squares of each axis' full scale divided by the vector's full scale (2, 6); 0 for an axis that is not part of
    the vector.
    """
    near_saturation: int
    saturation: int
    peak_address: int
    rate_address: int
    rate_divisor: int
    """Divisor of the rate, 1 … 65536."""
    envelope: LoadEnvelope
    constants: Mapping[int, int]
    """Monitored signed words that are not computed, by address."""


@dataclass(frozen=True)
class PathState:
    """State of the computation between blocks."""

    stages: tuple[Floats, ...]
    """States of filter1 … filter6 (6, `ORDER`)."""
    last: Words
    """Newest words of all traces, laid out by `NEWEST`."""
    rate_count: int = 0
    rate_values: Words | None = None
    """Words at the last calculation of the rate (8,); None before the first calculation."""
    minimum: Words | None = None
    """Minimum peaks (8,); None from a reset until the next sample."""
    maximum: Words | None = None
    sampled: int = -1
    """Number of the newest computed sample."""


@dataclass(frozen=True, slots=True)
class Source:
    """Inputs of a block's computation, and results before rounding."""

    settings: PathSettings
    raw: NDArray[np.int64]
    """Raw channels (n, 6)."""
    plan: Plan
    signal: Floats
    """Output of filter0 (6, n)."""
    stages: tuple[Floats, ...]
    """States of the filters after all n samples."""
    rate_seen: Words
    """Inputs of the rate calculation (8, calculations)."""
    rate_first: int
    """Sample of the first rate calculation."""


@dataclass(slots=True)
class Block:
    """Samples `start` … `end` − 1 with their words. The block may be shortened, because no word depends on later
    samples.
    """

    start: int
    end: int
    before: PathState
    traces: Traces
    source: Source | None
    """Inputs and unrounded results of the computation; None for samples that the board skipped."""

    def rate_count(self, sample: Samples) -> Samples | int | NDArray[np.int64]:
        """Return the word `rate_count` after each of the given samples."""
        source = self.source
        if source is None:
            return self.before.rate_count
        divisor, since = source.settings.rate_divisor, sample - source.rate_first
        return np.where(since < 0, (since + divisor) % WORD_MODULUS, since % divisor)

    def sampled(self, sample: Samples) -> Samples | int:
        """Return, for each of the given samples, the number of the newest computed sample."""
        return self.before.sampled if self.source is None else sample

    def after(self) -> PathState:
        """Return the state of the computation at the start of the next block."""
        source, before = self.source, self.before
        if source is None:
            return before
        newest, settings, stages = self.end - 1, source.settings, source.stages
        if self.end - self.start < len(source.raw):
            _, stages = _cascade(source.signal[:, : self.end - self.start], source.plan, before.stages)
        rate_values = before.rate_values
        if newest >= source.rate_first:
            rate_values = source.rate_seen[:, (newest - source.rate_first) // settings.rate_divisor]
        minimum, maximum = peaks(self.traces, settings.constants, settings.peak_address, self.start, self.end)
        if before.minimum is not None and before.maximum is not None:
            minimum, maximum = np.minimum(minimum, before.minimum), np.maximum(maximum, before.maximum)
        last = self.traces.newest(newest)
        return PathState(stages, last, int(self.rate_count(newest)), rate_values, minimum, maximum, newest)


def initial_state() -> PathState:
    """Return the initial state of a data path that has received no input."""
    return PathState(
        tuple(np.zeros((len(AXES), ORDER)) for _ in range(FILTERS - 1)),
        np.zeros(sum(TRACE_WORDS.values()), np.int16),
    )


_SKIPPED = Places.of({name: Place(NEVER, 1, where.start, 1, 1) for name, where in NEWEST.items()})


def skipped_block(state: PathState, start: int, end: int) -> Block:
    """Return a block of skipped samples, in which every word keeps its value."""
    return Block(start, end, state, Traces(state.last, start, _SKIPPED), None)


def block(state: PathState, settings: PathSettings, raw: NDArray[np.int64], start: int) -> Block:
    """Compute the words for `raw` (n > 0, 6), whose first sample has the number `start`."""
    length, end = len(raw), start + len(raw)
    rate_step, envelope = settings.rate_divisor, settings.envelope
    # A count that exceeds the divisor has to wrap around at 16 bits before it reaches the divisor.
    wait = (rate_step - state.rate_count - 1) % WORD_MODULUS
    plan = plan_of(
        start % FILTER_STEPS[-1],
        length,
        (wait if wait < length else NEVER, rate_step),
        max(int(raw.max()), -int(raw.min())) >= min(settings.near_saturation, settings.saturation),
        bool(envelope.at_least or envelope.at_most),
    )
    words = np.empty(plan.size, np.int16)
    signal, stages = _filters(state, settings, raw, plan, words)
    words[plan.places.before] = state.last
    traces = Traces(words, start, plan.places)
    traces["raw"].values[:, 1:] = raw.T
    _saturation(settings, raw, traces)
    rate_inputs = _rate(state, settings, traces, end)
    _thresholds(settings, traces, end)
    return Block(
        start, end, state, traces, Source(settings, raw, plan, signal, stages, rate_inputs, start + wait)
    )


def _saturation(settings: PathSettings, raw: NDArray[np.int64], traces: Traces) -> None:
    for name, limit in (("warnings", settings.near_saturation), ("errors", settings.saturation)):
        bits = traces[name].values
        if bits.shape[1] > 1:
            bits[0, 1:] = (np.abs(raw) >= limit) @ (1 << np.arange(len(AXES)))
        else:
            bits[:] = 0


def _filters(
    state: PathState, settings: PathSettings, raw: NDArray[np.int64], plan: Plan, words: Words
) -> tuple[Floats, tuple[Floats, ...]]:
    """Compute the words, vectors and counts of all filters into `words`. Return the unrounded output of filter0,
    and the new states.
    """
    signal = settings.counts_per_raw @ raw.T
    signal -= settings.offsets[:, np.newaxis]
    if settings.wraps.any():
        wrapping = signal[settings.wraps]
        signal[settings.wraps] = (wrapping - _LOWEST) % WORD_MODULUS + _LOWEST
    _limit(signal)
    data = np.zeros((len(AXES), plan.axes_columns))
    outputs, stages = _cascade(signal, plan, state.stages)
    for part, output in zip(plan.parts, outputs, strict=True):
        data[:, part.begin + 1 : part.end] = output
    np.rint(data, out=data)
    _limit(data)
    axes, vectors = data.size, data.size + len(VECTORS) * len(plan.vector_columns)
    words[:axes] = data.ravel()
    squares = data.take(plan.vector_columns, axis=1)
    np.square(squares, out=squares)
    norms = settings.vector_weights @ squares
    np.sqrt(norms, out=norms)
    np.rint(norms, out=norms)
    words[axes:vectors] = np.minimum(norms, _HIGHEST, out=norms).ravel()
    words[vectors : vectors + len(plan.counting)] = plan.counting + state.last[plan.counted]
    return signal, stages


def _cascade(
    signal: Floats, plan: Plan, stages: tuple[Floats, ...]
) -> tuple[list[Floats], tuple[Floats, ...]]:
    """Return the output of each filter, and the new filter states.

    `stages` are the states before the block. Filters that compute no sample in the block are left out.
    """
    outputs, after = [signal], list(stages)
    for n, part in enumerate(plan.parts[1:]):
        signal = signal[:, part.taken]
        if not signal.shape[1]:
            break
        signal, after[n] = run_stage(signal, after[n])
        outputs.append(signal)
    return outputs, tuple(after)


def _limit(signal: Floats) -> None:
    # ndarray.clip costs several times as much for short blocks.
    np.maximum(signal, _LOWEST, out=signal)
    np.minimum(signal, _HIGHEST, out=signal)


def _rate(state: PathState, settings: PathSettings, traces: Traces, end: int) -> Words:
    """Compute the words of the rate into `traces`. Return the inputs of the calculation (8, calculations)."""
    rate = traces["rate"]
    ticks = np.arange(rate.first, end, rate.step)
    before = traces.without("rate", "threshold_bits")
    inputs = watched(before, settings.constants, settings.rate_address, ticks)
    if len(ticks):
        levels = np.empty((len(inputs), len(ticks) + 1), np.int32)
        levels[:, 0] = inputs[:, 0] if state.rate_values is None else state.rate_values
        levels[:, 1:] = inputs
        changes = levels[:, 1:] - levels[:, :-1]
        rate.values[:, 1:] = np.minimum(np.maximum(changes, int(_LOWEST)), int(_HIGHEST))
    return inputs


def _thresholds(settings: PathSettings, traces: Traces, end: int) -> None:
    bits = traces["threshold_bits"]
    ticks = np.arange(bits.first, end, bits.step)
    if len(ticks):
        previous_bits = int(bits.values[0, 0])
        before = traces.without("threshold_bits")
        bits.values[0, 1:] = latch(before, settings.constants, settings.envelope, ticks, previous_bits)
