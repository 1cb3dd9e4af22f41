"""From raw channels to every word that the board computes, a block of samples at a time.

raw channels → decoupled, moved and turned, in counts of full scale → minus offsets → filter0 → filter1 → … →
filter6; beside it vectors, rate, load envelope, peaks and saturation.

Known: the order of the steps, the rates, the shape of the filters. Assumed: the arithmetic. Words are rounded to
nearest and stop at the ends of 16 bits; the filters pass on values that are not rounded. Vectors are Euclidean norms of
rounded words; the rate is the difference between two calculations. Saturation bits tell of the newest sample only. A
filter keeps its state over a change of settings, so that the change is a step to it.
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
"""Numbers of one sample or of many."""

_LOWEST, _HIGHEST = -32768.0, 32767.0


@dataclass(frozen=True)
class PathSettings:
    """Settings that the computation follows; constant over a block."""

    counts_per_raw: Floats
    """(6 axes, 6 channels): calibration, transform and full scales in one."""
    wraps: NDArray[np.bool_]
    """(6,) axes whose full scale is too small, so that their words overflow instead of stopping."""
    offsets: Floats
    """(6,) counts."""
    vector_weights: Floats
    """(2, 6): squares of each axis' full scale by the vector's; 0 for an axis that does not belong."""
    near_saturation: int
    saturation: int
    peak_address: int
    rate_address: int
    rate_divisor: int
    """1 … 65536."""
    envelope: LoadEnvelope
    constants: Mapping[int, int]
    """Signed words that are watched but not computed, by address."""


@dataclass(frozen=True)
class PathState:
    """State that the computation carries from block to block."""

    stages: tuple[Floats, ...]
    """(6, `ORDER`) for each of filter1 … filter6."""
    last: Words
    """The newest words of every trace, where `NEWEST` says."""
    rate_count: int = 0
    rate_values: Words | None = None
    """(8,) the words of the last calculation of the rate; None before the first."""
    minimum: Words | None = None
    """(8,) peaks; None until a sample has come after they were reset."""
    maximum: Words | None = None
    sampled: int = -1
    """Number of the newest sample computed."""


@dataclass(frozen=True, slots=True)
class Source:
    """Data from which the words of a block were computed, and results that are not rounded to words."""

    settings: PathSettings
    raw: NDArray[np.int64]
    """(n, 6)"""
    plan: Plan
    signal: Floats
    """(6, n) filter0."""
    stages: tuple[Floats, ...]
    """State of the filters after all n samples."""
    rate_seen: Words
    """(8, calculations) what the rate looked at."""
    rate_first: int
    """Sample of its first calculation."""


@dataclass(slots=True)
class Block:
    """Samples `start` … `end` − 1. They may be made fewer: no word tells of samples after it."""

    start: int
    end: int
    before: PathState
    traces: Traces
    source: Source | None
    """None for samples that the board let pass."""

    def rate_count(self, sample: Samples) -> Samples | int | NDArray[np.int64]:
        """Word `rate_count` after each of these samples."""
        source = self.source
        if source is None:
            return self.before.rate_count
        divisor, since = source.settings.rate_divisor, sample - source.rate_first
        return np.where(since < 0, (since + divisor) % WORD_MODULUS, since % divisor)

    def sampled(self, sample: Samples) -> Samples | int:
        """Return the number of the newest sample computed up to each of these."""
        return self.before.sampled if self.source is None else sample

    def after(self) -> PathState:
        """State that the computation carries on to the next block."""
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


def at_rest() -> PathState:
    """Return a path without any input yet."""
    return PathState(
        tuple(np.zeros((len(AXES), ORDER)) for _ in range(FILTERS - 1)),
        np.zeros(sum(TRACE_WORDS.values()), np.int16),
    )


_HELD = Places.of({name: Place(NEVER, 1, where.start, 1, 1) for name, where in NEWEST.items()})


def held(state: PathState, start: int, end: int) -> Block:
    """Return samples that the board skips: every word keeps its value."""
    return Block(start, end, state, Traces(state.last, start, _HELD), None)


def block(state: PathState, settings: PathSettings, raw: NDArray[np.int64], start: int) -> Block:
    """Compute `raw` (n > 0, 6), whose first sample has the number `start`."""
    length, end = len(raw), start + len(raw)
    rate_step, envelope = settings.rate_divisor, settings.envelope
    # A count past the divisor has to wrap around 16 bits before it meets it.
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
    rate_seen = _rate(state, settings, traces, end)
    _thresholds(settings, traces, end)
    return Block(
        start, end, state, traces, Source(settings, raw, plan, signal, stages, rate_seen, start + wait)
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
    """Words of all filters, their vectors and counts into `words`; filter0 not rounded, and the states after."""
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
    """Output of each filter from filter0, from `stages` on, until one has no sample; the filters' states after."""
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
    """Words of the rate into `traces`; the words that it has seen (8, calculations)."""
    rate = traces["rate"]
    ticks = np.arange(rate.first, end, rate.step)
    before = traces.without("rate", "threshold_bits")
    seen = watched(before, settings.constants, settings.rate_address, ticks)
    if len(ticks):
        levels = np.empty((len(seen), len(ticks) + 1), np.int32)
        levels[:, 0] = seen[:, 0] if state.rate_values is None else state.rate_values
        levels[:, 1:] = seen
        changes = levels[:, 1:] - levels[:, :-1]
        rate.values[:, 1:] = np.minimum(np.maximum(changes, int(_LOWEST)), int(_HIGHEST))
    return seen


def _thresholds(settings: PathSettings, traces: Traces, end: int) -> None:
    bits = traces["threshold_bits"]
    ticks = np.arange(bits.first, end, bits.step)
    if len(ticks):
        standing = int(bits.values[0, 0])
        before = traces.without("threshold_bits")
        bits.values[0, 1:] = latch(before, settings.constants, settings.envelope, ticks, standing)
