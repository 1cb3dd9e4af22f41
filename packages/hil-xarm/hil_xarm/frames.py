"""Frames of the command channel, TCP port 502: a request of a client, and the reply with the same transaction.

Integers are big-endian, floating-point numbers little-endian. Source: xArm-Developer/xArm-Python-SDK d911319c,
`xarm/core/wrapper/uxbus_cmd_tcp.py` and `xarm/core/config/x_config.py`.
"""

import struct
from collections.abc import Iterator
from enum import IntEnum, IntFlag
from typing import NamedTuple

from protocol.endpoint import RemoteProtocolError

MODBUS, HEARTBEAT, PRIVATE, KEPT_ALIVE = 0, 1, 2, 3
"""Protocols of a frame: standard Modbus, a heartbeat without reply, commands, and commands of a client that keeps the
connection alive (firmware 1.8.6 and later).
"""
PROTOCOLS = (MODBUS, HEARTBEAT, PRIVATE, KEPT_ALIVE)
TRANSACTIONS = 65535
"""Largest number of a transaction; 1 follows it."""
ALL_JOINTS = 8
"""Number of a joint that stands for all."""
_HEADER = struct.Struct(">HHH")
_LENGTH_MAX = 1024
"""Largest number of bytes after the header. Source: the client's buffer."""


class Function(IntEnum):
    """Number of a command."""

    VERSION = 1
    SERIALS = 2
    SYSTEM = 10
    ENABLE = 11
    SET_STATE = 12
    STATE = 13
    QUEUE = 14
    ERROR = 15
    CLEAR_ERROR = 16
    CLEAR_WARNING = 17
    BRAKE = 18
    SET_MODE = 19
    MOVE_LINE = 21
    MOVE_JOINTS = 23
    MOVE_HOME = 25
    SERVO_JOINTS = 29
    SERVO_POSE = 30
    TCP_OFFSET = 35
    LOAD = 36
    COLLISION = 37
    TEACH = 38
    SAVE = 40
    POSE = 41
    JOINTS = 42
    INVERSE = 43
    FORWARD = 44
    TORQUES = 55
    MOVE_RELATIVE = 83
    POSE_AXIS_ANGLE = 91
    FORCE_OLD = 150
    FORCE = 200
    FORCE_ENABLE = 201
    SET_FORCE_MODE = 202
    FORCE_MODE = 203
    FORCE_LOAD = 205
    FORCE_ZERO = 206
    FORCE_CONFIG = 212
    SET_FEEDBACK = 254

    @property
    def label(self) -> str:
        """Name in messages."""
        return self.name.lower().replace("_", " ")


class Bit(IntFlag):
    """Bits of the state byte of a reply."""

    INVALID = 0x08
    NOT_READY = 0x10
    WARNING = 0x20
    ERROR = 0x40


class State(IntEnum):
    """Reported state of the arm. `SET_STATE` sets 0 to move, 3 to pause, 4 and 6 to stop."""

    MOVE = 0
    MOVING = 1
    ASLEEP = 2
    PAUSED = 3
    STOPPED = 4
    MODE_CHANGED = 5
    SLOW_STOP = 6


class Mode(IntEnum):
    """Mode of motion."""

    POSITION = 0
    SERVO = 1
    TEACH = 2


class Request(NamedTuple):
    """Command of a client."""

    transaction: int
    protocol: int
    function: int
    data: bytes = b""

    def encode(self) -> bytes:
        """Return the frame."""
        return _frame(self.transaction, self.protocol, bytes((self.function,)) + self.data)


class Reply(NamedTuple):
    """Answer of the control box."""

    transaction: int
    protocol: int
    function: int
    state: int
    """Bits of `Bit`."""
    data: bytes = b""

    def encode(self) -> bytes:
        """Return the frame."""
        return _frame(self.transaction, self.protocol, bytes((self.function, self.state)) + self.data)


class Frame(NamedTuple):
    """Frame of either direction."""

    transaction: int
    protocol: int
    body: bytes

    def as_request(self) -> Request:
        """Return the frame as a request."""
        return Request(self.transaction, self.protocol, self.body[0], self.body[1:])

    def as_reply(self) -> Reply:
        """Return the frame as a reply. Raises RemoteProtocolError if it has no state."""
        if len(self.body) < 2:
            raise RemoteProtocolError(f"a reply of {len(self.body)} byte without a state")
        return Reply(self.transaction, self.protocol, self.body[0], self.body[1], self.body[2:])


class FrameReader:
    """Splitter of a byte stream into frames."""

    def __init__(self) -> None:
        self._buffer = b""

    def feed(self, data: bytes) -> Iterator[Frame]:
        """Yield each complete frame. Raises RemoteProtocolError for bytes that are no frame; the bytes received so far
        are then dropped, because nothing marks the begin of the next frame.
        """
        self._buffer += data
        while len(self._buffer) >= _HEADER.size:
            transaction, protocol, length = _HEADER.unpack_from(self._buffer)
            if protocol not in PROTOCOLS or not 1 <= length <= _LENGTH_MAX:
                self._buffer = b""
                raise RemoteProtocolError(f"a frame of protocol {protocol} with the length {length}")
            end = _HEADER.size + length
            if len(self._buffer) < end:
                return
            body, self._buffer = self._buffer[_HEADER.size : end], self._buffer[end:]
            yield Frame(transaction, protocol, body)


def frames_in(data: bytes) -> list[bytes]:
    """Split the bytes of one direction into frames; a rest that is no frame is one piece."""
    pieces = []
    while len(data) >= _HEADER.size:
        end = _HEADER.size + int.from_bytes(data[4:6], "big")
        pieces.append(data[:end])
        data = data[end:]
    return [*pieces, data] if data else pieces


def pack_floats(*values: float) -> bytes:
    """Return numbers as they are in frames and reports."""
    return struct.pack(f"<{len(values)}f", *values)


def unpack_floats(data: bytes, count: int) -> tuple[float, ...]:
    """Return the first numbers of some data. Raises RemoteProtocolError if the data are too short."""
    if len(data) < 4 * count:
        raise RemoteProtocolError(f"{len(data)} bytes in place of {count} numbers")
    return struct.unpack_from(f"<{count}f", data)


def next_transaction(number: int) -> int:
    """Return the number of the next transaction."""
    return number % TRANSACTIONS + 1


def _frame(transaction: int, protocol: int, body: bytes) -> bytes:
    return _HEADER.pack(transaction, protocol, len(body)) + body
