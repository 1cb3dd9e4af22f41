"""Register protocol: requests and responses that carry a board's words over a byte stream.

A header of fixed size gives the length of the rest. All numbers are big-endian. A word is sent as its raw 16 bits.
`docs/reference/jr3-registers.md` documents the same tables. The protocol is this project's own, so its properties
are chosen.
"""

import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import Final, Generic, TypeAlias, TypeVar

from protocol.devices.jr3.board import pack_words
from protocol.endpoint import LocalProtocolError, RemoteProtocolError
from protocol.fields import Field, Layout
from protocol.marks import Mark

MAX_WORDS = 256
"""Maximum number of words in one burst."""
MAX_PAYLOAD = 16384
"""Maximum number of bytes after one response header. A client must be able to buffer them."""
MAX_BURSTS = 255
"""Maximum number of bursts in one response, within `MAX_PAYLOAD`."""

_REQUEST_MAGIC = b"JR"
_RESPONSE_MAGIC = b"jr"


class Op(IntEnum):
    """Kind of a request. The response has the same kind."""

    CONNECTION = 0
    """Message about the connection, not about a request. Only a server sends it, and then closes the connection."""
    READ = 1
    """Read `count` words from `address` as one snapshot."""
    WRITE = 2
    """Write the words after the header in ascending order, starting at `address`."""
    RESET = 3
    """Reset the board, as its driver does."""
    STREAM = 4
    """Read `count` words from `address` every `period_us` on the server's clock. A period of 0 ends the stream."""
    PROGRAM = 5
    """Write instructions of the board's processor, starting at instruction number `address`. The words after the
    header alternate between the low and the high half of each instruction. Without words, the processor is reset
    and its program starts.
    """


class Status(IntEnum):
    """Result of a request."""

    OK = 0
    UNKNOWN_OP = 1
    OUTSIDE_MAP = 2
    BAD_COUNT = 3
    BAD_PERIOD = 4
    BAD_FRAME = 5
    TOO_MANY_CLIENTS = 6
    IDLE = 7
    REFUSED = 8

    @property
    def meaning(self) -> str:
        """Text of the status."""
        return _MEANINGS[self]


_MEANINGS = {
    Status.OK: "done",
    Status.UNKNOWN_OP: "unknown op",
    Status.OUTSIDE_MAP: "words outside the board's memory map",
    Status.BAD_COUNT: f"a burst has 1 … {MAX_WORDS} words, a response at most {MAX_PAYLOAD} bytes of them",
    Status.BAD_PERIOD: "the requested stream is too fast for the server",
    Status.BAD_FRAME: "the data received is not a request; the connection is closed",
    Status.TOO_MANY_CLIENTS: "the maximum number of clients is connected; the connection is closed",
    Status.IDLE: "no request for too long; the connection is closed",
    Status.REFUSED: "the server is not allowed to do this with its board",
}


def _field(name: str, offset: int, code: str, meaning: str, unit: str = "") -> Field:
    return Field(name, offset, code, Mark.CHOSEN, meaning, unit=unit)


REQUEST: Final = Layout(
    "request",
    14,
    ">",
    (
        _field("magic", 0, "H", "4A52, the letters JR"),
        _field("op", 2, "B", "1 read, 2 write, 3 reset, 4 stream, 5 program"),
        _field("bursts", 3, "B", "stream: bursts in one response, 0 = 1; else ignored"),
        _field("tag", 4, "H", "any number; the response repeats it"),
        _field("address", 6, "H", "first word"),
        _field("count", 8, "H", "words, 1 … 256; in a write or a program they follow the header"),
        _field("period_us", 10, "I", "stream: from burst to burst, 0 ends the stream; else ignored", "µs"),
    ),
)
RESPONSE: Final = Layout(
    "response",
    12,
    ">",
    (
        _field("magic", 0, "H", "6A72, the letters jr"),
        _field("op", 2, "B", "of the request; 0: about the connection"),
        _field("status", 3, "B", "0 done, else the reason for the refusal"),
        _field("tag", 4, "H", "of the request; a stream's bursts have that of the request that started it"),
        _field("address", 6, "H", "of the request"),
        _field("count", 8, "H", "words in each burst"),
        _field("bursts", 10, "B", "bursts after the header; 0 if nothing was read"),
        _field("reserved", 11, "B", "0"),
    ),
)
BURST: Final = Layout(
    "burst",
    8,
    ">",
    (_field("time_ns", 0, "Q", "time at which its words were read; server's clock", "ns"),),
)


