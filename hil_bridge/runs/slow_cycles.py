"""Detection of consecutive slow cycles: a slow link, as opposed to a single repeated message. Pure.

The tool's motion until the next check by the supervisor bounds the force. A slow link makes this interval long
without any fault.
"""

from hil_bridge.errors.causes import Cause, Reason
from hil_bridge.settings.configuration import Config

IN_A_ROW = 3
"""Number of consecutive slow cycles that stops the run. Chosen: a link that repeats a message is slow for only one
or two cycles.
"""
PERIODS = 2.0
"""Longest allowed cycle if a period is configured, in periods. Chosen: the tolerance of a controller's sample time."""


class SlowCycles:
    """Detector of consecutive slow cycles in one run."""

    def __init__(self, config: Config) -> None:
        self._allowed_s = max(config.limits.cycle_max_ms, PERIODS * config.run.period_ms) * 1e-3
        self._before: float | None = None
        self._slow = 0

    def cycle(self, started_at: float) -> Reason | None:
        """Return the reason why the run must end at the start of this cycle; None if it may continue. The reason is
        returned once. `started_at` is the start of the cycle, s.
        """
        took = 0.0 if self._before is None else started_at - self._before
        self._before = started_at
        self._slow = self._slow + 1 if took > self._allowed_s else 0
        if self._slow != IN_A_ROW:
            return None
        text = (
            f"cycles take {took:.1f} s, allowed: at most {self._allowed_s:.1f} s: the line to the robot is too slow, "
            "or limits.cycle_max_ms too low for it"
        )
        return Reason(Cause.SLOW_CYCLES, text)
