"""Outcomes of a scenario, and its verdict."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from enum import StrEnum
from itertools import islice

_FAULTS_NAMED = 3
"""Maximum number of faults named in a reason, most serious first. Chosen."""


class Outcome(StrEnum):
    """Outcome of a scenario."""

    PASSED = "passed"
    FAILED = "failed"
    SKIPPED = "skipped"


@dataclass(frozen=True, slots=True)
class Verdict:
    """Outcome of a scenario with a one-line reason."""

    outcome: Outcome
    reason: str
    faults: tuple[str, ...] = ()
    """Problems of a failed client, most serious first. `reason` joins them."""


def decide(skipped: str, faults: Iterable[str], summary: Callable[[], str]) -> Verdict:
    """Return the verdict on a scenario: skipped if `skipped` gives a reason, failed if there are faults, otherwise
    passed.
    """
    if skipped:
        return Verdict(Outcome.SKIPPED, skipped)
    if wrong := list(islice(faults, _FAULTS_NAMED)):
        return Verdict(Outcome.FAILED, "; ".join(wrong), tuple(wrong))
    return Verdict(Outcome.PASSED, summary())
