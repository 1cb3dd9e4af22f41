"""Distinction between a stray datagram and a stream that has restarted its numbering.

A datagram that was delayed, or was sent by an unrelated sender, has a number that does not follow the previous one.
Such a datagram alone says nothing about the stream, which continues with its own numbers. A stream that has
restarted continues with the new numbers.
"""

RESTART_AFTER = 5
"""Number of consecutive datagrams with consecutive new numbers after which the stream counts as restarted. Chosen."""
AHEAD_MAX = 3
"""Number of cycles by which a number may be ahead of the elapsed time. Chosen, because a wire delivers delayed
datagrams in bursts.
"""
_STEP_MAX = 3
"""Largest step between the numbers of two consecutive new datagrams, in cycles. Chosen, because datagrams in
between may be missing.
"""
_NUMBERS = 2**32


class NewNumbers:
    """Record of the out-of-sequence datagrams since the newest regular one. Numbers grow by `cycle` in each
    `cycle_s`.
    """

    def __init__(self, cycle_s: float, cycle: int = 1) -> None:
        self._quickest_s = (
            (RESTART_AFTER - 1) * cycle_s / 2.0
        )  # datagrams that all arrive together were delayed
        self._longest = _STEP_MAX * cycle
        self._newest = self._count = 0
        self._since = 0.0

    @property
    def waits(self) -> bool:
        """Whether an out-of-sequence datagram has arrived and no regular one since then."""
        return self._count > 0

    def forget(self) -> None:
        """Discard the record. A regular datagram has arrived, so the datagrams before it were strays."""
        self._count = 0

    def take(self, number: int, at: float) -> bool:
        """Record an out-of-sequence number of a datagram that arrived at time `at`, s. Return whether the stream
        has restarted.
        """
        if not (self._count and 0 < (number - self._newest) % _NUMBERS <= self._longest):
            self._count, self._since = 0, at
        self._count += 1
        self._newest = number
        return self._count >= RESTART_AFTER and at - self._since >= self._quickest_s
