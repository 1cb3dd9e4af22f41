"""Telnet framing: separation of commands and payload, and option negotiation.

References: RFC 854 (commands), RFC 855 (options and subnegotiation), RFC 1143 (avoiding negotiation loops).
"""

from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum, IntEnum, auto
from typing import TypeAlias

IAC = 255
"""Interpret As Command: the byte that starts a command. Doubled, it is one byte of the payload. [standard, RFC 854]"""
SUBNEGOTIATION_BEGIN = 250
SUBNEGOTIATION_END = 240

SUBNEGOTIATION_LIMIT = 256
"""Maximum number of bytes in a subnegotiation. Chosen: subnegotiations of the COM port option have at most five
bytes, except for the text of a signature.
"""


class Verb(IntEnum):
    """Verb of an option negotiation. [standard, RFC 854]"""

    WILL = 251
    """Request or agreement to use an option on this side."""
    WONT = 252
    DO = 253
    """Request or permission for the other side to use an option."""
    DONT = 254


class Option(IntEnum):
    """Telnet option needed for a serial port. [standard]"""

    BINARY = 0
    """Binary transmission: bytes are not characters, and CR is not translated. RFC 856."""
    SUPPRESS_GO_AHEAD = 3
    """No Go Ahead commands are sent. RFC 858."""
    COM_PORT = 44
    """COM port control. RFC 2217."""


@dataclass(frozen=True, slots=True)
class Payload:
    """Payload bytes of the connection."""

    data: bytes


@dataclass(frozen=True, slots=True)
class Negotiation:
    """A negotiation command for an option, which may be unknown."""

    verb: Verb
    option: int


@dataclass(frozen=True, slots=True)
class Subnegotiation:
    """Subnegotiation of an option in use."""

    option: int
    data: bytes


@dataclass(frozen=True, slots=True)
class Garbled:
    """Invalid Telnet bytes. Reading continues after them."""

    text: str


TelnetEvent: TypeAlias = Payload | Negotiation | Subnegotiation | Garbled


def escaped(data: bytes) -> bytes:
    """Return the payload with each IAC byte doubled."""
    return data.replace(b"\xff", b"\xff\xff")


def negotiation(verb: Verb, option: int) -> bytes:
    """Encode a negotiation command for an option."""
    return bytes((IAC, verb, option))


def subnegotiation(option: int, data: bytes) -> bytes:
    """Encode a subnegotiation of an option."""
    return bytes((IAC, SUBNEGOTIATION_BEGIN, option)) + escaped(data) + bytes((IAC, SUBNEGOTIATION_END))


class _State(Enum):
    PAYLOAD = auto()
    COMMAND = auto()
    OPTION = auto()
    INSIDE = auto()
    INSIDE_COMMAND = auto()


class TelnetReader:
    """Parser of Telnet data in chunks of any size. It ignores commands without meaning for a serial port, such as
    no operation.
    """

    def __init__(self) -> None:
        self._state = _State.PAYLOAD
        self._verb = Verb.DONT
        self._inside = bytearray()
        """Option and data of the subnegotiation that is being read, truncated to the limit."""

    def receive(self, data: bytes) -> list[TelnetEvent]:
        """Process received bytes and return the events that they complete."""
        events: list[TelnetEvent] = []
        payload = bytearray()
        at = 0
        while at < len(data):
            if self._state is _State.PAYLOAD:
                command = data.find(IAC, at)
                end = len(data) if command < 0 else command
                payload += data[at:end]
                at = end
                if command < 0:
                    break
            byte, at = data[at], at + 1
            event = self._byte(byte, payload)
            if event is not None:
                if payload:
                    events.append(Payload(bytes(payload)))
                    payload.clear()
                events.append(event)
        if payload:
            events.append(Payload(bytes(payload)))
        return events

    def _byte(self, byte: int, payload: bytearray) -> TelnetEvent | None:
        match self._state:
            case _State.PAYLOAD:
                self._state = _State.COMMAND
            case _State.COMMAND:
                return self._command(byte, payload)
            case _State.OPTION:
                self._state = _State.PAYLOAD
                return Negotiation(self._verb, byte)
            case _State.INSIDE:
                if byte == IAC:
                    self._state = _State.INSIDE_COMMAND
                elif len(self._inside) <= SUBNEGOTIATION_LIMIT:
                    self._inside.append(byte)
            case _:
                return self._command_inside(byte, payload)
        return None

    def _command(self, byte: int, payload: bytearray) -> TelnetEvent | None:
        self._state = _State.PAYLOAD
        if byte == IAC:
            payload.append(byte)
        elif byte == SUBNEGOTIATION_BEGIN:
            self._state = _State.INSIDE
            self._inside.clear()
        elif byte >= Verb.WILL:
            self._verb = Verb(byte)
            self._state = _State.OPTION
        elif byte < SUBNEGOTIATION_END:
            return Garbled(f"FFh was followed by {byte:02X}h, which is not a command")
        return None

    def _command_inside(self, byte: int, payload: bytearray) -> TelnetEvent | None:
        self._state = _State.INSIDE
        if byte == IAC:
            if len(self._inside) <= SUBNEGOTIATION_LIMIT:
                self._inside.append(byte)
            return None
        if byte != SUBNEGOTIATION_END:
            # the end was lost: the next bytes are a separate command
            self._command(byte, payload)
            return Garbled("a subnegotiation is not terminated")
        self._state = _State.PAYLOAD
        if len(self._inside) > SUBNEGOTIATION_LIMIT:
            return Garbled(f"a subnegotiation is longer than {SUBNEGOTIATION_LIMIT} bytes")
        if not self._inside:
            return Garbled("a subnegotiation without an option")
        return Subnegotiation(self._inside[0], bytes(self._inside[1:]))


class Options:
    """Record of the options in use on each side. It answers only changes, so that two such sides cannot answer each
    other endlessly.
    """

    def __init__(self, wanted_here: Iterable[Option], wanted_there: Iterable[Option]) -> None:
        """Set the options that this side is willing to use, and the options that it permits the other side to use."""
        self._wanted = {Verb.DO: frozenset(wanted_here), Verb.WILL: frozenset(wanted_there)}
        self._requested: set[tuple[bool, int]] = set()
        self._used: set[tuple[bool, int]] = set()

    def ask(self) -> bytes:
        """Return the offers and requests for all options that this side is willing to use or permits."""
        data = b""
        for here, verb, options in (
            (True, Verb.WILL, self._wanted[Verb.DO]),
            (False, Verb.DO, self._wanted[Verb.WILL]),
        ):
            for option in sorted(options):
                self._requested.add((here, option))
                data += negotiation(verb, option)
        return data

    def receive(self, event: Negotiation) -> bytes:
        """Process a negotiation from the other side and return the response, which may be empty."""
        here = event.verb in (Verb.DO, Verb.DONT)
        agree, refuse = (Verb.WILL, Verb.WONT) if here else (Verb.DO, Verb.DONT)
        key = (here, event.option)
        was_requested = key in self._requested
        self._requested.discard(key)
        if event.verb in (Verb.DONT, Verb.WONT):
            used = key in self._used
            self._used.discard(key)
            return negotiation(refuse, event.option) if used else b""
        if event.option not in self._wanted[event.verb]:
            return negotiation(refuse, event.option)
        if key in self._used:
            return b""
        self._used.add(key)
        return b"" if was_requested else negotiation(agree, event.option)

    def used_here(self, option: Option) -> bool:
        """Return whether this side uses an option with the other side's consent."""
        return (True, option) in self._used
