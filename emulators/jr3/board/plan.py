"""Where in a block of samples the filters and their vectors are calculated.

It follows from the block's place on the grid of the slowest filter and its length alone, so that a plan is made
once for many blocks.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from emulators.jr3.board.filters import FILTER_STEPS, VECTOR_STEPS


@dataclass(frozen=True, slots=True)
class Part:
    """One filter in a block; samples count from the block's first one."""

    first: int
    """Sample of the first calculation."""
    step: int
    taken: slice
    """Which calculations of the filter before are this one's samples."""
    begin: int
    """Column of what stood there before; the calculations follow."""
    end: int
    vector_first: int
    vector_step: int
    vector_begin: int
    vector_end: int


@dataclass(frozen=True, slots=True)
class Plan:
    """All filters that are calculated in a block, fastest first."""

    parts: tuple[Part, ...]
    columns: int
    vector_columns: NDArray[np.int64]
    """Of all vectors side by side, each behind one for what stood there before: the columns that they are made of."""


@lru_cache(maxsize=1024)
def plan_of(phase: int, length: int) -> Plan:
    """The plan of `length` samples, the first of which has this number modulo the slowest filter's step."""
    parts: list[Part] = []
    columns: list[int] = []
    begin = taken_from = 0
    before = 1
    for step, vector_step in zip(FILTER_STEPS, VECTOR_STEPS, strict=True):
        first, vector_first = -phase % step, -phase % vector_step
        if first >= length:
            break
        end = begin + 1 + len(range(first, length, step))
        vector_begin = len(columns)
        columns.append(begin)
        columns += [begin + 1 + (at - first) // step for at in range(vector_first, length, vector_step)]
        taken = slice((first - taken_from) // before, None, step // before)
        parts.append(
            Part(first, step, taken, begin, end, vector_first, vector_step, vector_begin, len(columns))
        )
        begin, taken_from, before = end, first, step
    return Plan(tuple(parts), begin, np.array(columns))
