"""Messages of a SCHUNK FTS with IFB-EN: commands and answers over TCP, packets with measurements over UDP.

All numbers are little-endian. Source of all facts, unless noted otherwise: the maker's library, its tests and its
stand-in, SCHUNK-SE-Co-KG/schunk_force_torque_sensor b0e43595, consulted for facts only.

| bytes | message over TCP | packet over UDP |
|---|---|---|
| 0, 1 | `FF FF` | `FF FF` |
| 2, 3 | counter of the sender | counter, which wraps |
| 4, 5 | length of the payload | 29 |
| 6 … | command and its values | second counter (1), status (4), fx fy fz in N and mx my mz in N·m (6 × 4) |
"""

import math
import struct
from enum import IntEnum
from typing import NamedTuple

from protocol.endpoint import LocalProtocolError, RemoteProtocolError
from protocol.fields import Field, Layout, describe_bits
from protocol.geometry import Wrench
from protocol.marks import Mark
from protocol.wrench import AXES

COMMAND_PORT = 82
"""TCP port of the sensor."""
DATA_PORT = 54843
"""UDP port of the computer to which the sensor sends. The sensor's firmware cannot change it."""
RATE_HZ = 1000
"""Packets per second. Source: the maker's README."""
PERIOD_S = 1.0 / RATE_HZ
COUNTERS = 1 << 16
"""Number of values of the counters in both headers."""
PACKET_IDS = 1 << 8
"""Number of values of a packet's second counter."""
FILTERS = (1, 2, 4, 8, 16)
"""Number of samples in the running mean, by the number of the filter."""
TOOLS = 4
"""Number of tool settings."""
PAYLOAD_MAX = 1018
"""Maximum length of a payload, bytes. Derived: the maker's library reads at most 1024 bytes at a time."""

_SYNC = b"\xff\xff"
_HEADER = struct.Struct("<2sHH")
_PARAMETER = struct.Struct("<HB")


class Command(IntEnum):
    """First byte of a payload. Two known commands, 10 and 11, have an unknown meaning."""

    UNKNOWN_10 = 0x10
    UNKNOWN_11 = 0x11
    TARE = 0x12
    UNDO_TARE = 0x13
    RESET = 0x20
    SELECT_TOOL = 0x30
    SELECT_FILTER = 0x31
    START = 0x40
    STOP = 0x41
    READ = 0xF0
    WRITE = 0xF1

    @property
    def label(self) -> str:
        """Name for display."""
        return self.name.lower().replace("_", " ")


class ErrorCode(IntEnum):
    """Second byte of an answer. Further values are unknown."""

    NONE = 0
    UNKNOWN_COMMAND = 1
    OUT_OF_RANGE = 3


def error_words(code: int) -> str:
    """Describe an error code."""
    known = [error.name.lower().replace("_", " ") for error in ErrorCode if error == code]
    return f"error {code:02X}" + "".join(f" ({name})" for name in known)


class Parameter(NamedTuple):
    """Number of a value in the sensor."""

    main: int
    """The maker's index."""
    sub: int = 0
    """The maker's subindex."""


PRODUCT_NAME = Parameter(0x0001, 0)
"""ASCII text."""
PRODUCT_NUMBER = Parameter(0x0001, 3)
UNITS = Parameter(0x0050, 0)
"""Units of the measurements; 0 is the default. A write needs rights that the library does not request."""
FIRMWARE = Parameter(0x1002, 1)
"""UTF-8 text."""


class Message(NamedTuple):
    """Message over TCP."""

    counter: int
    payload: bytes


class Answer(NamedTuple):
    """Payload of an answer."""

    command: int
    error: int
    value: bytes = b""
    """Value of a parameter that was read; otherwise empty."""


READY, INVALID, TEMPERATURE, HARDWARE, MECHANICAL, USER = (1 << bit for bit in range(6))
"""Status bits: ready; invalid process data; temperature out of range; hardware fault; load beyond the mechanical
range; load beyond the limits of the tool setting.
"""
STATUS_BITS = {
    1: "process data invalid",
    2: "temperature out of range",
    3: "hardware fault",
    4: "mechanical overload",
    5: "beyond the limits of the tool setting",
}
"""Meaning of each status bit except the first."""
PACKET = Layout(
    "a packet",
    35,
    "<",
    (
        Field("sync", 0, "H", Mark.DERIVED, "FFFF"),
        Field("counter", 2, "H", Mark.DERIVED, "sequence number"),
        Field("length", 4, "H", Mark.DERIVED, "of the payload, 29"),
        Field("packet_id", 6, "B", Mark.DERIVED, "second sequence number"),
        Field("status", 7, "I", Mark.DERIVED, bits={0: "ready", **STATUS_BITS}),
        *(
            Field(axis, 11 + 4 * place, "f", Mark.DERIVED, unit="N" if place < 3 else "N·m")
            for place, axis in enumerate(AXES)
        ),
    ),
)
PACKET_LENGTH = PACKET.size - _HEADER.size
"""Length in the header of a packet."""


