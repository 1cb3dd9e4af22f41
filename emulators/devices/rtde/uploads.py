"""Texts that have come to a controller: compiled one after the other, in the order in which they came."""

from collections import deque
from collections.abc import Callable, Iterator

WAITING_MAX = 16
"""Chosen: texts that wait to be compiled; ports drop more of them."""


def nothing() -> None:
    """Without a program, and with one that goes by no inputs, no order is heard behind a stop."""


class Uploads:
    """The work on texts, and what is known of the newest one."""

    def __init__(self) -> None:
        self.defined = ""
        """Name of the newest program."""
        self.rehearse: Callable[[], object] = nothing
        """Let the newest program show what its client orders, in a cycle in which it does not play."""
        self.stops = 0
        """How often programs were stopped. A program does not start when its text came before a stop."""
        self.spread: Callable[[], object] | None = None
        """Have `step` called until nothing is left to do, between cycles. Set by the one that serves the controller in
        real time; without it a text is compiled when it comes.
        """
        self._works: deque[Iterator[None]] = deque()

    @property
    def full(self) -> bool:
        """Whether no more texts are taken."""
        return len(self._works) >= WAITING_MAX

    def add(self, work: Iterator[None]) -> None:
        """Compile a text, and act on it, behind all texts before."""
        self._works.append(work)
        if self.spread is None:
            while self.step():
                pass
        elif len(self._works) == 1:
            self.spread()

    def step(self) -> bool:
        """Do one step of the work; whether any is left."""
        if self._works and next(self._works[0], self) is self:
            self._works.popleft()
        return bool(self._works)
