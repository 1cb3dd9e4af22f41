"""Schedule and memory layout of a block's calculations, all in one array.

The plan depends only on the block's length, its position on the grid of the slowest filter and a few settings.
Therefore many blocks share one plan.
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
    """Position of one filter in a block."""

    taken: slice
    """Calculations of the previous filter that are the input of this filter."""
    begin: int
    """Column of the value before the block. The columns of the calculations follow."""
    end: int


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """Layout of a block. Equal plans are identical objects."""

    parts: tuple[Part, ...]
    """Filters calculated in the block, fastest first. Their axes are adjacent at the start of the array."""
    axes_columns: int
    vector_columns: Indices
    """Columns from which the vectors are computed. They are adjacent, and each filter's columns follow one column
    for its previous value.
    """
    counting: NDArray[np.int16]
    """Number of calculations since the start of the block, for each word of every count."""
    counted: Indices
    """Index of the newest word before the block, for each element of `counting`."""
    places: Places
    size: int


@lru_cache(maxsize=256)
def plan_of(phase: int, length: int, rate: tuple[int, int], saturated: bool, thresholds: bool) -> Plan:
    """Return the plan of `length` samples. `phase` is the number of the first one modulo the slowest filter's step.

    `rate` is the sample of the block with the first rate calculation, and the step to the next. Words that may not
    be calculated, such as saturation and thresholds, have a column nevertheless.
    """
    rate_first, rate_step = rate
    parts: list[Part] = []
    columns: list[Indices] = []
    axes: dict[str, Place] = {}
    vectors: dict[str, Place] = {}
    begin = source = vectors_end = 0
    before = 1
    for n, (step, vector_step) in enumerate(zip(FILTER_STEPS, VECTOR_STEPS, strict=True)):
        first, vector_first = -phase % step, -phase % vector_step
        end = begin + 1 + len(range(first, length, step))
        if first < length:
            parts.append(Part(slice((first - source) // before, None, step // before), begin, end))
            source, before = first, step
        axes[f"axes{n}"] = Place(first, step, begin, 0, end - begin)
        source_columns = begin + 1 + (np.arange(vector_first, length, vector_step) - first) // step
        vectors[f"vectors{n}"] = Place(vector_first, vector_step, vectors_end, 0, 1 + len(source_columns))
        columns += [np.array([begin]), source_columns]
        vectors_end += 1 + len(source_columns)
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
