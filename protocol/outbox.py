"""Base classes of most endpoints: queues of outgoing data and events, and the next deadline."""

from collections import deque
from collections.abc import Sequence
from typing import Generic, TypeVar

Piece = TypeVar("Piece")
Event = TypeVar("Event")


class Due:
    """Endpoint with one deadline."""

    _due: float | None = None

    def next_deadline(self) -> float | None:
        """Return the next deadline, s, or None."""
        return self._due


class Outbox(Due, Generic[Piece]):
    """Endpoint that sends datagrams, frames or other pieces."""

    def __init__(self) -> None:
        self._out: list[Piece] = []

    def data_to_send(self, now: float) -> Sequence[Piece]:
        """Return the pieces to send, each only once."""
        out, self._out = self._out, []
        return out


class Mailbox(Outbox[Piece], Generic[Piece, Event]):
    """An `Outbox` that also reports events."""

    def __init__(self) -> None:
        super().__init__()
        self._events: deque[Event] = deque()

    def next_event(self) -> Event | None:
        """Return the oldest event not yet taken, or None."""
        return self._events.popleft() if self._events else None
