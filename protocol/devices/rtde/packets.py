"""Packets of RTDE: a header of size and type, then a payload, all big-endian.

Source: Universal Robots' RTDE guide, and its RTDE_Python_Client_Library, `rtde/serialize.py`. The size counts the
header's own three bytes. TCP may split packets and join them, so a receiver frames by the size alone.
"""

import math
import struct
from enum import IntEnum
from typing import NamedTuple

from protocol.endpoint import LocalProtocolError, RemoteProtocolError
from protocol.fields import Field, Layout
from protocol.marks import Mark

HEADER = struct.Struct(">HB")
"""Size of the packet with its header, bytes, and its type."""
NAMES_MAX = 2048
"""Longest list of names, bytes. Source: the guide."""
PROTOCOL_VERSION = 2
"""The version that is spoken here."""
FIRST_VERSION = 1
"""The version of a connection on which none was asked for. Source: the guide. Its outputs have no rate and no recipe,
and its texts are a level and the message; sources are the guide, and `MessageV1` of the client library.
"""


class Kind(IntEnum):
    """Type of a packet; the same both ways."""

    VERSION = ord("V")
    """Client: wanted protocol version. Robot: accepted or not."""
    CONTROLLER_VERSION = ord("v")
    TEXT = ord("M")
    DATA = ord("U")
    OUTPUTS = ord("O")
    """Names that the client wants to be sent, and their types."""
    INPUTS = ord("I")
    """Names that the client will send, and their types."""
    START = ord("S")
    PAUSE = ord("P")


class Packet(NamedTuple):
    """One packet without its header."""

    kind: int
    """A `Kind`, or a number without a meaning."""
    payload: bytes


class Version(NamedTuple):
    """Version of a controller."""

    major: int
    minor: int
    bugfix: int
    build: int


class Level(IntEnum):
    """Weight of a text."""

    EXCEPTION = 0
    ERROR = 1
    WARNING = 2
    INFO = 3


class Text(NamedTuple):
    """A text of the controller, or one for it."""

    message: str
    source: str
    level: int
    """A `Level`."""


class Types(NamedTuple):
    """Answer to a list of names."""

    recipe: int
    """Number of the recipe; 0 if there is none."""
    types: tuple[str, ...]
    """One for each name, or `NOT_FOUND` or `IN_USE` in its place."""


def encode(kind: Kind, payload: bytes = b"") -> bytes:
    """Encode a packet. Raises LocalProtocolError for a payload that is too long for the size field."""
    size = HEADER.size + len(payload)
    if size > 0xFFFF:
        raise LocalProtocolError(f"a packet of {size} bytes is longer than its size field can tell")
    return HEADER.pack(size, kind) + payload


class Reader:
    """Cuts bytes of either direction into packets, however they come."""

    def __init__(self) -> None:
        self._rest = bytearray()

    def feed(self, data: bytes) -> None:
        """Take what came."""
        self._rest += data

    @property
    def waiting(self) -> int:
        """Bytes that are no whole packet yet; less than 65 536."""
        return len(self._rest)

    def next_packet(self) -> Packet | None:
        """Return the next complete packet, or None.

        Raises RemoteProtocolError for a size below that of a header: where the next packet begins is not known then.
        """
        rest = self._rest
        if len(rest) < HEADER.size:
            return None
        size, kind = HEADER.unpack_from(rest)
        if size < HEADER.size:
            raise RemoteProtocolError(f"a packet says that it has {size} bytes, fewer than its header")
        if len(rest) < size:
            return None
        payload = bytes(rest[HEADER.size : size])
        del rest[:size]
        return Packet(kind, payload)


# --- payloads

VERSION_REQUEST = Layout(
    "a request for a protocol version", 2, ">", (Field("version", 0, "H", Mark.OBSERVED),)
)
ACCEPTED = Layout("an answer of yes or no", 1, ">", (Field("accepted", 0, "B", Mark.OBSERVED),))
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
"""Names follow, with commas between them."""


def version_request(version: int = PROTOCOL_VERSION) -> bytes:
    """Encode the client's request for a protocol version."""
    return encode(Kind.VERSION, VERSION_REQUEST.pack_row(version))


def read_version_request(payload: bytes) -> int:
    """Read the requested version. Raises RemoteProtocolError."""
    (version,) = _exactly(VERSION_REQUEST, payload)
    return int(version)


def accepted(kind: Kind, yes: bool) -> bytes:
    """Encode the robot's answer to a version, a start or a pause."""
    return encode(kind, ACCEPTED.pack_row(yes))


