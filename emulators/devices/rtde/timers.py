"""Changes that a controller makes at a later time."""

from collections.abc import Callable


class Timers:
    """Changes that are due, in the order of their times."""

    def __init__(self) -> None:
        self._pending: list[tuple[float, Callable[[], object]]] = []

    def add(self, at: float, change: Callable[[], object]) -> None:
        """Make a change at the time `at`, s."""
        self._pending.append((at, change))
        self._pending.sort(key=lambda item: item[0])

    def run(self, now: float) -> None:
        """Make all changes that are due at `now`, s."""
        while self._pending and self._pending[0][0] <= now:
            self._pending.pop(0)[1]()
