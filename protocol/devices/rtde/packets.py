"""Packets of RTDE: a header with size and type, then a payload, all big-endian.

Source: Universal Robots' RTDE guide, and its RTDE_Python_Client_Library, `rtde/serialize.py`. The size includes the
header's own three bytes. TCP may split and join packets, so a receiver separates them by their size alone.
"""

import math
import struct
from enum import IntEnum
from typing import NamedTuple

from protocol.endpoint import LocalProtocolError, RemoteProtocolError
from protocol.fields import Field, Layout
from protocol.marks import Mark

HEADER = struct.Struct(">HB")
"""Header of a packet: the size of the packet including its header, in bytes, and its type."""
NAMES_MAX = 2048
"""Maximum number of bytes in a list of names. Source: the guide."""
PROTOCOL_VERSION = 2
"""Version of the protocol that the client requests."""
FIRST_VERSION = 1
"""Protocol version of a connection on which none was requested. Source: the guide. Its outputs have no rate and no
recipe, and its text messages consist of a level and the message. Sources: the guide, and `MessageV1` of the client
library.
"""


class Kind(IntEnum):
    """Type of a packet, which is the same in both directions."""

    VERSION = ord("V")
    """From the client: the requested protocol version. From the robot: whether the version is accepted."""
    CONTROLLER_VERSION = ord("v")
    TEXT = ord("M")
    DATA = ord("U")
    OUTPUTS = ord("O")
    """From the client: names of the requested outputs. From the robot: their types."""
    INPUTS = ord("I")
    """From the client: names of the inputs that it will send. From the robot: their types."""
    START = ord("S")
    PAUSE = ord("P")


class Packet(NamedTuple):
    """A packet without its header."""

    kind: int
    """Type of the packet: a `Kind`, or a number without a known meaning."""
    payload: bytes


class Version(NamedTuple):
    """Software version of a controller."""

    major: int
    minor: int
    bugfix: int
    build: int


class Level(IntEnum):
    """Severity of a text message."""

    EXCEPTION = 0
    ERROR = 1
    WARNING = 2
    INFO = 3


class Text(NamedTuple):
    """A text message from or to the controller."""

    message: str
    source: str
    level: int
    """Severity, normally a `Level`."""


class Types(NamedTuple):
    """Response to a list of names."""

    recipe: int
    """Number of the accepted recipe, or 0."""
    types: tuple[str, ...]
    """Type of each name, or `NOT_FOUND` or `IN_USE` instead."""


def encode(kind: Kind, payload: bytes = b"") -> bytes:
    """Encode a packet. Raises LocalProtocolError if the payload is too long for the size field."""
    size = HEADER.size + len(payload)
    if size > 0xFFFF:
        raise LocalProtocolError(f"a packet of {size} bytes is too long for its size field")
    return HEADER.pack(size, kind) + payload


class Reader:
    """Splitter of a byte stream of either direction into packets."""

    def __init__(self) -> None:
        self._rest = bytearray()

    def feed(self, data: bytes) -> None:
        """Process received bytes."""
        self._rest += data

    @property
    def waiting(self) -> int:
        """Number of buffered bytes of an incomplete packet, fewer than 65 536."""
        return len(self._rest)

    def next_packet(self) -> Packet | None:
        """Return the next complete packet, or None.

        Raises RemoteProtocolError if the size is smaller than a header. The start of the next packet is then
        unknown.
        """
        rest = self._rest
        if len(rest) < HEADER.size:
            return None
        size, kind = HEADER.unpack_from(rest)
        if size < HEADER.size:
            raise RemoteProtocolError(f"a packet states a size of {size} bytes, less than its header")
        if len(rest) < size:
            return None
        payload = bytes(rest[HEADER.size : size])
        del rest[:size]
        return Packet(kind, payload)


# --- payloads

VERSION_REQUEST = Layout(
    "a request for a protocol version", 2, ">", (Field("version", 0, "H", Mark.OBSERVED),)
)
ACCEPTED = Layout("an accept response", 1, ">", (Field("accepted", 0, "B", Mark.OBSERVED),))
CONTROLLER_VERSION = Layout(
    "a controller's version",
    16,
    ">",
    tuple(
        Field(name, 4 * place, "I", Mark.OBSERVED)
        for place, name in enumerate(("major", "minor", "bugfix", "build"))
    ),
)
OUTPUTS_HEAD = Layout("a list of outputs", 8, ">", (Field("frequency", 0, "d", Mark.OBSERVED, unit="Hz"),))
"""Layout of an output request before its names, which follow it and are separated by commas."""


def version_request(version: int = PROTOCOL_VERSION) -> bytes:
    """Encode the client's request for a protocol version."""
    return encode(Kind.VERSION, VERSION_REQUEST.pack_row(version))


def read_version_request(payload: bytes) -> int:
    """Decode the requested version. Raises RemoteProtocolError if the payload is invalid."""
    (version,) = _unpack_exact(VERSION_REQUEST, payload)
    return int(version)


