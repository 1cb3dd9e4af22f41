"""The parts of an endpoint that most of them share: data and events that wait to be fetched, and the next deadline."""

from collections import deque
from collections.abc import Sequence
from typing import Generic, TypeVar

Piece = TypeVar("Piece")
Event = TypeVar("Event")


class Due:
    """An endpoint with one deadline."""

    _due: float | None = None

    def next_deadline(self) -> float | None:
        """When the next thing is due, s; None while it waits for nothing."""
        return self._due


class Outbox(Due, Generic[Piece]):
    """An endpoint of datagrams, frames or other pieces."""

    def __init__(self) -> None:
        self._out: list[Piece] = []

    def data_to_send(self, now: float) -> Sequence[Piece]:
        """Pieces that are due, each once."""
        out, self._out = self._out, []
        return out


class Mailbox(Outbox[Piece], Generic[Piece, Event]):
    """The same, which tells events."""

    def __init__(self) -> None:
        super().__init__()
        self._events: deque[Event] = deque()

    def next_event(self) -> Event | None:
        """Return the oldest event not yet taken, or None."""
        return self._events.popleft() if self._events else None