class Packet(NamedTuple):
    """Measurement of one sample."""

    counter: int
    packet_id: int
    status: int
    wrench: Wrench
    """fx fy fz in N, mx my mz in N·m."""


def status_words(status: int) -> str:
    """Describe a status; empty if the sensor is ready and reports nothing else."""
    faults = describe_bits(status & ~READY, STATUS_BITS)
    return faults if status & READY else ", ".join(filter(None, ("not ready", faults)))


def encode_packet(packet: Packet) -> bytes:
    """Encode a packet. Raises LocalProtocolError if a value does not fit."""
    counter, packet_id, status, wrench = packet
    return PACKET.pack_row(0xFFFF, counter, PACKET_LENGTH, packet_id, status, *wrench)


def decode_packet(data: bytes) -> Packet:
    """Decode a packet. Raises RemoteProtocolError if its length, its header or a value is wrong."""
    sync, counter, length, packet_id, status, fx, fy, fz, mx, my, mz = PACKET.unpack_exact(data)
    if sync != 0xFFFF or length != PACKET_LENGTH:
        raise RemoteProtocolError(
            f"a packet begins with FFFF and has length {PACKET_LENGTH}, got {sync:04X}, {length}"
        )
    wrench = fx, fy, fz, mx, my, mz
    if not all(map(math.isfinite, wrench)):
        raise RemoteProtocolError("a packet contains a value that is not a number")
    return Packet(counter, packet_id, status, wrench)


def encode_message(counter: int, payload: bytes) -> bytes:
    """Encode a message. Raises LocalProtocolError if the payload is too long."""
    if len(payload) > PAYLOAD_MAX:
        raise LocalProtocolError(f"a payload has at most {PAYLOAD_MAX} bytes, got {len(payload)}")
    return _HEADER.pack(_SYNC, counter % COUNTERS, len(payload)) + payload


def encode_command(command: Command, value: int | None = None) -> bytes:
    """Return the payload of a command, with its value if it has one."""
    return bytes((command,) if value is None else (command, value))


def encode_read(parameter: Parameter) -> bytes:
    """Return the payload that reads a parameter."""
    return bytes((Command.READ,)) + _PARAMETER.pack(*parameter)


def encode_answer(answer: Answer, parameter: Parameter | None = None) -> bytes:
    """Return the payload of an answer. `parameter` is given for the commands that read and write."""
    about = b"" if parameter is None else _PARAMETER.pack(*parameter)
    return bytes((answer.command, answer.error)) + about + answer.value


def decode_parameter(data: bytes) -> tuple[Parameter, bytes]:
    """Decode the parameter at the start of the data, and return it with the data after it. Raises
    RemoteProtocolError if the data are too short.
    """
    if len(data) < _PARAMETER.size:
        raise RemoteProtocolError(f"a parameter needs {_PARAMETER.size} bytes, got {len(data)}")
    return Parameter(*_PARAMETER.unpack_from(data)), data[_PARAMETER.size :]


def decode_answer(payload: bytes) -> Answer:
    """Decode an answer. Raises RemoteProtocolError if it is too short."""
    if len(payload) < 2:
        raise RemoteProtocolError(f"an answer has at least 2 bytes, got {len(payload)}")
    if payload[0] != Command.READ or payload[1]:
        return Answer(payload[0], payload[1])
    return Answer(payload[0], payload[1], decode_parameter(payload[2:])[1])


class MessageReader:
    """Decoder of messages from arbitrarily fragmented bytes."""

    def __init__(self) -> None:
        self._pending = b""
        self._in_noise = False
        self.noises = 0
        """Number of contiguous byte sequences that belong to no message."""

    def feed(self, data: bytes) -> list[Message]:
        """Process received bytes and return the complete messages. Less than one message is kept."""
        pending, at, messages = self._pending + data, 0, []
        while len(pending) - at >= _HEADER.size:
            sync, counter, length = _HEADER.unpack_from(pending, at)
            if sync != _SYNC or length > PAYLOAD_MAX:
                self.noises += not self._in_noise
                self._in_noise = True
                following = pending.find(_SYNC[:1], at + 1)
                at = len(pending) if following < 0 else following
                continue
            end = at + _HEADER.size + length
            if end > len(pending):
                break
            messages.append(Message(counter, pending[at + _HEADER.size : end]))
            self._in_noise = False
            at = end
        self._pending = pending[at:]
        return messages
