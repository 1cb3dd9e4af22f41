"""Outcomes of a scenario."""

from dataclasses import dataclass
from enum import StrEnum


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
