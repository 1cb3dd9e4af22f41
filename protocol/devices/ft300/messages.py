"""Bytes of a Robotiq FT 300: messages of its stream, and frames of Modbus RTU.

19200 baud, 8 data bits, no parity, 1 stop bit. Sources: the sensor's manuals, the vendor's own ROS driver
(ros-industrial/robotiq), ft300python, read for facts only.
"""

import struct
from collections.abc import Sequence
from typing import NamedTuple

from protocol.endpoint import LocalProtocolError, RemoteProtocolError
from protocol.fields import Field, Layout
from protocol.geometry import Wrench
from protocol.marks import Mark
from protocol.wrench import AXES

BAUDRATE = 19_200
"""Source: manual."""
SLAVE = 9
"""Source: manual."""
PERIOD_S = 0.01
"""Between two messages of the stream. Source: manual."""
COUNT_END = 32767
"""Largest count; the least is one less than its negative."""

HEADER = b"\x20\x4e"
MESSAGE_SIZE = 16
STOP = b"\xff" * 50
"""Ends the stream. Source: manual."""
MESSAGE = Layout(
    "stream message",
    MESSAGE_SIZE - 2,
    "<",
    tuple(
        Field(axis, len(HEADER) + 2 * place, "h", Mark.OBSERVED, "", 0.01 if place < 3 else 0.001, unit)
        for place, (axis, unit) in enumerate(zip(AXES, ("N",) * 3 + ("N·m",) * 3, strict=True))
    ),
)
"""Behind its header, and before its check of two bytes, low byte first. Source: manual."""
_fx, _fy, _fz, _mx, _my, _mz = (field.scale for field in MESSAGE.fields)
_unpack_message = MESSAGE.struct.unpack_from
SCALES: Wrench = (_fx, _fy, _fz, _mx, _my, _mz)
"""N and N·m for one count."""

READ, READ_INPUT, WRITE_ONE, WRITE = 0x03, 0x04, 0x06, 0x10
EXCEPTION_BIT = 0x80
ILLEGAL_FUNCTION, ILLEGAL_ADDRESS, ILLEGAL_VALUE = 1, 2, 3
EXCEPTIONS = {1: "unknown function", 2: "unknown register", 3: "wrong count or value", 4: "device failure"}
"""Standard: Modbus."""

WRENCH_REGISTER, ACCELERATION_REGISTER, MODE_REGISTER = 180, 190, 410
VERSION_REGISTER, SERIAL_REGISTER, YEAR_REGISTER = 500, 510, 514
STREAM_MODE = 0x0200
"""Value of the mode register that begins the stream. Source: manual."""
MOST_REGISTERS = 125
"""Of one read. Standard: Modbus."""


def _crc_table() -> tuple[int, ...]:
    table = []
    for byte in range(256):
        crc = byte
        for _ in range(8):
            crc = crc >> 1 ^ 0xA001 if crc & 1 else crc >> 1
        table.append(crc)
    return tuple(table)


_TABLE = _crc_table()


def crc16(data: bytes) -> int:
    """Modbus' check of bytes."""
    crc, table = 0xFFFF, _TABLE
    for byte in data:
        crc = crc >> 8 ^ table[(crc ^ byte) & 0xFF]
    return crc


def with_crc(data: bytes) -> bytes:
    """Append the check to the bytes, low byte first."""
    return data + crc16(data).to_bytes(2, "little")


def crc_fits(frame: bytes) -> bool:
    """Whether a frame ends with its check."""
    return len(frame) > 2 and crc16(frame[:-2]) == int.from_bytes(frame[-2:], "little")


# --- stream


def encode_message(counts: Sequence[int]) -> bytes:
    """Encode a message of six counts. Raises LocalProtocolError for counts that do not fit."""
    return with_crc(HEADER + MESSAGE.pack_row(*counts)[len(HEADER) :])


def decode_message(data: bytes) -> tuple[int, ...]:
    """Six counts. Raises RemoteProtocolError for bytes that are no message."""
    if len(data) != MESSAGE_SIZE or not data.startswith(HEADER):
        raise RemoteProtocolError("a stream message has 16 bytes and begins with 20 4E")
    if not crc_fits(data):
        raise RemoteProtocolError("the check of the stream message is wrong")
    return _unpack_message(data)


