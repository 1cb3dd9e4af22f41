"""How a client ended: evidence of every scenario."""

import signal
from dataclasses import dataclass


@dataclass(slots=True)
class Ending:
    """The end of a client. Times are seconds since the begin of its scenario."""

    ended_at: float | None = None
    exit_code: int | None = None
    """As the shell's; minus the number of a signal. None where the client was killed."""
    told_to_end: bool = False
    killed: bool = False
    late_s: float = 0.0
    """Longest time by which this process was late, and the emulated device with it; 0 in virtual time."""

    @property
    def crashed(self) -> bool:
        """Whether it ended by a signal that the judge did not send."""
        return not self.told_to_end and self.exit_code is not None and self.exit_code < 0


def describe_end(ending: Ending) -> str:
    """How the client ended, in words."""
    if ending.killed:
        return "the client was killed"
    code = ending.exit_code
    if code is None:
        return "the client continues"
    how = (
        "ended when told to"
        if ending.told_to_end
        else f"ended by itself after {ending.ended_at or 0.0:.1f} s"
    )
    if code < 0:
        try:
            return f"{how}, by {signal.Signals(-code).name}"
        except ValueError:
            return f"{how}, by signal {-code}"
    return f"{how}, exit code {code}"
