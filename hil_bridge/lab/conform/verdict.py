"""Outcomes of a scenario."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from enum import StrEnum
from itertools import islice

_FAULTS_NAMED = 3
"""Faults that a reason names at most, the gravest first. Chosen."""


class Outcome(StrEnum):
    """Outcomes of a scenario."""

    PASSED = "passed"
    FAILED = "failed"
    SKIPPED = "skipped"


@dataclass(frozen=True, slots=True)
class Verdict:
    """A scenario's outcome, and one line of reason."""

    outcome: Outcome
    reason: str


def decide(skipped: str, faults: Iterable[str], well: Callable[[], str]) -> Verdict:
    """The verdict on a scenario: why it was skipped, the faults that were found, or the reason why it went `well`."""
    if skipped:
        return Verdict(Outcome.SKIPPED, skipped)
    if wrong := list(islice(faults, _FAULTS_NAMED)):
        return Verdict(Outcome.FAILED, "; ".join(wrong))
    return Verdict(Outcome.PASSED, well())
