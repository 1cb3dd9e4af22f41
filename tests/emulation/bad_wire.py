"""A device that says what a test tells it and keeps what it hears, behind the faults of its wire."""

from typing import Any

from emulators.faults.packets import Packets, Pieces


class BadWire:
    """`endpoint` is the end of its wire."""

    def __init__(self, pieces: Pieces[Any], seed: int) -> None:
        self.endpoint: Packets[Any] = Packets(self, pieces, seed)
        self.handlers = self.endpoint.handlers
        self._pieces = pieces
        self._heard = self._says = pieces.join([])

    def incoming(self, data: Any, now: float) -> Any:
        """The data that the device hears now, of those that are sent to it."""
        self._heard = self._pieces.join([])
        self.endpoint.receive(data, now)
        return self._heard

    def arrived(self, now: float) -> Any:
        """The data that it hears now, of those that were sent earlier."""
        self._heard = self._pieces.join([])
        self.endpoint.handle_deadline(now)
        return self._heard

    def outgoing(self, data: Any, now: float) -> Any:
        """The output now when it says this."""
        self._says = data
        return self.endpoint.data_to_send(now)

    # --- the device

    def receive(self, data: Any, now: float) -> None:
        self._heard = data

    def next_event(self) -> None:
        return None

    def data_to_send(self, now: float) -> Any:
        says, self._says = self._says, self._pieces.join([])
        return says

    def next_deadline(self) -> float | None:
        return None

    def handle_deadline(self, now: float) -> None:
        """It has nothing to do."""
