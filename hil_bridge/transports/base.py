"""Interface of wires."""

from collections.abc import Callable, Sequence
from typing import Protocol, TypeAlias, TypeVar

from hil_bridge.errors import TransportError
from protocol.can.frame import CanFrame

Frames: TypeAlias = Sequence[CanFrame]

Datagrams: TypeAlias = Sequence[bytes]
"""Datagrams, each of which is delivered complete or not at all."""

Data = TypeVar("Data")


class Transport(Protocol[Data]):
    """Full-duplex wire for `bytes`, or for batches of CAN frames or datagrams, opened and ready.

    Data is delivered by callback in the event loop's thread: no task switch lies between the wire and the state
    machine. A wrapper (pacing, latency, faults, tap) is a transport around a transport.
    """

    @property
    def name(self) -> str:
        """URL that it was opened from, for messages."""

    def start(self, on_data: Callable[[Data], None], on_end: Callable[[TransportError], None]) -> None:
        """Start delivery; called once. Data that arrived since opening is delivered too.

        `on_end` is called exactly once, after the last data. It receives TransportClosed after our own `aclose`,
        TransportBroken if the peer or the cable failed, and TransportEnded if the other side closed properly.
        """

    def send(self, data: Data) -> None:
        """Queue data for the wire, in order, without blocking.

        Raises TransportError if the wire has ended or its bounded queue is full.
        """

    async def aclose(self) -> None:
        """Send what is queued (for at most a second), then close. Idempotent."""
