"""Frames of an ATI NETCANOEM board: six strain gages over CAN, from which the host computes the wrench.

The identifier combines the board's base address (seven bits) and an operation (four bits). All numbers are
big-endian. Request and response share identifiers; only the length identifies a response. Source: ATI manual
9610-05-1030, and a client that drove a board (ati-netcanoem-cpp), consulted for facts only.
"""

import math
import struct
from collections.abc import Iterable, Iterator, Mapping, Sequence
from enum import IntEnum
from typing import NamedTuple

from protocol.can.dbc import CanMessage
from protocol.can.frame import CanFilter, CanFrame
from protocol.endpoint import LocalProtocolError, RemoteProtocolError
from protocol.fields import Field, Layout, describe_bits
from protocol.marks import Mark

BITRATE = 250_000
"""Bit rate for the default switch setting, bit/s. Source: manual."""
BASE = 0x20
"""Base address for the default switch setting. Source: manual."""
GAGES = 6
GAGE_LOW, GAGE_HIGH = -32768, 32767
"""Lowest and highest gage reading, at which a gage is saturated. Source: manual."""
SLOTS = 16


class Op(IntEnum):
    """Operation code of a frame. Codes 1, 3 and 4 occur only in responses."""

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
}
"""Meaning of each status bit except the summary bit, 15. Source: manual."""
WATCHDOG = 1
CRITICAL = 0b0001_1000_1111_1110
"""Status bits that make every sample invalid: 1 … 7, 11 and 12. Source: manual."""

FORCE_UNITS = {1: 4.4482216152605, 2: 1.0, 3: 4448.2216152605, 4: 1000.0, 5: 9.80665, 6: 9.80665e-3}
"""Size of each force unit in N, by the board's unit code. Source: manual."""
TORQUE_UNITS = {
    1: 0.1129848290276167,
    2: 1.3558179483314004,
    3: 1.0,
    4: 1e-3,
    5: 0.0980665,
    6: 1000.0,
}
"""Size of each torque unit in N·m, by the board's unit code. Source: manual."""


def _layout(name: str, *fields: Field) -> Layout:
    end = max(field.offset + struct.calcsize(f">{field.format}") for field in fields)
    return Layout(name, end, ">", fields)


def _gages(first: int, offset: int) -> Iterator[Field]:
    for place, gage in enumerate(range(first, GAGES, 2)):
        yield Field(f"sg{gage}", offset + 2 * place, "h", Mark.OBSERVED, "strain gage", unit="counts")


def _coefficients(first: int) -> Layout:
    fields = (
        Field(
            f"sg{first + place}", 4 * place, "f", Mark.OBSERVED, "coefficient of the matrix, counts per unit"
        )
        for place in range(2)
    )
    return _layout("a part of the matrix", *fields)


STATUS = Field("status", 0, "H", Mark.OBSERVED, "0 without an error", bits=STATUS_BITS)
SAMPLE = _layout("the first half of a sample", STATUS, *_gages(0, 2))
SAMPLE_REST = _layout("the second half of a sample", *_gages(1, 0))
ROW, ROW_MIDDLE, ROW_END = _coefficients(0), _coefficients(2), _coefficients(4)
SERIAL = _layout(
    "the serial number",
    *(
        Field(f"c{place}", place, "B", Mark.OBSERVED, "character of the number, 0 after its end")
        for place in range(8)
    ),
)
SLOT = _layout("the slot", Field("slot", 0, "B", Mark.OBSERVED, "of the active calibration"))
COUNTS = _layout(
    "the counts",
    Field("per force", 0, "I", Mark.OBSERVED, "of the matrix for one unit of force", unit="counts"),
    Field("per torque", 4, "I", Mark.OBSERVED, "of the matrix for one unit of torque", unit="counts"),
)
UNITS = _layout(
    "the units",
    Field("force", 0, "B", Mark.OBSERVED, "code of the unit"),
    Field("torque", 1, "B", Mark.OBSERVED, "code of the unit"),
)
FIRMWARE = _layout(
    "the firmware",
    Field("major", 0, "B", Mark.OBSERVED),
    Field("minor", 1, "B", Mark.OBSERVED),
    Field("build", 2, "H", Mark.OBSERVED),
)
LAYOUTS: Mapping[Op, Layout] = {
    Op.SAMPLE: SAMPLE,
    Op.SAMPLE_REST: SAMPLE_REST,
    Op.ROW: ROW,
    Op.ROW_MIDDLE: ROW_MIDDLE,
    Op.ROW_END: ROW_END,
    Op.SERIAL: SERIAL,
    Op.SLOT: SLOT,
    Op.COUNTS: COUNTS,
    Op.UNITS: UNITS,
    Op.FIRMWARE: FIRMWARE,
}
"""Layout of the board's response to each operation. A request has at most two data bytes."""


