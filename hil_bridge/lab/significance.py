"""Tests of significance for counts and for figures, exact where samples are small.

Own formulas: SciPy has 100 MB, and a comparison has to run on a build server that installed no extra. Tests hold them
against SciPy and against every permutation.
"""

import math
from collections import Counter
from collections.abc import Sequence

import numpy as np

LEVEL = 0.05
"""A difference is significant below this probability, adjusted for the number of tests. Standard."""
EXACT_PAIRS = 400
"""Product of the two sizes up to which the rank sum is exact. Chosen: two samples of 20."""
_SAME = 1e-7
"""Relative difference of two probabilities that are the same but for rounding. Source: SciPy, `fisher_exact`."""


def fisher_exact(first: tuple[int, int], second: tuple[int, int]) -> float:
    """Probability of counts that differ at least so much where both samples have one rate; two-sided, 1 without counts.

    Each sample is its number of runs that passed and of those that did not. The probability is the sum over all tables
    with the same margins that are not more likely than the one found.
    """
    passed, size, total = first[0] + second[0], sum(first), sum(first) + sum(second)
    least, most = max(0, passed + size - total), min(passed, size)

    def log_choose(n: int, k: int) -> float:
        return math.lgamma(n + 1) - math.lgamma(k + 1) - math.lgamma(n - k + 1)

    logs = [
        log_choose(passed, k) + log_choose(total - passed, size - k) - log_choose(total, size)
        for k in range(least, most + 1)
    ]
    limit = logs[first[0] - least] + math.log1p(_SAME)
    return min(1.0, math.fsum(math.exp(value) for value in logs if value <= limit))


def rank_sum(first: Sequence[float], second: Sequence[float]) -> float:
    """Probability of ranks that differ at least so much where both samples have one distribution: the two-sided test of
    Mann, Whitney and Wilcoxon. Ties share their rank; infinite values rank too. 1 where a sample is empty.

    Up to EXACT_PAIRS it counts every permutation, ties included; above by the normal law, corrected for ties and steps.
    """
    n, m = len(first), len(second)
    if not n or not m:
        return 1.0
    ranks, ties = _twice_ranks([*first, *second])
    twice_sum, twice_mean = sum(ranks[:n]), n * (n + m + 1)
    if n * m <= EXACT_PAIRS:
        ways = _ways(ranks, n)
        sums = np.arange(len(ways))
        far = np.abs(sums - twice_mean) >= abs(twice_sum - twice_mean)
        return float(ways[far].sum() / ways.sum())
    total = n + m
    variance = n * m / 12.0 * (total + 1 - sum(t**3 - t for t in ties) / (total * (total - 1)))
    if variance <= 0.0:
        return 1.0
    distance = max(abs(twice_sum - twice_mean) / 2.0 - 0.5, 0.0)
    return math.erfc(distance / math.sqrt(2.0 * variance))


def _twice_ranks(values: Sequence[float]) -> tuple[list[int], list[int]]:
    """Twice the mean rank of each value, from 2 on, and how many values share each rank."""
    counts, ranks, below = Counter(values), {}, 0
    for value in sorted(counts):
        ranks[value] = 2 * below + counts[value] + 1
        below += counts[value]
    return [ranks[value] for value in values], list(counts.values())


def _ways(ranks: Sequence[int], size: int) -> "np.ndarray[tuple[int], np.dtype[np.float64]]":
    """In how many ways so many of the ranks have each sum."""
    ways = np.zeros((size + 1, sum(ranks) + 1))
    ways[0, 0] = 1.0
    for rank in ranks:
        ways[1:, rank:] += ways[:-1, : ways.shape[1] - rank].copy()
    found: np.ndarray[tuple[int], np.dtype[np.float64]] = ways[size]
    return found


def holm(probabilities: Sequence[float]) -> list[float]:
    """The probabilities adjusted for their number, after Holm. By chance alone any is below LEVEL as rarely as one."""
    order = sorted(range(len(probabilities)), key=probabilities.__getitem__)
    adjusted, largest = [1.0] * len(probabilities), 0.0
    for place, number in enumerate(order):
        largest = max(largest, min(1.0, (len(probabilities) - place) * probabilities[number]))
        adjusted[number] = largest
    return adjusted
