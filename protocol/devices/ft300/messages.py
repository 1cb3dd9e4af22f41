"""Messages of a Robotiq FT 300: its stream, and Modbus RTU frames.

The line has 19200 baud, 8 data bits, no parity and 1 stop bit. Sources: the sensor's manuals, the vendor's ROS
driver (ros-industrial/robotiq) and ft300python, consulted for facts only.
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
"""Baud rate of the line. Source: manual."""
SLAVE = 9
"""Modbus address of the sensor. Source: manual."""
PERIOD_S = 0.01
"""Time between two messages of the stream, s. Source: manual."""
COUNT_END = 32767
"""Largest count. The smallest count is one less than the negative of this value."""

HEADER = b"\x20\x4e"
MESSAGE_SIZE = 16
STOP = b"\xff" * 50
"""Bytes that end the stream. Source: manual."""
MESSAGE = Layout(
    "stream message",
    MESSAGE_SIZE - 2,
    "<",
    tuple(
        Field(axis, len(HEADER) + 2 * place, "h", Mark.OBSERVED, "", 0.01 if place < 3 else 0.001, unit)
        for place, (axis, unit) in enumerate(zip(AXES, ("N",) * 3 + ("N·m",) * 3, strict=True))
    ),
)
"""Layout of a message without its two-byte CRC, which is sent low byte first. Source: manual."""
_fx, _fy, _fz, _mx, _my, _mz = (field.scale for field in MESSAGE.fields)
_unpack_message = MESSAGE.struct.unpack_from
SCALES: Wrench = (_fx, _fy, _fz, _mx, _my, _mz)
"""Scale of each axis, N or N·m per count."""

READ, READ_INPUT, WRITE_ONE, WRITE = 0x03, 0x04, 0x06, 0x10
EXCEPTION_BIT = 0x80
ILLEGAL_FUNCTION, ILLEGAL_ADDRESS, ILLEGAL_VALUE = 1, 2, 3
EXCEPTIONS = {1: "unknown function", 2: "unknown register", 3: "wrong count or value", 4: "device failure"}
"""Meaning of each exception code. Standard: Modbus."""

WRENCH_REGISTER, ACCELERATION_REGISTER, MODE_REGISTER = 180, 190, 410
VERSION_REGISTER, SERIAL_REGISTER, YEAR_REGISTER = 500, 510, 514
STREAM_MODE = 0x0200
"""Value of the mode register that starts the stream. Source: manual."""
MOST_REGISTERS = 125
"""Maximum number of registers in one read. Standard: Modbus."""


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
    """Return the Modbus CRC-16 of the bytes."""
    crc, table = 0xFFFF, _TABLE
    for byte in data:
        crc = crc >> 8 ^ table[(crc ^ byte) & 0xFF]
    return crc


def with_crc(data: bytes) -> bytes:
    """Append the CRC to the bytes, low byte first."""
    return data + crc16(data).to_bytes(2, "little")


def crc_fits(frame: bytes) -> bool:
    """Return whether a frame ends with the correct CRC."""
    return len(frame) > 2 and crc16(frame[:-2]) == int.from_bytes(frame[-2:], "little")


# --- stream


def encode_message(counts: Sequence[int]) -> bytes:
    """Encode six counts as a message. Raises LocalProtocolError if a count does not fit."""
    return with_crc(HEADER + MESSAGE.pack_row(*counts)[len(HEADER) :])


def decode_message(data: bytes) -> tuple[int, ...]:
    """Decode six counts from a message. Raises RemoteProtocolError if the bytes are not a message."""
    if len(data) != MESSAGE_SIZE or not data.startswith(HEADER):
        raise RemoteProtocolError("a stream message has 16 bytes and starts with 20 4E")
    if not crc_fits(data):
        raise RemoteProtocolError("the CRC of the stream message is wrong")
    return _unpack_message(data)


class StreamReader:
    """Extractor of messages from a byte stream that may start at any byte.

    The header may also occur inside the data, so the CRC decides where a message starts.
    """

    def __init__(self) -> None:
        self._waiting = b""
        self.noises = 0
        """Number of unbroken runs of bytes that belong to no message."""
        self.missed = 0
        """Number of messages lost in runs of invalid bytes, estimated from the length of each run, so that a
        duplicated byte does not count as a lost message.
        """
        self._in_noise = False
        self._noise_bytes = 0

    def feed(self, data: bytes) -> list[tuple[int, ...]]:
        """Process received bytes and return the complete messages, oldest first. At most 15 bytes are buffered."""
        waiting, at, messages = self._waiting + data, 0, []
        while len(waiting) - at >= MESSAGE_SIZE:
            message = waiting[at : at + MESSAGE_SIZE]
            if message.startswith(HEADER) and crc_fits(message):
                messages.append(_unpack_message(message))
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
        return messages


# --- Modbus RTU


class Request(NamedTuple):
    """A request to the sensor, without slave address and CRC."""

    function: int
    register: int
    values: tuple[int, ...] = ()
    """Registers that the request writes."""
    words: int = 0
    """Number of registers that the request reads or writes."""


def encode_read(register: int, count: int, function: int = READ) -> bytes:
    """Encode a request to read registers (function 3 or 4). Raises LocalProtocolError if a value does not fit."""
    return _pack(">BBHH", SLAVE, function, register, count)


def encode_write(register: int, *values: int) -> bytes:
    """Encode a request to write registers (function 16). Raises LocalProtocolError if a value does not fit."""
    count = len(values)
    return _pack(f">BBHHB{count}H", SLAVE, WRITE, register, count, 2 * count, *values)


def encode_words(function: int, values: Sequence[int]) -> bytes:
    """Encode the response to a read request. Raises LocalProtocolError if a register does not fit."""
    return _pack(f">BBB{len(values)}H", SLAVE, function, 2 * len(values), *values)


def encode_written(request: Request) -> bytes:
    """Encode the response to a write request."""
    if request.function == WRITE_ONE:
        return _pack(">BBHH", SLAVE, WRITE_ONE, request.register, request.values[0])
    return _pack(">BBHH", SLAVE, WRITE, request.register, request.words)


def encode_exception(function: int, code: int) -> bytes:
    """Encode an exception response."""
    return _pack(">BBB", SLAVE, function | EXCEPTION_BIT, code)


def request_size(head: bytes) -> int | None:
    """Return the size of the request that starts with these bytes; None if more bytes are needed to determine it."""
    if len(head) < 2:
        return None
    if head[1] == WRITE:
        return None if len(head) < 7 else 9 + head[6]
    return 8


def decode_request(frame: bytes) -> Request:
    """Decode a complete request with a valid CRC. Raises RemoteProtocolError if its lengths contradict each other."""
    function = frame[1]
    if function == WRITE:
        register, count, size = struct.unpack_from(">HHB", frame, 2)
        if size != 2 * count or len(frame) != 9 + size:
            raise RemoteProtocolError("the byte count of the write request is wrong")
        return Request(function, register, struct.unpack_from(f">{count}H", frame, 7), count)
    register, value = struct.unpack_from(">HH", frame, 2)
    if function == WRITE_ONE:
        return Request(function, register, (value,), 1)
    return Request(function, register, (), value)


def find_answer(data: bytes, function: int, size: int) -> tuple[bytes | int, int] | None:
    """Find the response to a request in received data. Return its payload, or the exception code, and the index
    after it.

    `size` is the size of the complete response in bytes. The result is None until the response is complete. Bytes
    before the response are skipped.
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
    """Decode the registers in the payload of the response to a read. Raises RemoteProtocolError if the byte count
    is wrong.
    """
    if not payload or payload[0] != len(payload) - 1 or payload[0] % 2:
        raise RemoteProtocolError("the byte count of the response is wrong")
    return struct.unpack(f">{payload[0] // 2}H", payload[1:])


def signed(word: int) -> int:
    """Convert a 16-bit register from two's complement to a signed number."""
    return word - 0x10000 if word & 0x8000 else word


def _pack(form: str, *values: int) -> bytes:
    try:
        return with_crc(struct.pack(form, *values))
    except struct.error as error:
        raise LocalProtocolError(f"Modbus: {error}") from error