def can_messages(identifiers: Iterable[int]) -> Sequence[CanMessage]:
    """Return the responses of the board that uses these identifiers; without identifiers, of a board with the
    default base.

    A DBC file cannot hold the requests: they have the same identifiers and at most one byte, so a strict decoder
    rejects them.
    """
    base = next((each >> 4 for each in identifiers), BASE)
    return [CanMessage(identifier(base, op), op.name, layout, True) for op, layout in LAYOUTS.items()]


_unpack_sample, _unpack_rest = SAMPLE.struct.unpack, SAMPLE_REST.struct.unpack
"""Functions that unpack a sample: the layouts' own structs, for speed, because samples arrive every few
milliseconds.
"""


class SampleStart(NamedTuple):
    """First half of a sample."""

    status: int
    gages: tuple[int, int, int]
    """Readings of gages 0, 2 and 4."""


def identifier(base: int, op: int) -> int:
    """Return the CAN identifier of an operation."""
    return base << 4 | op


def heard(base: int) -> tuple[CanFilter, ...]:
    """Return the filter that passes all frames from and to one board."""
    return (CanFilter(base << 4, 0x7F0),)


def question(base: int, op: Op, *data: int) -> CanFrame:
    """Encode a request. Raises LocalProtocolError if a value is not a byte."""
    try:
        return CanFrame(identifier(base, op), bytes(data))
    except ValueError as error:
        raise LocalProtocolError(f"{op.name}: {error}") from error


def encode_sample(base: int, status: int, gages: Sequence[int]) -> tuple[CanFrame, CanFrame]:
    """Encode both frames of a sample. Raises LocalProtocolError if a value does not fit."""
    return (
        CanFrame(identifier(base, Op.SAMPLE), SAMPLE.pack_row(status, *gages[0::2])),
        CanFrame(identifier(base, Op.SAMPLE_REST), SAMPLE_REST.pack_row(*gages[1::2])),
    )


def decode_sample(data: bytes) -> SampleStart:
    """Decode the first half of a sample. Raises RemoteProtocolError if the length is wrong."""
    if len(data) != 8:
        raise RemoteProtocolError(f"{SAMPLE.name} has 8 bytes, got {len(data)}")
    status, a, b, c = _unpack_sample(data)
    return SampleStart(status, (a, b, c))


def decode_sample_rest(data: bytes) -> tuple[int, int, int]:
    """Decode gages 1, 3 and 5. Raises RemoteProtocolError if the length is wrong."""
    if len(data) != 6:
        raise RemoteProtocolError(f"{SAMPLE_REST.name} has 6 bytes, got {len(data)}")
    a, b, c = _unpack_rest(data)
    return a, b, c


def encode_row(base: int, row: Sequence[float]) -> tuple[CanFrame, ...]:
    """Encode one row of the calibration matrix as three frames."""
    return tuple(
        CanFrame(identifier(base, op), LAYOUTS[op].pack_row(*row[2 * k : 2 * k + 2]))
        for k, op in enumerate((Op.ROW, Op.ROW_MIDDLE, Op.ROW_END))
    )


def decode_pair(data: bytes) -> tuple[float, float]:
    """Decode two coefficients of a row. Raises RemoteProtocolError if the length is wrong or a value is NaN or
    infinite.
    """
    a, b = ROW.unpack_exact(data)
    if not (math.isfinite(a) and math.isfinite(b)):
        raise RemoteProtocolError("the matrix contains a value that is not a number")
    return a, b


def encode_counts(base: int, per_force: int, per_torque: int) -> CanFrame:
    """Encode the counts per unit of force and of torque."""
    return CanFrame(identifier(base, Op.COUNTS), COUNTS.pack_row(per_force, per_torque))


def decode_counts(data: bytes) -> tuple[int, int]:
    """Decode the counts per unit of force and of torque. Raises RemoteProtocolError if the length is wrong or a
    value is 0.
    """
    per_force, per_torque = COUNTS.unpack_exact(data)
    if not (per_force and per_torque):
        raise RemoteProtocolError("the board reports 0 counts per unit")
    return per_force, per_torque


def decode_units(data: bytes) -> tuple[float, float]:
    """Decode the units of force and torque to N and N·m per unit. Raises RemoteProtocolError if the length is wrong
    or a unit is unknown.
    """
    codes = UNITS.unpack_exact(data)
    force, torque = FORCE_UNITS.get(codes[0]), TORQUE_UNITS.get(codes[1])
    if force is None or torque is None:
        raise RemoteProtocolError(f"the board reports the units {codes[0]} and {codes[1]}, which are unknown")
    return force, torque


def decode_firmware(data: bytes) -> tuple[int, int, int]:
    """Decode major, minor and build number. Raises RemoteProtocolError if the length is wrong."""
    major, minor, build = FIRMWARE.unpack_exact(data)
    return major, minor, build


def describe_status_bits(status: int) -> str:
    """Describe the bits of a status. The summary bit is omitted if a more specific bit is set."""
    return describe_bits(status, STATUS_BITS)
