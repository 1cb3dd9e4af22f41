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
    """Why it ended; None for a program that ran to its end. Without a text if it ended as intended."""
    left: str = ""
    """Description of where the tool was left; empty if it never moved."""
    followed: tuple[Reason, ...] = ()
    """Causes after the first one."""
    rest: FinalState | None = None
    """The same place as values; None if it never moved."""

    @property
    def cause(self) -> Cause | None:
        """Row of the table of causes; None for a run that completed."""
        return None if self.reason is None else self.reason.cause

    @property
    def text(self) -> str:
        """The cause as one line of text; empty without one."""
        return "" if self.reason is None else str(self.reason)

    @property
    def exit_code(self) -> int:
        """Exit code for this result, by the table of causes."""
        code = None if self.cause is None else ROWS[self.cause].exit_code
        return COMPLETED if code is None else code
