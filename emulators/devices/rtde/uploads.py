"""Program texts that a controller receives, compiled one after the other in the order of arrival."""

from collections import deque
from collections.abc import Callable, Iterator

WAITING_MAX = 16
"""Maximum number of texts that wait to be compiled; ports drop further texts. Chosen."""


def nothing() -> None:
    """Do nothing: no program that depends on inputs can be rehearsed after a stop."""


class Uploads:
    """Queue of texts to compile, and facts about the newest program."""

    def __init__(self) -> None:
        self.defined = ""
        """Name of the newest program."""
        self.rehearse: Callable[[], object] = nothing
        """Rehearses the newest program for one cycle in which it does not run, to observe its client's orders."""
        self.stops = 0
        """Number of times that programs were stopped. A program whose text was received before a stop does not
        start.
        """
        self.spread: Callable[[], object] | None = None
        """Schedules calls of `step` between cycles until no work is left. The controller's server sets it in real
        time. If it is not set, a text is compiled on arrival.
        """
        self._works: deque[Iterator[None]] = deque()

    @property
    def full(self) -> bool:
        """Whether no further texts are accepted."""
        return len(self._works) >= WAITING_MAX

    def add(self, work: Iterator[None]) -> None:
        """Queue a text for compilation and execution after all earlier ones."""
        self._works.append(work)
        if self.spread is None:
            while self.step():
                pass
        elif len(self._works) == 1:
            self.spread()

    def step(self) -> bool:
        """Do one step of the work. Return whether any work is left."""
        if self._works and next(self._works[0], self) is self:
            self._works.popleft()
        return bool(self._works)
