"""How a client ended, which is part of the evidence of every scenario."""

import signal
from collections.abc import Iterator
from dataclasses import dataclass

from hil_bridge.show.pages.timeline import Interval, Moment, Tone


@dataclass(slots=True)
class Ending:
    """How and when a client ended. Times are seconds since the start of the scenario."""

    ended_at: float | None = None
    exit_code: int | None = None
    """Exit code of the client, negative for a signal; None while it runs, or if it was killed."""
    end_requested: bool = False
    end_requested_at: float | None = None
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
    return f"{how}, {describe_code(code)}"


def describe_code(code: int) -> str:
    """Describe an exit code, negative for a signal."""
    if code >= 0:
        return f"exit code {code}"
    try:
        return f"by {signal.Signals(-code).name}"
    except ValueError:
        return f"by signal {-code}"


def allowed_time(begin: float, react_s: float) -> Interval:
    """Return the time to react after a fault at `begin`, s, as an interval across all lanes."""
    return Interval("", begin, begin + react_s, Tone.WARN, f"{react_s * 1e3:g} ms to react")


def end_moments(ending: Ending, end_s: float) -> Iterator[Moment]:
    """Yield the moments of the client's end; `end_s` is the time to terminate on request, s."""
    requested_at, ended_at, code = ending.end_requested_at, ending.ended_at, ending.exit_code
    if requested_at is not None:
        yield Moment(requested_at, "the client is asked to terminate (SIGTERM)")
        if ending.killed:
            yield Moment(requested_at + end_s, "the client is killed", Tone.BAD)
    if ended_at is not None and code is not None:
        how = "terminates" if ending.end_requested else "ends by itself"
        tone = Tone.BAD if ending.crashed else Tone.PLAIN
        yield Moment(ended_at, f"the client {how}, {describe_code(code)}", tone)