@dataclass(frozen=True, slots=True)
class Request:
    """Request from a client."""

    op: int
    """Kind of the request: an `Op`, or a number unknown to the server."""
    tag: int
    address: int = 0
    count: int = 0
    """Number of words to read, or for a write or a program, the number of `words`."""
    words: tuple[int, ...] = ()
    period_us: int = 0
    bursts: int = 1


@dataclass(frozen=True, slots=True)
class Burst:
    """Consecutive words, read as one snapshot."""

    time_ns: int
    """Time on the server's clock, ns. The zero of the clock is arbitrary."""
    words: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Response:
    """Response of the server, or one delivery of a stream."""

    op: int
    status: Status
    tag: int
    address: int = 0
    count: int = 0
    bursts: tuple[Burst, ...] = ()


@dataclass(frozen=True, slots=True)
class Garbage:
    """Bytes that are not a telegram, which means that the two sides are out of step. Reported once until the next
    telegram is recognised.
    """

    text: str


def encode_request(request: Request) -> bytes:
    """Encode a request. Raises LocalProtocolError if a value does not fit into its field or the number of words is
    invalid.
    """
    fewest = _FEWEST.get(request.op)
    if fewest is not None and not (
        request.count == len(request.words) and fewest <= request.count <= MAX_WORDS
    ):
        raise LocalProtocolError(
            f"a {Op(request.op).name.lower()} has {fewest} … {MAX_WORDS} words, got {len(request.words)}"
        )
    header = REQUEST.pack(
        {
            "magic": int.from_bytes(_REQUEST_MAGIC),
            "op": request.op,
            "bursts": request.bursts,
            "tag": request.tag,
            "address": request.address,
            "count": request.count,
            "period_us": request.period_us,
        }
    )
    return header + (b"" if fewest is None else pack_words(request.words))


def encode_response(response: Response) -> bytes:
    """Encode a response. Raises LocalProtocolError if a value does not fit into its field or into a response."""
    if any(len(burst.words) != response.count for burst in response.bursts):
        raise LocalProtocolError(f"every burst of this response must have {response.count} words")
    if not fits(response.count, len(response.bursts)):
        raise LocalProtocolError(f"a response carries at most {MAX_PAYLOAD} bytes of bursts")
    return encode_head(response, len(response.bursts)) + b"".join(
        [BURST.pack_row(burst.time_ns) + pack_words(burst.words) for burst in response.bursts]
    )


def encode_head(response: Response, bursts: int) -> bytes:
    """Encode the header of a response with this number of bursts. For a stream, this is the number of bursts in
    every delivery.

    Raises LocalProtocolError if a value does not fit into its field.
    """
    head = response.op, response.status, response.tag, response.address, response.count
    return RESPONSE.pack_row(int.from_bytes(_RESPONSE_MAGIC), *head, bursts, 0)


def fits(count: int, bursts: int) -> bool:
    """Return whether `bursts` bursts of `count` words each fit into one response."""
    return bursts <= MAX_BURSTS and bursts * (BURST.size + 2 * count) <= MAX_PAYLOAD


def _unpack_words(data: bytes, at: int, count: int) -> tuple[int, ...]:
    return struct.unpack_from(f">{count}H", data, at)


_FEWEST: Final[Mapping[int, int]] = {Op.WRITE: 1, Op.PROGRAM: 0}
"""Minimum number of words after the header, for each op whose requests carry words."""


