"""Parts that client and server share: payload and commands apart, a bounded queue, the wish for silence."""

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Generic, TypeVar

from protocol.endpoint import LocalProtocolError, RemoteProtocolError
from protocol.rfc2217.com_port import Command, LineState, decode_command, encode_command
from protocol.rfc2217.telnet import (
    Negotiation,
    Option,
    Options,
    Payload,
    Subnegotiation,
    TelnetReader,
    escaped,
)

QUEUE_BYTES = 65536
"""Bound of what waits to be sent. Chosen: a minute of a 9600-baud line."""


@dataclass(frozen=True, slots=True)
class SerialData:
    """Bytes from the other side: for a client what the port received, for a server what the port shall send."""

    data: bytes


@dataclass(frozen=True, slots=True)
class LineStateChanged:
    """The server's port has received damaged characters."""

    state: LineState


@dataclass(frozen=True, slots=True)
class Malformed:
    """The other side said something that is not understood; it was passed over."""

    text: str


Event = TypeVar("Event")

OPTIONS = (Option.BINARY, Option.SUPPRESS_GO_AHEAD)
"""Options that both sides are ready to use, in both directions."""


class Session(Generic[Event]):
    """One connection."""

    def __init__(self, options: Options, server: bool) -> None:
        self.options = options
        self.events: deque[Event | SerialData | Malformed] = deque()
        self._server = server
        self._reader = TelnetReader()
        self._out = bytearray()
        self._suspended = False
        """Whether the other side wants silence for now: neither payload nor commands. RFC 2217 section 5."""
        self.lost = 0
        """Bytes of answers that were not given because nothing leaves."""

    def say(self, said: bytes) -> None:
        """Queue commands. Commands beyond the limit are lost: a peer that asks and does not listen costs nothing."""
        if len(self._out) + len(said) > QUEUE_BYTES:
            self.lost += len(said)
        else:
            self._out += said

    def command(self, command: Command, value: int | bytes) -> None:
        """Queue a command of the com port option."""
        self.say(encode_command(command, value, server=self._server))

    def send(self, data: bytes) -> None:
        """Queue payload. Raises LocalProtocolError when the queue is full."""
        travelling = escaped(data)
        if len(self._out) + len(travelling) > 2 * QUEUE_BYTES:
            raise LocalProtocolError(f"more than {QUEUE_BYTES} bytes wait to be sent")
        self._out += travelling

    def data_to_send(self) -> bytes:
        """Bytes that may be sent now."""
        if self._suspended:
            return b""
        data = bytes(self._out)
        self._out.clear()
        return data

    def receive(self, data: bytes) -> Iterator[tuple[Command, int] | Negotiation]:
        """Take what arrived; gives negotiations, which are answered already, and the commands of the option."""
        for event in self._reader.receive(data):
            match event:
                case Payload(payload):
                    self.events.append(SerialData(payload))
                case Negotiation():
                    self.say(self.options.receive(event))
                    yield event
                case Subnegotiation(Option.COM_PORT, inside):
                    try:
                        command, value = decode_command(inside, server=not self._server)
                    except RemoteProtocolError as error:
                        self.events.append(Malformed(str(error)))
                        continue
                    if command in (Command.FLOWCONTROL_SUSPEND, Command.FLOWCONTROL_RESUME):
                        self._suspended = command is Command.FLOWCONTROL_SUSPEND
                    else:
                        yield command, value
                case Subnegotiation(option):
                    self.events.append(Malformed(f"option {option} is not in use"))
                case garbled:
                    self.events.append(Malformed(garbled.text))
