"""Numbers of reports, unwrapped from 32 bits, which distinguish late and stray reports from a restarted stream."""

from typing import NamedTuple

from protocol.numbering import AHEAD_MAX, NewNumbers

_NUMBERS = 2**32
_LATE_MAX = 1000
"""Number of cycles by which a report may be late. Chosen: 8 s at 8 ms."""


class Placed(NamedTuple):
    """Number of a report in this session."""

    number: int
    is_newest: bool
    restarted: bool = False


class Numbering:
    """Numbers of the reports of one client."""

    def __init__(self, cycle_s: float) -> None:
        self._cycle_s = cycle_s
        self._new = NewNumbers(cycle_s)
        self._raw: int | None = None
        self._number = 0
        self._at = 0.0

    def place(self, raw: int, at: float) -> Placed | None:
        """Return the number of a report that arrived at `at`, s; None for a stray."""
        if self._raw is None:
            return self._follow(raw, 1, at)
        ahead = (raw - self._raw + _NUMBERS // 2) % _NUMBERS - _NUMBERS // 2
        allowed = (at - self._at) / self._cycle_s + AHEAD_MAX
        if 0 < ahead <= allowed:
            self._new.forget()
            return self._follow(raw, ahead, at)
        if self._new.take(raw, at):
            self._new.forget()
            return self._follow(raw, 1, at)._replace(restarted=True)
        return Placed(self._number + ahead, False) if -_LATE_MAX <= ahead <= 0 else None

    def _follow(self, raw: int, ahead: int, at: float) -> Placed:
        self._raw, self._at = raw, at
        self._number += ahead
        return Placed(self._number, True)
