"""The seam between wires and everything else."""

from collections.abc import Callable, Sequence
from typing import Protocol, TypeAlias, TypeVar

from hil_bridge.errors import TransportError
from protocol.can.frame import CanFrame

Frames: TypeAlias = Sequence[CanFrame]

Datagrams: TypeAlias = Sequence[bytes]
"""Each one whole: what one sends as one arrives as one, or not at all."""

Data = TypeVar("Data")


class Transport(Protocol[Data]):
    """A full-duplex wire for `bytes`, for batches of CAN frames or of datagrams, opened and ready.

    Data is delivered by callback in the event loop's thread: no task switch lies between the wire and the
    state machine. A wrapper (pacing, latency, faults, tap) is a transport around a transport.
    """

    @property
    def name(self) -> str:
        """The URL it was opened from, for messages."""

    def start(self, on_data: Callable[[Data], None], on_end: Callable[[TransportError], None]) -> None:
        """Begin delivery; called once. What arrived since opening is delivered too.

        `on_end` is called exactly once, after the last data. It gets TransportClosed after our own `aclose`,
        TransportBroken when the peer or the cable broke, and TransportEnded when the other side closed properly.
        """

    def send(self, data: Data) -> None:
        """Queue data for the wire, in order, without blocking.

        Raises TransportError when the wire has ended or when its bounded queue is full.
        """

    async def aclose(self) -> None:
        """Hand over what is queued (for a second at most), then close. Harmless when called again."""
