"""Significance tests for counts and figures, exact for small samples.

Implemented here because SciPy takes 100 MB and a comparison must run on a build server without extras. The test suite
compares them with SciPy and with every permutation.
"""

import math
from collections import Counter
from collections.abc import Sequence

import numpy as np

LEVEL = 0.05
"""Probability, adjusted for the number of tests, below which a difference is significant. Standard."""
EXACT_PAIRS = 400
"""Largest product of the two sample sizes for which the rank sum test is exact. Chosen: two samples of 20."""
_SAME = 1e-7
"""Relative difference below which two probabilities are equal up to rounding. Source: SciPy, `fisher_exact`."""


def fisher_exact(first: tuple[int, int], second: tuple[int, int]) -> float:
    """Return the two-sided probability of Fisher's exact test that two samples with the same rate differ at least
    as much.

    Each sample contains the number of runs that passed, and the number of runs that did not. The probability is the
    sum over all tables with the same margins that are at most as likely as the observed table. It is 1 if there are
    no runs.
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
    """Return the two-sided probability of the Mann-Whitney-Wilcoxon rank sum test for two samples.

    It is the probability of a rank sum at least as extreme if both samples have the same distribution. Equal values
    share their rank, and infinite values are ranked too. The probability is 1 if a sample is empty. It is exact up
    to EXACT_PAIRS, including ties; beyond, it is the normal approximation with tie and continuity correction.
    """
    n, m = len(first), len(second)
    if not n or not m:
        return 1.0
    ranks, ties = _twice_ranks([*first, *second])
    twice_sum, twice_mean = sum(ranks[:n]), n * (n + m + 1)
    if n * m <= EXACT_PAIRS:
        counts = _rank_sum_counts(ranks, n)
        sums = np.arange(len(counts))
        far = np.abs(sums - twice_mean) >= abs(twice_sum - twice_mean)
        return float(counts[far].sum() / counts.sum())
    total = n + m
    variance = n * m / 12.0 * (total + 1 - sum(t**3 - t for t in ties) / (total * (total - 1)))
    if variance <= 0.0:
        return 1.0
    distance = max(abs(twice_sum - twice_mean) / 2.0 - 0.5, 0.0)
    return math.erfc(distance / math.sqrt(2.0 * variance))


def _twice_ranks(values: Sequence[float]) -> tuple[list[int], list[int]]:
    """Return twice the mean rank of each value, at least 2, and the number of values that share each rank."""
    counts, ranks, below = Counter(values), {}, 0
    for value in sorted(counts):
        ranks[value] = 2 * below + counts[value] + 1
        below += counts[value]
    return [ranks[value] for value in values], list(counts.values())


def _rank_sum_counts(ranks: Sequence[int], size: int) -> "np.ndarray[tuple[int], np.dtype[np.float64]]":
    """Return the number of subsets with `size` ranks, by the sum of the ranks."""
    counts = np.zeros((size + 1, sum(ranks) + 1))
    counts[0, 0] = 1.0
    for rank in ranks:
        counts[1:, rank:] += counts[:-1, : counts.shape[1] - rank].copy()
    of_size: np.ndarray[tuple[int], np.dtype[np.float64]] = counts[size]
    return of_size


def median_interval(values: Sequence[float]) -> tuple[float, float] | None:
    """Return the confidence interval of the median of ascending values, without an assumption on their distribution.

    The bounds are the k-th values from both ends, for the largest k with a confidence of at least 1 − LEVEL. Fewer
    than six values do not have that confidence; the interval is then their range. None without values.
    """
    count = len(values)
    if not count:
        return None
    outside, k = 2.0 * 0.5**count, 1
    while k < count / 2 and outside + 2.0 * math.comb(count, k) * 0.5**count <= LEVEL:
        outside += 2.0 * math.comb(count, k) * 0.5**count
        k += 1
    return values[k - 1], values[-k]


def holm(probabilities: Sequence[float]) -> list[float]:
    """Adjust probabilities for their number by Holm's method.

    The chance that any adjusted probability falls below LEVEL is then the same as for a single test.
    """
    order = sorted(range(len(probabilities)), key=probabilities.__getitem__)
    adjusted, largest = [1.0] * len(probabilities), 0.0
    for place, number in enumerate(order):
        largest = max(largest, min(1.0, (len(probabilities) - place) * probabilities[number]))
        adjusted[number] = largest
    return adjusted
