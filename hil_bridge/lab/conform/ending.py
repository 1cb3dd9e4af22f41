"""End of a client, part of the evidence of every scenario."""

import signal
from dataclasses import dataclass


@dataclass(slots=True)
class Ending:
    """End of a client. Times are seconds since the start of the scenario."""

    ended_at: float | None = None
    exit_code: int | None = None
    """Exit code, negative for a signal; None if the client was killed."""
    told_to_end: bool = False
    killed: bool = False
    late_s: float = 0.0
    """Largest lateness of this process, and with it of the emulated device, s; 0 in virtual time."""

    @property
    def crashed(self) -> bool:
        """Whether it ended by a signal that the test did not send."""
        return not self.told_to_end and self.exit_code is not None and self.exit_code < 0


def describe_end(ending: Ending) -> str:
    """Describe how the client ended."""
    if ending.killed:
        return "the client was killed"
    code = ending.exit_code
    if code is None:
        return "the client is still running"
    how = (
        "terminated on request"
        if ending.told_to_end
        else f"ended by itself after {ending.ended_at or 0.0:.1f} s"
    )
    if code < 0:
        try:
            return f"{how}, by {signal.Signals(-code).name}"
        except ValueError:
            return f"{how}, by signal {-code}"
    return f"{how}, exit code {code}"
