"""Comparison of two sets of controller parameters on the same seeds."""

import math
import statistics
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum

from hil_bridge.lab.tuning.evaluating import Evaluation

_ERRORS = 2.0
"""Number of standard errors that a mean difference must exceed to be significant. Chosen."""


class Finding(StrEnum):
    """Result of comparing the tuned parameters with the defaults."""

    BETTER = "better"
    WORSE = "worse"
    ALIKE = "no significant difference with these seeds"
    FAILS = "fails"
    SAVES = "works where the defaults fail"
    MORE = "both fail, the tuned ones in more runs"
    LESS = "both fail, the tuned ones in fewer runs"
    NEITHER = "both fail, in equally many runs"


@dataclass(frozen=True, slots=True)
class Comparison:
    """Evaluations of the tuned and the default parameters in one cell."""

    name: str
    tuned: Evaluation
    defaults: Evaluation

    @property
    def finding(self) -> Finding:
        """Result of the comparison, from the scores paired by seed."""
        ours, theirs = len(self.tuned.failures), len(self.defaults.failures)
        if ours and theirs:
            return Finding.MORE if ours > theirs else Finding.LESS if ours < theirs else Finding.NEITHER
        if ours or theirs:
            return Finding.FAILS if ours else Finding.SAVES
        return _by_pairs(_differences(self.tuned.scores, self.defaults.scores))


def _differences(ours: Sequence[float | None], theirs: Sequence[float | None]) -> list[float]:
    pairs = zip(ours, theirs, strict=True)
    return [a - b for a, b in pairs if a is not None and b is not None]


def _by_pairs(differences: Sequence[float]) -> Finding:
    mean = statistics.fmean(differences)
    if len(differences) < 2:
        return Finding.ALIKE
    error = statistics.stdev(differences) / math.sqrt(len(differences))
    if abs(mean) <= _ERRORS * error or mean == 0.0:
        return Finding.ALIKE
    return Finding.BETTER if mean < 0.0 else Finding.WORSE


def describe_comparison(comparison: Comparison, figures: Sequence[str]) -> Iterator[str]:
    """Yield the comparison as text lines: each figure of both sets of parameters, as mean ± standard deviation over
    the seeds.
    """
    one = comparison
    runs = len(one.tuned.runs)
    yield f"{one.name}, {runs} {'runs' if one.tuned.cells else 'seeds'}: {one.finding}"
    for name in figures:
        yield f"  {name:22} defaults {_figure(one.defaults, name):>18}   tuned {_figure(one.tuned, name):>18}"
    for label, side in (("defaults", one.defaults), ("tuned", one.tuned)):
        if side.failures:
            yield f"  {label}: {len(side.failures)} of {len(side.runs)} runs failed: {side.failures[0]}"


def _figure(side: Evaluation, name: str) -> str:
    mean = side.mean(name)
    return "–" if mean is None else f"{mean:.3g} ± {side.spread(name):.2g}"


def sentence(comparisons: Sequence[Comparison]) -> str:
    """Return a summary sentence: whether the tuned parameters beat the defaults, and in how many cells they are
    better.
    """
    better = [one for one in comparisons if one.finding in (Finding.BETTER, Finding.SAVES)]
    worse = [one for one in comparisons if one.finding in (Finding.WORSE, Finding.FAILS, Finding.MORE)]
    both = sum(bool(one.tuned.failures and one.defaults.failures) for one in comparisons)
    count = len(comparisons)
    beats = "beat the defaults" if len(better) == count else "do NOT beat the defaults everywhere"
    names = f" (worse: {', '.join(one.name for one in worse)})" if worse else ""
    fail = f"; in {both} both fail a constraint" if both else ""
    return f"the tuned parameters {beats}: better in {len(better)} of {count} cells, worse in {len(worse)}{names}{fail}"