def read_accepted(payload: bytes) -> bool:
    """Whether the robot takes it. Raises RemoteProtocolError."""
    if len(payload) != 1:
        raise RemoteProtocolError(f"an answer of yes or no has {len(payload)} bytes instead of one")
    return bool(ACCEPTED.unpack_row(payload)[0] == 1)


def controller_version(version: Version) -> bytes:
    """Encode the robot's version."""
    return encode(Kind.CONTROLLER_VERSION, CONTROLLER_VERSION.pack_row(*version))


def read_controller_version(payload: bytes) -> Version:
    """Read the robot's version. Raises RemoteProtocolError."""
    return Version(*_exactly(CONTROLLER_VERSION, payload))


def outputs_request(names: tuple[str, ...], frequency_hz: float) -> bytes:
    """Encode the client's request for outputs at a rate."""
    return encode(Kind.OUTPUTS, OUTPUTS_HEAD.pack_row(frequency_hz) + _joined(names))


def read_outputs_request(payload: bytes, version: int = PROTOCOL_VERSION) -> tuple[float, tuple[str, ...]]:
    """Rate, Hz, and names; in version 1 an infinite rate, for it asks for none. Raises RemoteProtocolError."""
    if version == FIRST_VERSION:
        return math.inf, split_names(payload)
    if len(payload) < OUTPUTS_HEAD.size:
        raise RemoteProtocolError(f"a list of outputs has {len(payload)} bytes; its rate alone has 8")
    (frequency,) = OUTPUTS_HEAD.unpack_row(payload)
    return frequency, split_names(payload[OUTPUTS_HEAD.size :])


def inputs_request(names: tuple[str, ...]) -> bytes:
    """Encode the client's request for inputs."""
    return encode(Kind.INPUTS, _joined(names))


def types_answer(kind: Kind, answer: Types, version: int = PROTOCOL_VERSION) -> bytes:
    """Encode the robot's answer to a list of names. Outputs have no recipe in version 1."""
    recipe = b"" if kind is Kind.OUTPUTS and version == FIRST_VERSION else bytes((answer.recipe,))
    return encode(kind, recipe + _joined(answer.types))


def without_recipe(data: bytes) -> bytes:
    """Convert a data packet of the robot to version 1."""
    return encode(Kind.DATA, data[HEADER.size + 1 :])


def read_types(payload: bytes) -> Types:
    """Read the robot's answer to a list of names. Raises RemoteProtocolError."""
    if not payload:
        raise RemoteProtocolError("an answer to a list of names is empty")
    return Types(payload[0], split_names(payload[1:]))


def text(words: Text, version: int = PROTOCOL_VERSION) -> bytes:
    """Encode a text of either side, cut to what its length fields allow."""
    if version == FIRST_VERSION:
        return encode(Kind.TEXT, bytes((words.level,)) + words.message.encode("ascii", "replace")[:255])
    message, source = (part.encode("ascii", "replace")[:255] for part in (words.message, words.source))
    parts = bytes((len(message),)) + message + bytes((len(source),)) + source + bytes((words.level,))
    return encode(Kind.TEXT, parts)


def read_text(payload: bytes) -> Text:
    """Read a text. Raises RemoteProtocolError."""
    length = payload[0] if payload else -1
    message, rest = payload[1 : 1 + length], payload[1 + length :]
    source_length = rest[0] if length >= 0 and rest else -1
    if source_length < 0 or len(rest) != source_length + 2:
        raise RemoteProtocolError("a text's lengths do not fit its bytes")
    return Text(_ascii(message), _ascii(rest[1:-1]), rest[-1])


def split_names(payload: bytes) -> tuple[str, ...]:
    """Names or types of a list with commas; one at the end is no further name, as some clients send it.

    Bytes that are no ASCII become question marks, and so names of no variable.
    """
    return tuple(name.strip() for name in _ascii(payload.removesuffix(b",")).split(",")) if payload else ()


def _joined(names: tuple[str, ...]) -> bytes:
    return ",".join(names).encode("ascii", "replace")


def _ascii(raw: bytes) -> str:
    return raw.decode("ascii", "replace").replace("�", "?")


def _exactly(layout: Layout, payload: bytes) -> tuple[int, ...]:
    if len(payload) != layout.size:
        raise RemoteProtocolError(f"{layout.name} has {len(payload)} bytes instead of {layout.size}")
    return layout.unpack_row(payload)
