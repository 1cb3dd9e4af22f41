"""Frames of an ATI NETCANOEM board: six strain gages over CAN, of which the host computes the wrench.

The identifier is the board's base, seven bits, and an operation, four bits; high byte first everywhere. Question and
answer share identifiers, so that only the length of an answer tells it apart. Source: ATI manual 9610-05-1030, and a
client that drove a board (ati-netcanoem-cpp), read for facts only.
"""

import math
import struct
from collections.abc import Iterable, Iterator, Mapping, Sequence
from enum import IntEnum
from typing import NamedTuple

from protocol.can.dbc import CanMessage
from protocol.can.frame import CanFilter, CanFrame
from protocol.endpoint import LocalProtocolError, RemoteProtocolError
from protocol.fields import Field, Layout, bit_words
from protocol.marks import Mark

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
"""Meaning of each bit but the summary, 15. Source: manual."""
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


def _layout(name: str, *fields: Field) -> Layout:
    end = max(field.offset + struct.calcsize(f">{field.format}") for field in fields)
    return Layout(name, end, ">", fields)


def _gages(first: int, offset: int) -> Iterator[Field]:
    for place, gage in enumerate(range(first, GAGES, 2)):
        yield Field(f"sg{gage}", offset + 2 * place, "h", Mark.OBSERVED, "strain gage", unit="counts")


def _coefficients(first: int) -> Layout:
    fields = (
        Field(
            f"sg{first + place}", 4 * place, "f", Mark.OBSERVED, "coefficient of the matrix, counts for one"
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
        Field(f"c{place}", place, "B", Mark.OBSERVED, "character of the number, 0 behind its end")
        for place in range(8)
    ),
)
SLOT = _layout("the slot", Field("slot", 0, "B", Mark.OBSERVED, "of the calibration that is in use"))
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
"""Answers of the board, by operation. A question has at most two bytes of its own."""


def can_messages(identifiers: Iterable[int]) -> Sequence[CanMessage]:
    """Return the answers of the board whose frames have these identifiers, or of one with the default base.

    A DBC file cannot hold its questions: they have the same identifiers and at most a byte, so a strict decoder
    refuses them.
    """
    base = next((each >> 4 for each in identifiers), BASE)
    return [CanMessage(identifier(base, op), op.name, layout, True) for op, layout in LAYOUTS.items()]


_unpack_sample, _unpack_rest = SAMPLE.struct.unpack, SAMPLE_REST.struct.unpack
"""Samples come in every few milliseconds: by the tables' structs themselves."""


class SampleStart(NamedTuple):
    """First half of a sample."""

    status: int
    gages: tuple[int, int, int]
    """Gages 0, 2 and 4."""


def identifier(base: int, op: int) -> int:
    """Return the identifier of an operation."""
    return base << 4 | op


def heard(base: int) -> tuple[CanFilter, ...]:
    """Filter for the frames of one board, both ways."""
    return (CanFilter(base << 4, 0x7F0),)


def question(base: int, op: Op, *data: int) -> CanFrame:
    """Return a question as a frame. Raises LocalProtocolError for a value that is not a byte."""
    try:
        return CanFrame(identifier(base, op), bytes(data))
    except ValueError as error:
        raise LocalProtocolError(f"{op.name}: {error}") from error


def encode_sample(base: int, status: int, gages: Sequence[int]) -> tuple[CanFrame, CanFrame]:
    """Both frames of a sample. Raises LocalProtocolError for values that do not fit."""
    return (
        CanFrame(identifier(base, Op.SAMPLE), SAMPLE.pack_row(status, *gages[0::2])),
        CanFrame(identifier(base, Op.SAMPLE_REST), SAMPLE_REST.pack_row(*gages[1::2])),
    )


def decode_sample(data: bytes) -> SampleStart:
    """First half of a sample. Raises RemoteProtocolError for another length."""
    if len(data) != 8:
        raise RemoteProtocolError(f"{SAMPLE.name} has 8 bytes, got {len(data)}")
    status, a, b, c = _unpack_sample(data)
    return SampleStart(status, (a, b, c))


def decode_sample_rest(data: bytes) -> tuple[int, int, int]:
    """Gages 1, 3 and 5. Raises RemoteProtocolError for another length."""
    if len(data) != 6:
        raise RemoteProtocolError(f"{SAMPLE_REST.name} has 6 bytes, got {len(data)}")
    a, b, c = _unpack_rest(data)
    return a, b, c


def encode_row(base: int, row: Sequence[float]) -> tuple[CanFrame, ...]:
    """Encode a row of the matrix as three frames."""
    return tuple(
        CanFrame(identifier(base, op), LAYOUTS[op].pack_row(*row[2 * k : 2 * k + 2]))
        for k, op in enumerate((Op.ROW, Op.ROW_MIDDLE, Op.ROW_END))
    )


def decode_pair(data: bytes) -> tuple[float, float]:
    """Two coefficients of a row. Raises RemoteProtocolError for another length, and for what is not a number."""
    a, b = ROW.unpack_exact(data)
    if not (math.isfinite(a) and math.isfinite(b)):
        raise RemoteProtocolError("the matrix holds what is not a number")
    return a, b


def encode_counts(base: int, per_force: int, per_torque: int) -> CanFrame:
    """Encode the counts for a unit of force and of torque."""
    return CanFrame(identifier(base, Op.COUNTS), COUNTS.pack_row(per_force, per_torque))


def decode_counts(data: bytes) -> tuple[int, int]:
    """Decode the counts for a unit of force and of torque. Raises RemoteProtocolError for another length, and for 0."""
    per_force, per_torque = COUNTS.unpack_exact(data)
    if not (per_force and per_torque):
        raise RemoteProtocolError("the board tells 0 counts for a unit")
    return per_force, per_torque


def decode_units(data: bytes) -> tuple[float, float]:
    """N and N·m for one unit. Raises RemoteProtocolError for another length, and for a unit that is not known."""
    codes = UNITS.unpack_exact(data)
    force, torque = FORCE_UNITS.get(codes[0]), TORQUE_UNITS.get(codes[1])
    if force is None or torque is None:
        raise RemoteProtocolError(f"the board tells the units {codes[0]} and {codes[1]}, which are not known")
    return force, torque


def decode_firmware(data: bytes) -> tuple[int, int, int]:
    """Major, minor and build. Raises RemoteProtocolError for another length."""
    major, minor, build = FIRMWARE.unpack_exact(data)
    return major, minor, build


def status_words(status: int) -> str:
    """Describe the bits of a status, without the summary where another bit says more."""
    return bit_words(status, STATUS_BITS)
