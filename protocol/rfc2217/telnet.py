"""Telnet's own bytes: commands apart from the payload, and the negotiation of options.

References: RFC 854 (commands), RFC 855 (options and subnegotiation), RFC 1143 (how not to loop).
"""

from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum, IntEnum, auto
from typing import TypeAlias

IAC = 255
"""Begins a command; doubled it is a byte of the payload. [standard, RFC 854]"""
SUBNEGOTIATION_BEGIN = 250
SUBNEGOTIATION_END = 240

SUBNEGOTIATION_LIMIT = 256
"""Bytes of a subnegotiation. Chosen: those of the com port option have five at most, but for a signature's text."""


class Verb(IntEnum):
    """Verbs about an option. [standard, RFC 854]"""

    WILL = 251
    """I want to use it, or agree to."""
    WONT = 252
    DO = 253
    """You shall use it, or may."""
    DONT = 254


class Option(IntEnum):
    """The options that a serial port needs. [standard]"""

    BINARY = 0
    """Bytes are no characters: nothing is done to CR. RFC 856."""
    SUPPRESS_GO_AHEAD = 3
    """RFC 858."""
    COM_PORT = 44
    """RFC 2217."""


@dataclass(frozen=True, slots=True)
class Payload:
    """Bytes of the connection proper."""

    data: bytes


@dataclass(frozen=True, slots=True)
class Negotiation:
    """Something was said about an option, which may be one that we do not know."""

    verb: Verb
    option: int


@dataclass(frozen=True, slots=True)
class Subnegotiation:
    """Message of an option that is in use."""

    option: int
    data: bytes


@dataclass(frozen=True, slots=True)
class Garbled:
    """Something that is no Telnet; reading continues behind it."""

    text: str


TelnetEvent: TypeAlias = Payload | Negotiation | Subnegotiation | Garbled


def escaped(data: bytes) -> bytes:
    """Payload as it travels."""
    return data.replace(b"\xff", b"\xff\xff")


def negotiation(verb: Verb, option: int) -> bytes:
    """Something said about an option, as it travels."""
    return bytes((IAC, verb, option))


def subnegotiation(option: int, data: bytes) -> bytes:
    """Message of an option, as it travels."""
    return bytes((IAC, SUBNEGOTIATION_BEGIN, option)) + escaped(data) + bytes((IAC, SUBNEGOTIATION_END))


class _State(Enum):
    PAYLOAD = auto()
    COMMAND = auto()
    OPTION = auto()
    INSIDE = auto()
    INSIDE_COMMAND = auto()


class TelnetReader:
    """Takes bytes in any pieces. Commands without meaning for a serial port, such as no operation, are passed over."""

    def __init__(self) -> None:
        self._state = _State.PAYLOAD
        self._verb = Verb.DONT
        self._inside = bytearray()
        """Option and data of the subnegotiation that is being read, no longer than it may be."""

    def receive(self, data: bytes) -> list[TelnetEvent]:
        """Events that these bytes complete."""
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
            return Garbled(f"FFh was followed by {byte:02X}h, which is no command")
        return None

    def _command_inside(self, byte: int, payload: bytearray) -> TelnetEvent | None:
        self._state = _State.INSIDE
        if byte == IAC:
            if len(self._inside) <= SUBNEGOTIATION_LIMIT:
                self._inside.append(byte)
            return None
        if byte != SUBNEGOTIATION_END:
            # the end was lost: the next bytes are a command of their own
            self._command(byte, payload)
            return Garbled("a subnegotiation has no end")
        self._state = _State.PAYLOAD
        if len(self._inside) > SUBNEGOTIATION_LIMIT:
            return Garbled(f"a subnegotiation is longer than {SUBNEGOTIATION_LIMIT} bytes")
        if not self._inside:
            return Garbled("a subnegotiation names no option")
        return Subnegotiation(self._inside[0], bytes(self._inside[1:]))


class Options:
    """Which options each side uses. An answer is given only to what changes something, so that no two sides of
    this kind can answer each other for ever.
    """

    def __init__(self, wanted_here: Iterable[Option], wanted_there: Iterable[Option]) -> None:
        """Options that this side is ready to use, and those that it lets the other side use."""
        self._wanted = {Verb.DO: frozenset(wanted_here), Verb.WILL: frozenset(wanted_there)}
        self._asked: set[tuple[bool, int]] = set()
        self._used: set[tuple[bool, int]] = set()

    def ask(self) -> bytes:
        """Offer and ask for everything that is wanted."""
        said = b""
        for here, verb, wanted in (
            (True, Verb.WILL, self._wanted[Verb.DO]),
            (False, Verb.DO, self._wanted[Verb.WILL]),
        ):
            for option in sorted(wanted):
                self._asked.add((here, option))
                said += negotiation(verb, option)
        return said

    def receive(self, said: Negotiation) -> bytes:
        """Take what the other side said; gives the answer to it, which may be empty."""
        here = said.verb in (Verb.DO, Verb.DONT)
        agree, refuse = (Verb.WILL, Verb.WONT) if here else (Verb.DO, Verb.DONT)
        key = (here, said.option)
        asked = key in self._asked
        self._asked.discard(key)
        if said.verb in (Verb.DONT, Verb.WONT):
            used = key in self._used
            self._used.discard(key)
            return negotiation(refuse, said.option) if used else b""
        if said.option not in self._wanted[said.verb]:
            return negotiation(refuse, said.option)
        if key in self._used:
            return b""
        self._used.add(key)
        return b"" if asked else negotiation(agree, said.option)

    def used_here(self, option: Option) -> bool:
        """Whether this side uses an option, with the other's consent."""
        return (True, option) in self._used
