"""Detection of consecutive slow cycles: a slow line, as opposed to one repeated answer. Pure.

The force is bounded by what the tool does until the guard looks again. A slow line makes that long without any fault.
"""

from hil_bridge.errors.causes import Cause, Reason
from hil_bridge.settings.configuration import Config

IN_A_ROW = 3
"""Chosen: so many slow cycles are no accident; a line that repeats a message is slow for one or two."""
PERIODS = 2.0
"""Periods that a cycle may last if one is configured. Chosen: the tolerance of a controller's sample time."""


class SlowCycles:
    """Cycle times of one run."""

    def __init__(self, config: Config) -> None:
        self._allowed_s = max(config.limits.cycle_max_ms, PERIODS * config.run.period_ms) * 1e-3
        self._before: float | None = None
        self._slow = 0

    def cycle(self, started_at: float) -> Reason | None:
        """Why the run must end at this cycle's begin, s; None while it need not. It is told once."""
        took = 0.0 if self._before is None else started_at - self._before
        self._before = started_at
        self._slow = self._slow + 1 if took > self._allowed_s else 0
        if self._slow != IN_A_ROW:
            return None
        text = (
            f"cycles take {took:.1f} s, allowed are {self._allowed_s:.1f} s: the line to the robot is too slow, or "
            "limits.cycle_max_ms too low for it"
        )
        return Reason(Cause.SLOW_CYCLES, text)
