"""Whether a number that does not follow is a stray datagram or a stream that counts again. Pure.

A datagram that was held up, or is a stranger's, has a number from elsewhere. Alone it tells nothing of the stream,
which continues by its own numbers. A stream that has restarted continues by the new ones.
"""

ANEW_AFTER = 5
"""Chosen: so many datagrams in a row that follow each other by new numbers are a stream that counts again."""
AHEAD_MAX = 3
"""Chosen: cycles by which a number may be ahead of the time that has passed, for a wire hands on what it held up."""
_STEP_MAX = 3
"""Chosen: cycles from one of those datagrams to the next, for one may be missing."""
_NUMBERS = 2**32


class NewNumbers:
    """The datagrams since the newest one that followed. Numbers grow by `cycle` in each `cycle_s`."""

    def __init__(self, cycle_s: float, cycle: int = 1) -> None:
        self._quickest_s = (ANEW_AFTER - 1) * cycle_s / 2.0  # those that come all at once were held up
        self._longest = _STEP_MAX * cycle
        self._newest = self._count = 0
        self._since = 0.0

    @property
    def waits(self) -> bool:
        """Whether a datagram that does not follow has come, and none that does since."""
        return self._count > 0

    def forget(self) -> None:
        """Forget a gap: a datagram followed, so those in between were strays."""
        self._count = 0

    def take(self, number: int, at: float) -> bool:
        """Take a number that does not follow, of a datagram that came at a time, s; whether the stream counts again."""
        if not (self._count and 0 < (number - self._newest) % _NUMBERS <= self._longest):
            self._count, self._since = 0, at
        self._count += 1
        self._newest = number
        return self._count >= ANEW_AFTER and at - self._since >= self._quickest_s
