"""From raw channels to every word that the board computes, a block of samples at a time.

raw channels → decoupled, moved and turned, in counts of full scale → minus offsets → filter0 → filter1 → … →
filter6; beside it vectors, rate, load envelope, peaks and saturation.

Known: the order of the steps, the rates, the shape of the filters. Assumed: the arithmetic. Words are rounded
to nearest and stop at the ends of 16 bits; the filters pass on what is not rounded; vectors are Euclidean norms
of rounded words; the rate is the difference between two calculations; saturation bits tell of the newest sample
only. A filter keeps its state over a change of settings, so that the change is a step to it.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from emulators.jr3.board.filters import (
    FILTER_STEPS,
    SECTIONS,
    THRESHOLD_STEP,
    run_stage,
)
from emulators.jr3.board.plan import plan_of
from emulators.jr3.board.traces import (
    NEVER,
    TRACE_WORDS,
    Trace,
    Traces,
    Words,
    first_tick,
    held_trace,
)
from emulators.jr3.board.watch import latch, peaks, watched
from protocol.jr3 import AXES
from protocol.jr3.board import FILTERS, WORD_MODULUS, LoadEnvelope

Floats = NDArray[np.float64]

_LOWEST, _HIGHEST = -32768.0, 32767.0


@dataclass(frozen=True)
class PathSettings:
    """What the computation follows; constant over a block."""

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
    """What the computation carries from block to block."""

    stages: tuple[Floats, ...]
    """(6, 3, 2) for each of filter1 … filter6."""
    last: Mapping[str, Words]
    """The newest words of every trace."""
    rate_count: int = 0
    rate_values: Words | None = None
    """(8,) the words of the last calculation of the rate; None before the first."""
    minimum: Words | None = None
    """(8,) peaks; None until a sample has come after they were reset."""
    maximum: Words | None = None
    sampled: int = -1
    """Number of the newest sample computed."""


@dataclass(frozen=True)
class Block:
    """Everything computed for samples `start` … `end` − 1."""

    start: int
    end: int
    before: PathState
    after: PathState
    traces: Traces
    raw: NDArray[np.int64] | None
    """(n, 6) what it was computed from, None for samples that the board let pass."""
    rate_first: int = NEVER
    rate_step: int = 1

    def rate_count(self, sample: int) -> int:
        """Word `rate_count` after a sample."""
        if self.raw is None:
            return self.before.rate_count
        if sample >= self.rate_first:
            return (sample - self.rate_first) % self.rate_step
        return (self.before.rate_count + sample - self.start + 1) % WORD_MODULUS

    def sampled(self, sample: int) -> int:
        """Number of the newest sample computed up to one."""
        return self.before.sampled if self.raw is None else sample


def at_rest() -> PathState:
    """A path that has seen nothing."""
    return PathState(
        tuple(np.zeros((6, SECTIONS, 2)) for _ in range(FILTERS - 1)),
        {name: np.zeros(count, np.int16) for name, count in TRACE_WORDS.items()},
    )


def held(state: PathState, start: int, end: int) -> Block:
    """Samples that the board lets pass: every word stays."""
    traces = {name: held_trace(words) for name, words in state.last.items()}
    return Block(start, end, state, state, traces, None)


def block(state: PathState, settings: PathSettings, raw: NDArray[np.int64], start: int) -> Block:
    """Compute `raw` (n > 0, 6), whose first sample has the number `start`."""
    end = start + len(raw)
    traces: dict[str, Trace] = {}
    traces["raw"] = _trace(state, "raw", start, 1, raw.T)
    traces |= _saturation(state, settings, raw, start)
    stages = _filters(state, settings, raw, start, traces)
    rate_first, rate_values = _rate(state, settings, traces, start, end)
    _thresholds(state, settings, traces, start, end)
    minimum, maximum = peaks(traces, settings.constants, settings.peak_address, start)
    if state.minimum is not None and state.maximum is not None:
        minimum, maximum = np.minimum(minimum, state.minimum), np.maximum(maximum, state.maximum)
    result = Block(start, end, state, state, traces, raw, rate_first, settings.rate_divisor)
    after = PathState(
        stages,
        {name: trace.values[:, -1] for name, trace in traces.items()},
        result.rate_count(end - 1),
        rate_values,
        minimum,
        maximum,
        end - 1,
    )
    return Block(start, end, state, after, traces, raw, rate_first, settings.rate_divisor)


def _trace(
    state: PathState, name: str, first: int, step: int, values: NDArray[np.float64] | NDArray[np.int64]
) -> Trace:
    """`values` (words, calculations) behind what stood there before."""
    words = np.empty((len(values), values.shape[1] + 1), np.int16)
    words[:, 0] = state.last[name]
    words[:, 1:] = values
    return Trace(first, step, words)


def _saturation(
    state: PathState, settings: PathSettings, raw: NDArray[np.int64], start: int
) -> dict[str, Trace]:
    highest = max(int(raw.max()), -int(raw.min()))
    traces = {}
    for name, limit in (("warnings", settings.near_saturation), ("errors", settings.saturation)):
        if highest >= limit:
            bits = (np.abs(raw) >= limit) @ (1 << np.arange(6))
            traces[name] = _trace(state, name, start, 1, bits[np.newaxis])
        else:
            traces[name] = held_trace(_NOTHING)
    return traces


_NOTHING = np.zeros(1, np.int16)
_COUNTING = np.arange(1 << 14, dtype=np.int16)


def _filters(
    state: PathState,
    settings: PathSettings,
    raw: NDArray[np.int64],
    start: int,
    traces: dict[str, Trace],
) -> tuple[Floats, ...]:
    """Words of all filters and their vectors into `traces`; the filters' states after."""
    signal = settings.counts_per_raw @ raw.T
    signal -= settings.offsets[:, np.newaxis]
    if settings.wraps.any():
        wrapping = signal[settings.wraps]
        signal[settings.wraps] = (wrapping - _LOWEST) % WORD_MODULUS + _LOWEST
    _limit(signal)
    plan, last = plan_of(start % FILTER_STEPS[-1], len(raw)), state.last
    # Of all filters side by side, each behind a column for what stood there before.
    data = np.empty((len(AXES), plan.columns))
    stages = list(state.stages)
    for n, part in enumerate(plan.parts):
        if n:
            signal, stages[n - 1] = run_stage(signal[:, part.taken], stages[n - 1])
        data[:, part.begin] = last[f"axes{n}"]
        data[:, part.begin + 1 : part.end] = signal
    np.rint(data, out=data)
    _limit(data)
    words = data.astype(np.int16)
    squares = data.take(plan.vector_columns, axis=1)
    np.square(squares, out=squares)
    norms = np.sqrt(settings.vector_weights @ squares)
    np.rint(norms, out=norms)
    vectors = np.minimum(norms, _HIGHEST, out=norms).astype(np.int16)
    for n in range(FILTERS):
        name, vector, count = f"axes{n}", f"vectors{n}", f"count{n}"
        if n >= len(plan.parts):
            # Short blocks reach only the first stages; the slow ones keep their words.
            traces |= {name: held_trace(last[name]) for name in (name, vector, count)}
            continue
        part = plan.parts[n]
        traces[name] = Trace(start + part.first, part.step, words[:, part.begin : part.end])
        if n:
            counts = _COUNTING[: part.end - part.begin] + last[count]
            traces[count] = Trace(start + part.first, part.step, counts[np.newaxis])
        vectors[:, part.vector_begin] = last[vector]
        found = vectors[:, part.vector_begin : part.vector_end]
        traces[vector] = Trace(start + part.vector_first, part.vector_step, found)
    return tuple(stages)


