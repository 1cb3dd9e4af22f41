"""Result of a run."""

from dataclasses import dataclass

from hil_bridge.errors import Cause, Reason
from hil_bridge.errors.cause_row import COMPLETED
from hil_bridge.errors.cause_table import ROWS
from hil_bridge.record import Outcome
from hil_bridge.runs.retreat import FinalState


@dataclass(frozen=True, slots=True)
class RunResult:
    """Result of a run."""

    outcome: Outcome
    reason: Reason | None = None
    """Reason of the end; None for a program that ran to its end. The reason has no text if the run ended as
    intended.
    """
    left: str = ""
    """Description of the tool's final state; empty if the tool never moved."""
    followed: tuple[Reason, ...] = ()
    """Causes after the first."""
    rest: FinalState | None = None
    """Final state of the tool as values; None if the tool never moved."""

    @property
    def cause(self) -> Cause | None:
        """Cause from the table of causes; None for a run that completed."""
        return None if self.reason is None else self.reason.cause

    @property
    def text(self) -> str:
        """Cause as one line of text; empty if there is no cause."""
        return "" if self.reason is None else str(self.reason)

    @property
    def exit_code(self) -> int:
        """Exit code for this result, from the table of causes."""
        code = None if self.cause is None else ROWS[self.cause].exit_code
        return COMPLETED if code is None else code