class StreamReader:
    """Messages out of bytes that begin anywhere: a header may stand inside the data, so the check decides."""

    def __init__(self) -> None:
        self._waiting = b""
        self.noises = 0
        """Unbroken runs of bytes that belong to no message."""
        self.missed = 0
        """Messages that these runs take the place of: by their length, so that a byte that comes twice is none."""
        self._in_noise = False
        self._noise_bytes = 0

    def feed(self, data: bytes) -> list[tuple[int, ...]]:
        """Take what came; the messages that are complete, oldest first. At most 15 bytes are kept."""
        waiting, at, found = self._waiting + data, 0, []
        while len(waiting) - at >= MESSAGE_SIZE:
            message = waiting[at : at + MESSAGE_SIZE]
            if message.startswith(HEADER) and crc_fits(message):
                found.append(_unpack_message(message))
                at += MESSAGE_SIZE
                self.missed += round(self._noise_bytes / MESSAGE_SIZE)
                self._in_noise, self._noise_bytes = False, 0
                continue
            self.noises += not self._in_noise
            self._in_noise = True
            following = waiting.find(HEADER[:1], at + 1)
            end = len(waiting) if following < 0 else following
            self._noise_bytes, at = self._noise_bytes + end - at, end
        self._waiting = waiting[at:]
        return found


# --- Modbus RTU


class Request(NamedTuple):
    """A request to the sensor, without slave and check."""

    function: int
    register: int
    values: tuple[int, ...] = ()
    """Words to write."""
    words: int = 0
    """Number of words to read or to write."""


def encode_read(register: int, count: int, function: int = READ) -> bytes:
    """Encode a request to read registers. Raises LocalProtocolError for values that do not fit."""
    return _packed(">BBHH", SLAVE, function, register, count)


def encode_write(register: int, *words: int) -> bytes:
    """Write words from a register on (function 16). Raises LocalProtocolError for values that do not fit."""
    count = len(words)
    return _packed(f">BBHHB{count}H", SLAVE, WRITE, register, count, 2 * count, *words)


def encode_words(function: int, words: Sequence[int]) -> bytes:
    """Answer to a read. Raises LocalProtocolError for words that do not fit."""
    return _packed(f">BBB{len(words)}H", SLAVE, function, 2 * len(words), *words)


def encode_written(request: Request) -> bytes:
    """Answer to a write."""
    if request.function == WRITE_ONE:
        return _packed(">BBHH", SLAVE, WRITE_ONE, request.register, request.values[0])
    return _packed(">BBHH", SLAVE, WRITE, request.register, request.words)


def encode_exception(function: int, code: int) -> bytes:
    """Answer to a request that is refused."""
    return _packed(">BBB", SLAVE, function | EXCEPTION_BIT, code)


def request_size(head: bytes) -> int | None:
    """Bytes of the request that begins so; None where more bytes are needed to tell."""
    if len(head) < 2:
        return None
    if head[1] == WRITE:
        return None if len(head) < 7 else 9 + head[6]
    return 8


def decode_request(frame: bytes) -> Request:
    """Decode a complete request with a valid check. Raises RemoteProtocolError for contradictory lengths."""
    function = frame[1]
    if function == WRITE:
        register, count, size = struct.unpack_from(">HHB", frame, 2)
        if size != 2 * count or len(frame) != 9 + size:
            raise RemoteProtocolError("the byte count of the write does not fit")
        return Request(function, register, struct.unpack_from(f">{count}H", frame, 7), count)
    register, value = struct.unpack_from(">HH", frame, 2)
    if function == WRITE_ONE:
        return Request(function, register, (value,), 1)
    return Request(function, register, (), value)


def find_answer(data: bytes, function: int, size: int) -> tuple[bytes | int, int] | None:
    """Find the answer to a request in received data: its payload, or the code of an exception, and where it ends.

    `size` is that of the whole answer. None until it is there; what stands before it is passed over.
    """
    for at in range(len(data) - 4):
        if data[at] != SLAVE:
            continue
        if data[at + 1] == function and crc_fits(data[at : at + size]) and len(data) >= at + size:
            return data[at + 2 : at + size - 2], at + size
        if data[at + 1] == function | EXCEPTION_BIT and crc_fits(data[at : at + 5]):
            return data[at + 2], at + 5
    return None


def words_of(payload: bytes) -> tuple[int, ...]:
    """Words of the answer to a read, from its payload. Raises RemoteProtocolError for a wrong byte count."""
    if not payload or payload[0] != len(payload) - 1 or payload[0] % 2:
        raise RemoteProtocolError("the byte count of the answer does not fit")
    return struct.unpack(f">{payload[0] // 2}H", payload[1:])


def signed(word: int) -> int:
    """Return a word as a signed number."""
    return word - 0x10000 if word & 0x8000 else word


def _packed(form: str, *values: int) -> bytes:
    try:
        return with_crc(struct.pack(form, *values))
    except struct.error as error:
        raise LocalProtocolError(f"Modbus: {error}") from error
