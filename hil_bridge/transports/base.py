"""Interface of wires."""

from collections.abc import Callable, Sequence
from typing import Protocol, TypeAlias, TypeVar

from hil_bridge.errors import TransportError
from protocol.can.frame import CanFrame

Frames: TypeAlias = Sequence[CanFrame]

Datagrams: TypeAlias = Sequence[bytes]
"""Batch of datagrams, each of which is delivered complete or not at all."""

Data = TypeVar("Data")


class Transport(Protocol[Data]):
    """Full-duplex wire for `bytes`, or for batches of CAN frames or datagrams, opened and ready.

    Data is delivered by callback in the event loop's thread, so no task switch lies between the wire and the state
    machine. A wrapper (pacing, latency, faults, tap) is a transport that wraps another transport.
    """

    @property
    def name(self) -> str:
        """URL from which the wire was opened, for messages."""

    def start(self, on_data: Callable[[Data], None], on_end: Callable[[TransportError], None]) -> None:
        """Start delivery. Called once. Data that arrived since opening is delivered too.

        `on_end` is called exactly once, after the last data. It receives TransportClosed after `aclose` on this
        side, TransportBroken if the peer or the cable failed, and TransportEnded if the other side closed properly.
        """

    def send(self, data: Data) -> None:
        """Queue data for the wire, in order, without blocking.

        Raises TransportError if the wire has ended or its bounded queue is full.
        """

    async def aclose(self) -> None:
        """Send queued data for at most a second, then close the wire. Idempotent."""