def accepted(kind: Kind, yes: bool) -> bytes:
    """Encode the robot's response to a version request, a start or a pause."""
    return encode(kind, ACCEPTED.pack_row(yes))


def read_accepted(payload: bytes) -> bool:
    """Decode whether the robot accepts a request. Raises RemoteProtocolError if the payload is invalid."""
    if len(payload) != 1:
        raise RemoteProtocolError(f"an accept response has {len(payload)} bytes instead of one")
    return bool(ACCEPTED.unpack_row(payload)[0] == 1)


def controller_version(version: Version) -> bytes:
    """Encode the version of the robot's controller."""
    return encode(Kind.CONTROLLER_VERSION, CONTROLLER_VERSION.pack_row(*version))


def read_controller_version(payload: bytes) -> Version:
    """Decode the version of the robot's controller. Raises RemoteProtocolError if the payload is invalid."""
    return Version(*_unpack_exact(CONTROLLER_VERSION, payload))


def outputs_request(names: tuple[str, ...], frequency_hz: float) -> bytes:
    """Encode the client's request for outputs at a rate, Hz."""
    return encode(Kind.OUTPUTS, OUTPUTS_HEAD.pack_row(frequency_hz) + _join(names))


def read_outputs_request(payload: bytes, version: int = PROTOCOL_VERSION) -> tuple[float, tuple[str, ...]]:
    """Decode the rate, Hz, and the names of an output request. In protocol version 1, which has no rate, the rate
    is infinite. Raises RemoteProtocolError if the payload is invalid.
    """
    if version == FIRST_VERSION:
        return math.inf, split_names(payload)
    if len(payload) < OUTPUTS_HEAD.size:
        raise RemoteProtocolError(f"a list of outputs has {len(payload)} bytes; its rate alone has 8")
    (frequency,) = OUTPUTS_HEAD.unpack_row(payload)
    return frequency, split_names(payload[OUTPUTS_HEAD.size :])


def inputs_request(names: tuple[str, ...]) -> bytes:
    """Encode the client's request for inputs that it will write."""
    return encode(Kind.INPUTS, _join(names))


def types_answer(kind: Kind, answer: Types, version: int = PROTOCOL_VERSION) -> bytes:
    """Encode the robot's response to a list of names. In protocol version 1, outputs have no recipe."""
    recipe = b"" if kind is Kind.OUTPUTS and version == FIRST_VERSION else bytes((answer.recipe,))
    return encode(kind, recipe + _join(answer.types))


def without_recipe(data: bytes) -> bytes:
    """Convert a data packet of the robot to protocol version 1."""
    return encode(Kind.DATA, data[HEADER.size + 1 :])


def read_types(payload: bytes) -> Types:
    """Decode the robot's response to a list of names. Raises RemoteProtocolError if the payload is invalid."""
    if not payload:
        raise RemoteProtocolError("a response to a list of names is empty")
    return Types(payload[0], split_names(payload[1:]))


def text(note: Text, version: int = PROTOCOL_VERSION) -> bytes:
    """Encode a text message of either side. The texts are truncated to the limits of their length fields."""
    if version == FIRST_VERSION:
        return encode(Kind.TEXT, bytes((note.level,)) + note.message.encode("ascii", "replace")[:255])
    message, source = (part.encode("ascii", "replace")[:255] for part in (note.message, note.source))
    parts = bytes((len(message),)) + message + bytes((len(source),)) + source + bytes((note.level,))
    return encode(Kind.TEXT, parts)


def read_text(payload: bytes) -> Text:
    """Decode a text message. Raises RemoteProtocolError if the payload is invalid."""
    length = payload[0] if payload else -1
    message, rest = payload[1 : 1 + length], payload[1 + length :]
    source_length = rest[0] if length >= 0 and rest else -1
    if source_length < 0 or len(rest) != source_length + 2:
        raise RemoteProtocolError("the lengths in a text message do not match its size")
    return Text(_ascii(message), _ascii(rest[1:-1]), rest[-1])


def split_names(payload: bytes) -> tuple[str, ...]:
    """Split a list of names or types at its commas. A trailing comma, which some clients send, adds no name.

    Bytes that are not ASCII become question marks, and therefore match no variable.
    """
    return tuple(name.strip() for name in _ascii(payload.removesuffix(b",")).split(",")) if payload else ()


def _join(names: tuple[str, ...]) -> bytes:
    return ",".join(names).encode("ascii", "replace")


def _ascii(raw: bytes) -> str:
    return raw.decode("ascii", "replace").replace("�", "?")


def _unpack_exact(layout: Layout, payload: bytes) -> tuple[int, ...]:
    if len(payload) != layout.size:
        raise RemoteProtocolError(f"{layout.name} has {len(payload)} bytes instead of {layout.size}")
    return layout.unpack_row(payload)
