"""Significance tests, compared with SciPy and with every permutation."""

import itertools
import math
import random

import pytest
from scipy import stats

from hil_bridge.lab import significance
from hil_bridge.lab.significance import fisher_exact, holm, median_interval, rank_sum


@pytest.mark.parametrize("seed", range(60))
def test_fisher_exact_matches_scipy(seed: int) -> None:
    draw = random.Random(seed)
    most = 10 ** draw.randint(0, 4)
    first, second = ((draw.randint(0, most), draw.randint(0, most)) for _ in range(2))
    assert fisher_exact(first, second) == pytest.approx(stats.fisher_exact([first, second])[1], rel=1e-6)


def test_fisher_exact_without_runs_is_one() -> None:
    assert fisher_exact((0, 0), (3, 4)) == 1.0
    assert fisher_exact((5, 0), (7, 0)) == 1.0


@pytest.mark.parametrize("seed", range(40))
def test_rank_sum_without_ties_matches_scipy(seed: int) -> None:
    draw = random.Random(seed)
    first = [draw.gauss(0.0, 1.0) for _ in range(draw.randint(1, 20))]
    second = [draw.gauss(draw.choice((0.0, 1.5)), 1.0) for _ in range(draw.randint(1, 20))]
    assert rank_sum(first, second) == pytest.approx(
        stats.mannwhitneyu(first, second, method="exact").pvalue, rel=1e-9
    )


@pytest.mark.parametrize("seed", range(15))
def test_rank_sum_with_ties_matches_permutations(seed: int) -> None:
    draw = random.Random(seed)
    levels = (0.0, 1.0, 2.0, math.inf)
    first = [draw.choice(levels) for _ in range(draw.randint(1, 5))]
    second = [draw.choice(levels[1:]) for _ in range(draw.randint(1, 5))]
    ranks = stats.rankdata([*first, *second])
    mean = len(first) * (len(ranks) + 1) / 2.0
    far = abs(sum(ranks[: len(first)]) - mean)
    sums = [sum(chosen) for chosen in itertools.combinations(ranks, len(first))]
    share = sum(abs(one - mean) >= far - 1e-9 for one in sums) / len(sums)
    assert rank_sum(first, second) == pytest.approx(share, rel=1e-12)


@pytest.mark.parametrize("seed", range(20))
def test_rank_sum_of_large_samples_matches_scipy(seed: int) -> None:
    draw = random.Random(seed)
    first = [float(draw.randint(0, 20)) for _ in range(60)]
    second = [float(draw.randint(0, 22)) for _ in range(45)]
    expected = stats.mannwhitneyu(first, second, method="asymptotic").pvalue
    assert rank_sum(first, second) == pytest.approx(expected, rel=1e-9)


def test_exact_and_normal_rank_sum_nearly_agree(monkeypatch: pytest.MonkeyPatch) -> None:
    first, second = [float(3 * k) for k in range(20)], [float(3 * k + 14) for k in range(20)]
    exact = rank_sum(first, second)
    monkeypatch.setattr(significance, "EXACT_PAIRS", 0)
    assert 0.001 < exact < 0.05
    assert rank_sum(first, second) == pytest.approx(exact, rel=0.1)


def test_rank_sum_of_equal_or_empty_samples_is_one() -> None:
    assert rank_sum([], [1.0]) == 1.0
    assert rank_sum([2.0] * 5, [2.0] * 7) == 1.0
    assert rank_sum([2.0] * 50, [2.0] * 70) == 1.0


def test_holm_adjustment_keeps_order() -> None:
    assert holm([0.01, 0.04, 0.03]) == pytest.approx([0.03, 0.06, 0.06])
    assert holm([0.6, 0.5]) == [1.0, 1.0]
    assert holm([]) == []


@pytest.mark.parametrize("count", range(6, 60))
def test_median_interval_has_largest_rank_of_confidence(count: int) -> None:
    low, high = median_interval(range(1, count + 1)) or (0, 0)
    assert low + high == count + 1
    assert 2.0 * stats.binom.cdf(low - 1, count, 0.5) <= 0.05 < 2.0 * stats.binom.cdf(low, count, 0.5)


def test_median_interval_of_few_values_is_their_range() -> None:
    assert median_interval([]) is None
    assert median_interval([3.0]) == (3.0, 3.0)
    assert median_interval([1.0, 2.0, 3.0, 4.0, math.inf]) == (1.0, math.inf)
