"""A selector that looks again and again for a while before it lets the operating system put the thread to sleep."""

import selectors
import time


class BusyPolling(selectors.DefaultSelector):
    """As the platform's own, but awake for the first part of every wait.

    A thread that sleeps gives up its processor, which then sleeps too: to wake both takes tens of microseconds, more
    in a virtual machine. A thread that polls avoids this delay, and takes all of one processor.
    """

    def __init__(self, awake_s: float) -> None:
        """`awake_s` is how long to poll before sleeping, s, from the begin of every wait."""
        super().__init__()
        self._awake_s = awake_s

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        """As the base class; with a `timeout` of 0 or less it looks once."""
        look = super().select
        if timeout is None or timeout > 0:
            began = time.monotonic()
            ends = began + (self._awake_s if timeout is None else min(self._awake_s, timeout))
            while time.monotonic() < ends:
                if ready := look(0):
                    return ready
            if timeout is not None:
                timeout = max(0.0, began + timeout - time.monotonic())
        return look(timeout)
