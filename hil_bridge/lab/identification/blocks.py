"""Uncertainty of a figure of correlated samples by the block jackknife: each time block is left out once.

Blocks are longer than the noise remembers, so the interval is honest for coloured noise too. Source: Künsch, The
jackknife and the bootstrap for general stationary observations, Annals of Statistics 17, 1989.
"""

import math
from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from hil_bridge.lab.fidelity.measures import Floats

Ints: TypeAlias = NDArray[np.int64]
Mask: TypeAlias = NDArray[np.bool_]

BLOCKS = 12
"""Chosen: number of blocks of a recording. Student's t of eleven is 12 % wider than the normal distribution."""
LEAST_BLOCKS = 4
"""Chosen: smallest number of blocks for an interval."""
_LEVEL = 0.975
"""Upper quantile of a 95 % interval."""


class Estimate(NamedTuple):
    """Figure with its 95 % interval."""

    value: float
    low: float
    high: float
    interval: str
    """Method of the interval."""

    @property
    def half(self) -> float:
        """Half width of the interval."""
        return 0.5 * (self.high - self.low)

    def wider(self, by: float, words: str) -> "Estimate":
        """Widen the interval on both sides, for the given reason."""
        return Estimate(self.value, self.low - by, self.high + by, f"{self.interval}, {words}")

    def times(self, factor: float) -> "Estimate":
        """Convert to another unit; the factor is positive."""
        return Estimate(self.value * factor, self.low * factor, self.high * factor, self.interval)


def t_quantile(freedom: int) -> float:
    """Return the half width of a 95 % interval in standard errors, by Student's t distribution."""
    return float(stdtrit(freedom, _LEVEL))


def blocks_of(weights: Floats, count: int = BLOCKS) -> Ints:
    """Return the block number of each sample: contiguous blocks of equal weight."""
    total = np.cumsum(weights)
    if not len(total) or total[-1] <= 0.0:
        return np.zeros(len(weights), np.int64)
    numbers = np.ceil(total / total[-1] * count - 1e-9).astype(np.int64) - 1
    blocks: Ints = np.clip(numbers, 0, count - 1)
    return blocks


def jackknife(blocks: Ints, statistic: Callable[[Mask], float]) -> Estimate:
    """Estimate a figure over all samples, with the interval that follows when each block is left out once.

    `statistic` gets which samples count. NaN for the interval of fewer than `LEAST_BLOCKS` blocks.
    """
    numbers = np.unique(blocks)
    value = statistic(np.ones(len(blocks), bool))
    if len(numbers) < LEAST_BLOCKS:
        return Estimate(value, math.nan, math.nan, "")
    left = np.array([statistic(blocks != number) for number in numbers])
    count = len(numbers)
    error = math.sqrt((count - 1) / count * float(np.sum((left - left.mean()) ** 2)))
    half = t_quantile(count - 1) * error
    return Estimate(value, value - half, value + half, f"jackknife over {count} blocks of time")


def mean_of(values: Floats) -> Estimate:
    """Return the mean of samples in time order."""
    return jackknife(blocks_of(np.ones(len(values))), lambda mask: float(values[mask].mean()))


def deviation_of(values: Floats) -> Estimate:
    """Return the standard deviation of samples in time order."""
    return jackknife(blocks_of(np.ones(len(values))), lambda mask: float(values[mask].std()))
