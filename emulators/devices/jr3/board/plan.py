"""Where the words of a block of samples are calculated, and where they lie: all in one array.

It follows from the block's length, its place on the grid of the slowest filter and a few settings alone. So a plan is
made once for many blocks.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from emulators.devices.jr3.board.filters import FILTER_STEPS, THRESHOLD_STEP, VECTOR_STEPS
from emulators.devices.jr3.board.traces import NEVER, NEWEST, TRACE_WORDS, Place, Places
from protocol.devices.jr3 import AXES
from protocol.devices.jr3.board import VECTORS

Indices = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Part:
    """One filter in a block."""

    taken: slice
    """Which calculations of the filter before are this one's samples."""
    begin: int
    """Column of what stood there before; the calculations follow."""
    end: int


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """Where everything of a block lies. Equal plans are one and the same."""

    parts: tuple[Part, ...]
    """Filters that are calculated, fastest first; their axes lie side by side at the array's beginning."""
    axes_columns: int
    vector_columns: Indices
    """Columns from which the vectors are made, side by side, each behind one for the value from before."""
    counting: NDArray[np.int16]
    """For each count, one after the other, the number of calculations after the block's beginning."""
    counted: Indices
    """For the same words, the index of the newest word from which the count continues."""
    places: Places
    size: int


@lru_cache(maxsize=256)
def plan_of(phase: int, length: int, rate: tuple[int, int], saturated: bool, thresholds: bool) -> Plan:
    """Return the plan of `length` samples, the first of which has the number `phase` modulo the slowest filter's step.

    `rate` is the sample of the block with its first calculation of the rate, and the step to the next. Words that are
    not calculated, as those of saturation and thresholds may not be, have a column all the same.
    """
    rate_first, rate_step = rate
    parts: list[Part] = []
    columns: list[Indices] = []
    axes: dict[str, Place] = {}
    vectors: dict[str, Place] = {}
    begin = taken_from = vectors_end = 0
    before = 1
    for n, (step, vector_step) in enumerate(zip(FILTER_STEPS, VECTOR_STEPS, strict=True)):
        first, vector_first = -phase % step, -phase % vector_step
        end = begin + 1 + len(range(first, length, step))
        if first < length:
            parts.append(Part(slice((first - taken_from) // before, None, step // before), begin, end))
            taken_from, before = first, step
        axes[f"axes{n}"] = Place(first, step, begin, 0, end - begin)
        made_of = begin + 1 + (np.arange(vector_first, length, vector_step) - first) // step
        vectors[f"vectors{n}"] = Place(vector_first, vector_step, vectors_end, 0, 1 + len(made_of))
        columns += [np.array([begin]), made_of]
        vectors_end += 1 + len(made_of)
        begin = end
    places = {name: place.moved(0, begin) for name, place in axes.items()}
    size = len(AXES) * begin
    places |= {name: place.moved(size, vectors_end) for name, place in vectors.items()}
    size += len(VECTORS) * vectors_end
    counting: list[Indices] = []
    counted: list[Indices] = []
    for n, step in enumerate(FILTER_STEPS[1:], 1):
        count = places[f"axes{n}"].columns
        places[f"count{n}"] = Place(-phase % step, step, size, count, count)
        counting.append(np.arange(count))
        counted.append(np.full(count, NEWEST[f"count{n}"].start))
        size += count
    for name, first, step in (
        ("raw", 0, 1),
        ("warnings", 0 if saturated else NEVER, 1),
        ("errors", 0 if saturated else NEVER, 1),
        ("rate", rate_first, rate_step),
        ("threshold_bits", -phase % THRESHOLD_STEP if thresholds else NEVER, THRESHOLD_STEP),
    ):
        count = 1 + len(range(first, length, step))
        places[name] = Place(first, step, size, count, count)
        size += TRACE_WORDS[name] * count
    return Plan(
        tuple(parts),
        begin,
        np.concatenate(columns),
        np.concatenate(counting).astype(np.int16),
        np.concatenate(counted),
        Places.of(places),
        size,
    )
