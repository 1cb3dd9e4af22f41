"""Device that sends what a test specifies and stores what it receives, behind the faults of its wire."""

from typing import Any

from emulators.faults.packets import Packets, Pieces


class BadWire:
    """Device with a faulty wire; `endpoint` is the end of the wire."""

    def __init__(self, pieces: Pieces[Any], seed: int) -> None:
        self.endpoint: Packets[Any] = Packets(self, pieces, seed)
        self.handlers = self.endpoint.handlers
        self._pieces = pieces
        self._input = self._output = pieces.join([])

    def incoming(self, data: Any, now: float) -> Any:
        """Send data to the device, and return the data that arrive now."""
        self._input = self._pieces.join([])
        self.endpoint.receive(data, now)
        return self._input

    def arrived(self, now: float) -> Any:
        """Return the earlier data that arrive at the device now."""
        self._input = self._pieces.join([])
        self.endpoint.handle_deadline(now)
        return self._input

    def outgoing(self, data: Any, now: float) -> Any:
        """Return the output when the device sends these data now."""
        self._output = data
        return self.endpoint.data_to_send(now)

    # --- the device

    def receive(self, data: Any, now: float) -> None:
        self._input = data

    def next_event(self) -> None:
        return None

    def data_to_send(self, now: float) -> Any:
        data, self._output = self._output, self._pieces.join([])
        return data

    def next_deadline(self) -> float | None:
        return None

    def handle_deadline(self, now: float) -> None:
        """Do nothing: the device has no deadlines."""
