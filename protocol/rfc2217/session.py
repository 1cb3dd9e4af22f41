"""Common parts of client and server: separation of payload and commands, a bounded queue, and flow control."""

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
"""Maximum number of bytes in the send queue. Chosen: one minute of a 9600-baud line."""


@dataclass(frozen=True, slots=True)
class SerialData:
    """Bytes from the other side. For a client, the port has received them; for a server, the port is to send them."""

    data: bytes


@dataclass(frozen=True, slots=True)
class LineStateChanged:
    """The server's port has received damaged characters."""

    state: LineState


@dataclass(frozen=True, slots=True)
class Malformed:
    """The other side sent invalid data, which was ignored."""

    text: str


Event = TypeVar("Event")

OPTIONS = (Option.BINARY, Option.SUPPRESS_GO_AHEAD)
"""Options that both sides are willing to use, in both directions."""


class Session(Generic[Event]):
    """State of one connection."""

    def __init__(self, options: Options, server: bool) -> None:
        self.options = options
        self.events: deque[Event | SerialData | Malformed] = deque()
        self._server = server
        self._reader = TelnetReader()
        self._out = bytearray()
        self._suspended = False
        """Whether the other side has suspended transmission. Neither payload nor commands may be sent then. RFC
        2217 section 5.
        """
        self.lost = 0
        """Number of bytes of responses that were dropped because the send queue was full."""

    def say(self, data: bytes) -> None:
        """Queue commands. Commands beyond the limit are dropped, so that a peer that sends requests but does not
        read uses no memory.
        """
        if len(self._out) + len(data) > QUEUE_BYTES:
            self.lost += len(data)
        else:
            self._out += data

    def command(self, command: Command, value: int | bytes) -> None:
        """Queue a command of the COM port option."""
        self.say(encode_command(command, value, server=self._server))

    def send(self, data: bytes) -> None:
        """Queue payload. Raises LocalProtocolError if the queue is full."""
        travelling = escaped(data)
        if len(self._out) + len(travelling) > 2 * QUEUE_BYTES:
            raise LocalProtocolError(f"more than {QUEUE_BYTES} bytes are queued")
        self._out += travelling

    def data_to_send(self) -> bytes:
        """Return the bytes that may be sent now."""
        if self._suspended:
            return b""
        data = bytes(self._out)
        self._out.clear()
        return data

    def receive(self, data: bytes) -> Iterator[tuple[Command, int] | Negotiation]:
        """Process received bytes. Return the commands of the option, and negotiations, to which the response is
        already queued.
        """
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
