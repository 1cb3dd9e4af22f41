"""How a client ended, which is part of the evidence of every scenario."""

import signal
from dataclasses import dataclass


@dataclass(slots=True)
class Ending:
    """How and when a client ended. Times are seconds since the start of the scenario."""

    ended_at: float | None = None
    exit_code: int | None = None
    """Exit code of the client, negative for a signal; None while it runs, or if it was killed."""
    end_requested: bool = False
    killed: bool = False
    late_s: float = 0.0
    """Largest delay of this process, and therefore of the emulated device, s; 0 in virtual time."""

    @property
    def crashed(self) -> bool:
        """Whether the client ended by a signal that the test did not send."""
        return not self.end_requested and self.exit_code is not None and self.exit_code < 0


def describe_end(ending: Ending) -> str:
    """Describe how the client ended."""
    if ending.killed:
        return "the client was killed"
    code = ending.exit_code
    if code is None:
        return "the client is still running"
    how = (
        "terminated on request"
        if ending.end_requested
        else f"ended by itself after {ending.ended_at or 0.0:.1f} s"
    )
    if code < 0:
        try:
            return f"{how}, by {signal.Signals(-code).name}"
        except ValueError:
            return f"{how}, by signal {-code}"
    return f"{how}, exit code {code}"