def _request_size(header: bytes) -> int:
    """Return the length of the request with this header. Raises RemoteProtocolError if the header is invalid."""
    values = REQUEST.unpack(header)
    op, count = int(values["op"]), int(values["count"])
    if (fewest := _FEWEST.get(op)) is None:
        return REQUEST.size
    if not fewest <= count <= MAX_WORDS:
        raise RemoteProtocolError(f"a {Op(op).name.lower()} of {count} words")
    return REQUEST.size + 2 * count


def _decode_request(data: bytes) -> Request:
    values = REQUEST.unpack(data)
    op, count = int(values["op"]), int(values["count"])
    return Request(
        op,
        int(values["tag"]),
        int(values["address"]),
        count,
        _unpack_words(data, REQUEST.size, count) if op in _FEWEST else (),
        int(values["period_us"]),
        int(values["bursts"]),
    )


_STATUSES = frozenset(Status)


def _response_size(header: bytes) -> int:
    _, _, status, _, _, count, bursts, _ = RESPONSE.unpack_row(header)
    if status not in _STATUSES:
        raise RemoteProtocolError(f"a status of {status}")
    if not fits(count, bursts):
        raise RemoteProtocolError(f"{bursts} bursts of {count} words in one response")
    return RESPONSE.size + int(bursts) * (BURST.size + 2 * int(count))


def _decode_response(data: bytes) -> Response:
    _, op, status, tag, address, count, bursts, _ = RESPONSE.unpack_row(data)
    step = BURST.size + 2 * count
    starts = range(RESPONSE.size, RESPONSE.size + bursts * step, step)
    return Response(
        op,
        Status(status),
        tag,
        address,
        count,
        tuple(
            [
                Burst(int.from_bytes(data[at : at + BURST.size]), _unpack_words(data, at + BURST.size, count))
                for at in starts
            ]
        ),
    )


Telegram = TypeVar("Telegram")


class _Reader(Generic[Telegram]):
    """Splitter of a byte stream into telegrams. It buffers at most one incomplete telegram."""

    def __init__(
        self,
        magic: bytes,
        header: Layout,
        size: Callable[[bytes], int],
        decode: Callable[[bytes], Telegram],
    ) -> None:
        self._magic = magic
        self._header = header
        self._size = size
        self._decode = decode
        self._data = b""
        self._lost = False

    def feed(self, data: bytes) -> list[Telegram | Garbage]:
        """Process received bytes and return the telegrams that they complete, in order."""
        data = self._data + data
        at, telegrams = 0, list[Telegram | Garbage]()
        while at < len(data):
            if not data.startswith(self._magic[: len(data) - at], at):
                at = self._skip(
                    data, at, f"no {self._header.name} begins with {data[at : at + 1].hex()}", telegrams
                )
                continue
            if len(data) - at < self._header.size:
                break
            try:
                size = self._size(data[at : at + self._header.size])
            except RemoteProtocolError as error:
                at = self._skip(data, at, f"no {self._header.name}: {error}", telegrams)
                continue
            if len(data) - at < size:
                break
            telegrams.append(self._decode(data[at : at + size]))
            self._lost = False
            at += size
        self._data = data[at:]
        return telegrams

    @property
    def between(self) -> bool:
        """Whether the next byte starts a telegram: nothing is buffered, and the two sides are in step."""
        return not self._data and not self._lost

    def _skip(self, data: bytes, at: int, why: str, telegrams: list[Telegram | Garbage]) -> int:
        """Return the next index after `at` at which a telegram may start. Report the garbage once."""
        if not self._lost:
            self._lost = True
            telegrams.append(Garbage(why))
        following = data.find(self._magic[:1], at + 1)
        return len(data) if following < 0 else following


RequestReader: TypeAlias = _Reader[Request]
ResponseReader: TypeAlias = _Reader[Response]


def request_reader() -> RequestReader:
    """Create a reader of data from a client. Its `feed(data)` returns a list of Request and Garbage."""
    return _Reader(_REQUEST_MAGIC, REQUEST, _request_size, _decode_request)


def response_reader() -> ResponseReader:
    """Create a reader of data from a server. Its `feed(data)` returns a list of Response and Garbage."""
    return _Reader(_RESPONSE_MAGIC, RESPONSE, _response_size, _decode_response)
