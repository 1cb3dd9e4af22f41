"""Delayed changes of a controller."""

from collections.abc import Callable


class Timers:
    """Pending changes, in order of time."""

    def __init__(self) -> None:
        self._pending: list[tuple[float, Callable[[], object]]] = []

    def add(self, at: float, change: Callable[[], object]) -> None:
        """Schedule a change at the time `at`, s."""
        self._pending.append((at, change))
        self._pending.sort(key=lambda item: item[0])

    def run(self, now: float) -> None:
        """Execute all changes that are due at `now`, s."""
        while self._pending and self._pending[0][0] <= now:
            self._pending.pop(0)[1]()
