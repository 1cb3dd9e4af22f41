"""Uncertainty of a figure of correlated samples by the block jackknife, which leaves out one block of time at a
time.

Blocks are longer than the correlation time of the noise, so the interval is valid for coloured noise as well.
Source: Künsch, The jackknife and the bootstrap for general stationary observations, Annals of Statistics 17, 1989.
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
"""Number of blocks of a recording. Chosen: Student's t of eleven is 12 % wider than the normal distribution."""
LEAST_BLOCKS = 4
"""Smallest number of blocks for which an interval is computed. Chosen."""
_LEVEL = 0.975
"""Probability at the upper end of a 95 % interval."""


class Estimate(NamedTuple):
    """Estimate of a figure with its 95 % interval."""

    value: float
    low: float
    high: float
    interval: str
    """Method by which the interval was computed."""

    @property
    def half(self) -> float:
        """Half width of the interval."""
        return 0.5 * (self.high - self.low)

    def wider(self, by: float, reason: str) -> "Estimate":
        """Return the estimate with an interval that is wider by `by` on both sides, for the given reason."""
        return Estimate(self.value, self.low - by, self.high + by, f"{self.interval}, {reason}")

    def times(self, factor: float) -> "Estimate":
        """Return the estimate in another unit; `factor` must be positive."""
        return Estimate(self.value * factor, self.low * factor, self.high * factor, self.interval)


def t_quantile(freedom: int) -> float:
    """Return the half width of a 95 % interval in standard errors, by Student's t distribution."""
    return float(stdtrit(freedom, _LEVEL))


def blocks_of(weights: Floats, count: int = BLOCKS) -> Ints:
    """Return the block number of each sample. Blocks are contiguous and have equal total weight."""
    total = np.cumsum(weights)
    if not len(total) or total[-1] <= 0.0:
        return np.zeros(len(weights), np.int64)
    numbers = np.ceil(total / total[-1] * count - 1e-9).astype(np.int64) - 1
    blocks: Ints = np.clip(numbers, 0, count - 1)
    return blocks


def jackknife(blocks: Ints, statistic: Callable[[Mask], float]) -> Estimate:
    """Estimate a figure over all samples; its interval is computed by leaving out one block at a time.

    `statistic` receives the mask of the samples to use. The interval is NaN for fewer than `LEAST_BLOCKS` blocks.
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
    """Estimate the mean of samples in time order."""
    return jackknife(blocks_of(np.ones(len(values))), lambda mask: float(values[mask].mean()))


def deviation_of(values: Floats) -> Estimate:
    """Estimate the standard deviation of samples in time order."""
    return jackknife(blocks_of(np.ones(len(values))), lambda mask: float(values[mask].std()))