def _limit(signal: Floats) -> None:
    # ndarray.clip costs several times as much for short blocks.
    np.maximum(signal, _LOWEST, out=signal)
    np.minimum(signal, _HIGHEST, out=signal)


def _rate(
    state: PathState, settings: PathSettings, traces: dict[str, Trace], start: int, end: int
) -> tuple[int, Words | None]:
    """Words of the rate into `traces`; its first calculation, and the words that it has seen last."""
    step = settings.rate_divisor
    # A count past the divisor has to wrap around 16 bits before it meets it.
    wait = (step - state.rate_count - 1) % WORD_MODULUS
    first = start + wait
    if first >= end:
        traces["rate"] = Trace(first, step, state.last["rate"][:, np.newaxis])
        return first, state.rate_values
    seen = watched(traces, settings.constants, settings.rate_address, np.arange(first, end, step))
    rates = np.empty((len(seen), seen.shape[1] + 1), np.int16)
    rates[:, 0] = state.last["rate"]
    before = seen[:, 0] if state.rate_values is None else state.rate_values
    levels = np.column_stack((before, seen)).astype(np.int32)
    changes = levels[:, 1:] - levels[:, :-1]
    rates[:, 1:] = np.minimum(np.maximum(changes, int(_LOWEST)), int(_HIGHEST))
    traces["rate"] = Trace(first, step, rates)
    return first, seen[:, -1]


def _thresholds(
    state: PathState, settings: PathSettings, traces: dict[str, Trace], start: int, end: int
) -> None:
    first = first_tick(start, THRESHOLD_STEP)
    ticks = np.arange(first, end, THRESHOLD_STEP)
    envelope = settings.envelope
    if not (len(ticks) and (envelope.at_least or envelope.at_most)):
        traces["threshold_bits"] = held_trace(state.last["threshold_bits"])
        return
    standing = int(state.last["threshold_bits"][0])
    bits = latch(traces, settings.constants, envelope, ticks, standing)
    traces["threshold_bits"] = _trace(state, "threshold_bits", first, THRESHOLD_STEP, bits[np.newaxis])
