"""Frames of an ATI NETCANOEM board: six strain gages over CAN, of which the host computes the wrench.

The identifier is the board's base, seven bits, and an operation, four bits; high byte first everywhere. Question and
answer share identifiers, so that only the length of an answer tells it apart. Source: ATI manual 9610-05-1030, and a
client that drove a board (ati-netcanoem-cpp), read for facts only.
"""

import math
import struct
from collections.abc import Sequence
from enum import IntEnum
from typing import NamedTuple

from protocol.can.frame import CanFilter, CanFrame
from protocol.endpoint import LocalProtocolError, RemoteProtocolError

BITRATE = 250_000
"""With the default switch on. Source: manual."""
BASE = 0x20
"""Base identifier with the default switch on. Source: manual."""
GAGES = 6
GAGE_LOW, GAGE_HIGH = -32768, 32767
"""Ends of a gage: there it tells nothing. Source: manual."""
SLOTS = 16


class Op(IntEnum):
    """Operations. 1, 3 and 4 are those of answers alone."""

    SAMPLE = 0x0
    SAMPLE_REST = 0x1
    ROW = 0x2
    ROW_MIDDLE = 0x3
    ROW_END = 0x4
    SERIAL = 0x5
    SLOT = 0x6
    COUNTS = 0x7
    UNITS = 0x8
    DIAGNOSIS = 0x9
    RESET = 0xC
    SET_BASE = 0xD
    SET_RATE = 0xE
    FIRMWARE = 0xF


_SAMPLE, _SAMPLE_REST = struct.Struct(">H3h"), struct.Struct(">3h")
_PAIR = struct.Struct(">2f")
_COUNTS = struct.Struct(">2I")

ANY_ERROR = 1 << 15
STATUS_BITS = {
    0: "watchdog reset",
    1: "converter check too high",
    2: "converter check too low",
    3: "analog ground out of range",
    4: "supply too high",
    5: "supply too low",
    6: "bad calibration",
    7: "EEPROM failure",
    8: "stored configuration invalid, defaults in use",
    11: "temperature too high",
    12: "temperature too low",
    14: "CAN bus error",
    15: "any error",
}
"""Meaning of each bit. Source: manual."""
WATCHDOG = 1
CRITICAL = 0b0001_1000_1111_1110
"""Bits with which no sample can be trusted: 1 … 7, 11 and 12. Source: manual."""

FORCE_UNITS = {1: 4.4482216152605, 2: 1.0, 3: 4448.2216152605, 4: 1000.0, 5: 9.80665, 6: 9.80665e-3}
"""N for one, by the board's code. Source: manual."""
TORQUE_UNITS = {
    1: 0.1129848290276167,
    2: 1.3558179483314004,
    3: 1.0,
    4: 1e-3,
    5: 0.0980665,
    6: 1000.0,
}
"""N·m for one, by the board's code. Source: manual."""


class SampleStart(NamedTuple):
    """First half of a sample."""

    status: int
    gages: tuple[int, int, int]
    """Gages 0, 2 and 4."""


def identifier(base: int, op: int) -> int:
    """Identifier of an operation."""
    return base << 4 | op


def heard(base: int) -> tuple[CanFilter, ...]:
    """Filter for the frames of one board, both ways."""
    return (CanFilter(base << 4, 0x7F0),)


def question(base: int, op: Op, *data: int) -> CanFrame:
    """A question. Raises LocalProtocolError for a byte that is none."""
    try:
        return CanFrame(identifier(base, op), bytes(data))
    except ValueError as error:
        raise LocalProtocolError(f"{op.name}: {error}") from error


def encode_sample(base: int, status: int, gages: Sequence[int]) -> tuple[CanFrame, CanFrame]:
    """Both frames of a sample. Raises LocalProtocolError for values that do not fit."""
    try:
        return (
            CanFrame(identifier(base, Op.SAMPLE), _SAMPLE.pack(status, *gages[0::2])),
            CanFrame(identifier(base, Op.SAMPLE_REST), _SAMPLE_REST.pack(*gages[1::2])),
        )
    except struct.error as error:
        raise LocalProtocolError(f"sample: {error}") from error


def decode_sample(data: bytes) -> SampleStart:
    """First half of a sample. Raises RemoteProtocolError for another length."""
    _sized(data, _SAMPLE.size, "the first half of a sample")
    status, a, b, c = _SAMPLE.unpack(data)
    return SampleStart(status, (a, b, c))


def decode_sample_rest(data: bytes) -> tuple[int, int, int]:
    """Gages 1, 3 and 5. Raises RemoteProtocolError for another length."""
    _sized(data, _SAMPLE_REST.size, "the second half of a sample")
    a, b, c = _SAMPLE_REST.unpack(data)
    return a, b, c


def encode_row(base: int, row: Sequence[float]) -> tuple[CanFrame, ...]:
    """The three frames of a row of the matrix."""
    return tuple(
        CanFrame(identifier(base, op), _PAIR.pack(*row[2 * k : 2 * k + 2]))
        for k, op in enumerate((Op.ROW, Op.ROW_MIDDLE, Op.ROW_END))
    )


def decode_pair(data: bytes) -> tuple[float, float]:
    """Two coefficients of a row. Raises RemoteProtocolError for another length, and for what is no number."""
    _sized(data, _PAIR.size, "a part of the matrix")
    a, b = _PAIR.unpack(data)
    if not (math.isfinite(a) and math.isfinite(b)):
        raise RemoteProtocolError("the matrix holds what is no number")
    return a, b


def encode_counts(base: int, per_force: int, per_torque: int) -> CanFrame:
    """Counts for a unit of force and of torque."""
    return CanFrame(identifier(base, Op.COUNTS), _COUNTS.pack(per_force, per_torque))


def decode_counts(data: bytes) -> tuple[int, int]:
    """Raises RemoteProtocolError for another length, and for 0."""
    _sized(data, _COUNTS.size, "the counts")
    per_force, per_torque = _COUNTS.unpack(data)
    if not (per_force and per_torque):
        raise RemoteProtocolError("the board tells 0 counts for a unit")
    return per_force, per_torque


def decode_units(data: bytes) -> tuple[float, float]:
    """N and N·m for one unit. Raises RemoteProtocolError for another length, and for a unit that is not known."""
    _sized(data, 2, "the units")
    force, torque = FORCE_UNITS.get(data[0]), TORQUE_UNITS.get(data[1])
    if force is None or torque is None:
        raise RemoteProtocolError(f"the board tells the units {data[0]} and {data[1]}, which are not known")
    return force, torque


def decode_firmware(data: bytes) -> tuple[int, int, int]:
    """Major, minor and build. Raises RemoteProtocolError for another length."""
    _sized(data, 4, "the firmware")
    major, minor, build = struct.unpack(">BBH", data)
    return major, minor, build


def status_words(status: int) -> str:
    """The bits of a status in words, without the summary where another says more."""
    words = [text for bit, text in STATUS_BITS.items() if status >> bit & 1 and bit < 15]
    return ", ".join(words) or ("an error without a name" if status else "")


def _sized(data: bytes, size: int, what: str) -> None:
    if len(data) != size:
        raise RemoteProtocolError(f"{what} has {size} bytes, got {len(data)}")
