"""Common interface of all wire state machines, and the exceptions that they raise.

A client and a device emulator have the same five methods. One pump can therefore drive either of them over any
transport, and a test can connect a client to an emulator without a transport.
"""

from typing import NamedTuple, Protocol, TypeVar

DataIn = TypeVar("DataIn", contravariant=True)
DataOut = TypeVar("DataOut", covariant=True)
Event = TypeVar("Event", covariant=True)


class Trouble(NamedTuple):
    """Reason why a device cannot operate. It is falsy if there is none."""

    fact: str = ""
    remedy: str = ""
    """Advice for an operator; empty if none is known."""

    def __bool__(self) -> bool:
        return bool(self.fact)

    def __str__(self) -> str:
        """Return the reason and the remedy in one line."""
        return f"{self.fact}; {self.remedy}" if self.remedy else self.fact


NO_TROUBLE = Trouble()


class ProtocolError(Exception):
    """Error in the communication on a wire. The subclass says which side caused it."""

    def __init__(self, fact: str = "", remedy: str = "") -> None:
        """Create an error. `remedy` is advice for an operator; empty if none is known."""
        super().__init__(fact)
        self.remedy = remedy


class LocalProtocolError(ProtocolError):
    """This side was asked to send something that the protocol does not allow in the current state."""


class RemoteProtocolError(ProtocolError):
    """The other side sent something that the protocol does not allow."""


class Endpoint(Protocol[DataIn, DataOut, Event]):
    """One end of a link. `now` is the time on the caller's clock, s; it never decreases.

    Data is `bytes` on a byte wire, a sequence of `CanFrame` on a CAN bus, and a sequence of `bytes` on a datagram
    wire. Empty data means that there is nothing to send.
    """

    def receive(self, data: DataIn, now: float) -> None:
        """Process received data. Never raises, regardless of what the other side sent: errors become events."""

    def next_event(self) -> Event | None:
        """Return the oldest event not yet taken, or None."""

    def data_to_send(self, now: float) -> DataOut:
        """Return all data to send now; empty if there is none. Each piece of data is returned only once."""

    def next_deadline(self) -> float | None:
        """Return the time at which to call `handle_deadline`, s, or None if only received data can change the state."""

    def handle_deadline(self, now: float) -> None:
        """Handle every deadline up to and including `now`. Does nothing if no deadline has passed."""


class Deferrable(Protocol):
    """Device whose deadlines may be handled late and together: its data have time stamps of their own."""

    def last_deadline(self, until: float) -> float:
        """Return the time of its last deadline up to `until`, s; any time up to `until` if there is none."""
