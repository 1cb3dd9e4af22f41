"""The one shape of every state machine that speaks on a wire, and the errors it raises.

A client and a device emulator have the same five calls. So one pump drives either over any transport, and a test can
wire a client to an emulator without any transport at all.
"""

from typing import NamedTuple, Protocol, TypeVar

DataIn = TypeVar("DataIn", contravariant=True)
DataOut = TypeVar("DataOut", covariant=True)
Event = TypeVar("Event", covariant=True)


class Trouble(NamedTuple):
    """A reason for which a device cannot do its work; false for none."""

    fact: str = ""
    remedy: str = ""
    """Advice for an operator; empty where none is known."""

    def __bool__(self) -> bool:
        return bool(self.fact)

    def __str__(self) -> str:
        """Both in one line, for people."""
        return f"{self.fact}; {self.remedy}" if self.remedy else self.fact


NO_TROUBLE = Trouble()


class ProtocolError(Exception):
    """Something is wrong with what was said on the wire; the subclass says whose fault it is."""

    def __init__(self, fact: str = "", remedy: str = "") -> None:
        """`remedy` is advice for an operator; empty where none is known."""
        super().__init__(fact)
        self.remedy = remedy


class LocalProtocolError(ProtocolError):
    """We were asked to say something that the protocol does not allow at this moment."""


class RemoteProtocolError(ProtocolError):
    """The other side said something that the protocol does not allow."""


class Endpoint(Protocol[DataIn, DataOut, Event]):
    """One end of a link. `now` is in seconds on the caller's clock and never runs backwards.

    Data is `bytes` on a byte wire, a sequence of `CanFrame` on a CAN bus, and a sequence of `bytes` on a wire of
    datagrams. Empty data mean nothing to send.
    """

    def receive(self, data: DataIn, now: float) -> None:
        """Take what arrived. Never raises for what the other side said: that becomes an event."""

    def next_event(self) -> Event | None:
        """Return the oldest event not yet taken, or None."""

    def data_to_send(self, now: float) -> DataOut:
        """Everything to be put on the wire now; empty when there is nothing. It is handed out once."""

    def next_deadline(self) -> float | None:
        """When `handle_deadline` wants to be called, or None while only data can change anything."""

    def handle_deadline(self, now: float) -> None:
        """Act on every deadline up to and including `now`; harmless when none has come."""
