"""Datagrams of an ATI Net F/T's raw data transfer (RDT): requests of 8 bytes, records of 36, high byte first.

Sources: ATI manuals 9620-05-NET FT, 9610-05-Ethernet Axia-09 and 9620-05-C-Ethernet Axia-02; the clients netft-cpp
and NetFT, read for facts only.
"""

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from functools import lru_cache
from typing import NamedTuple

from protocol.endpoint import LocalProtocolError, RemoteProtocolError
from protocol.fields import Field, Layout, bit_words
from protocol.marks import Mark
from protocol.wrench import AXES

HEADER = 0x1234
"""Source: manual."""
INTERNAL_RATE_HZ = 7000
"""Internal samples a second of a Net Box. Source: manual."""
AXIA_RATES_HZ = (488, 976, 1953, 3906, 7812)
"""Internal samples a second of an Axia, by its setting `setadcrate`. Source: manual; net_ft_driver's Axia interface."""
WRAP = 1 << 32
"""Both sequence numbers begin again at 0 behind this many. Source: manual of the Axia."""
BUFFER_LIMIT = 40
"""Most records in one datagram. Source: clients."""


class Command(IntEnum):
    """Commands of a request. Source: manual."""

    STOP = 0x0000
    START = 0x0002
    START_BUFFERED = 0x0003
    START_SYNCHRONISED = 0x0004
    RESET_LATCH = 0x0041
    BIAS = 0x0042


EXTENDED_BIT = 0x8000
"""In the command of an extended request."""

SUMMARY = 1 << 31
"""Status bit: some error."""
SATURATED = 1 << 17
"""Status bit: a gage is at the end of its range, or the converter fails; the counts are no longer valid."""
MONITOR = 1 << 16
"""Status bit: a threshold was passed; latched."""
OUT_OF_RANGE = 1 << 30
"""Status bit of an Axia: the load is more than its ratings bear together."""
BUSY = 1 << 3
"""Status bit of an Axia: it stores or changes a setting. No error, though the summary bit may come with it."""
SIMULATED = 1 << 28
"""Status bit of an Axia: a simulated error. No error."""
_NETBOX_BITS = {
    30: "CPU or memory fault",
    29: "digital board",
    28: "analog board",
    27: "serial link to the transducer",
    26: "program memory",
    25: "halted by configuration errors",
    24: "settings damaged",
    23: "configuration does not fit the calibration",
    22: "network",
    21: "CAN",
    20: "RDT",
    19: "EtherNet/IP",
    18: "DeviceNet",
    17: "saturation or converter",
    16: "threshold passed",
    14: "watchdog time-out",
    13: "stack",
    12: "serial EEPROM",
    11: "serial flash",
    10: "watchdog of the analog board",
    9: "gage current too high",
    8: "gage current too low",
    7: "analog ground out of range",
    6: "analog supply too high",
    5: "analog supply too low",
    4: "no data from the transducer",
    3: "reference voltage",
    2: "temperature",
    1: "HTTP",
}
"""Meaning of each bit but the summary, of a Net Box. Source: netft-cpp."""
_AXIA_BITS = {
    30: "force or torque out of range",
    29: "calibration checksum",
    28: "simulated error",
    27: "gage out of range",
    16: "threshold passed",
    7: "calibration not accessible",
    5: "other error",
    3: "busy",
    2: "broken gage",
    1: "supply voltage out of range",
    0: "temperature out of range",
}
"""The same of an Axia. Source: manuals 9610-05-Ethernet Axia-09, tables 4.7 and 4.9, and 9620-05-C-02, table 5.7."""


@dataclass(frozen=True, slots=True)
class Family:
    """A family of sensors that speak RDT: its samples, and its status word."""

    rate_hz: int
    """Most internal samples a second."""
    bits: Mapping[int, str]
    """Meaning of each bit but the summary."""
    harmless: int
    """Bits that are no errors."""
    summarised: int
    """Those of them that the summary bit may come with."""
    saturated: int
    """Bits of a load that is too large; the counts are no longer valid."""
    overloaded: int
    """Status at the end of a gage."""
    unplugged: int
    """Status without a transducer. Mark: assumed."""

    def words(self, status: int) -> str:
        """Describe the bits of a status, without the summary; empty for none."""
        return bit_words(status, self.bits)

    def is_warning(self, status: int) -> bool:
        """Whether the record may be used all the same: the status has bits that are no errors, and no others."""
        rest = status & ~SUMMARY if status & self.summarised else status
        return bool(rest) and not rest & ~self.harmless


NETBOX = Family(
    INTERNAL_RATE_HZ,
    _NETBOX_BITS,
    MONITOR,
    MONITOR,
    SATURATED,
    SATURATED | SUMMARY,
    SUMMARY | 1 << 27 | 1 << 4,
)
AXIA = Family(
    AXIA_RATES_HZ[-1],
    _AXIA_BITS,
    MONITOR | BUSY | SIMULATED,
    MONITOR | BUSY,
    OUT_OF_RANGE | 1 << 27,
    SUMMARY | 1 << 27,
    SUMMARY | 1 << 2,
)
FAMILIES: Mapping[str, Family] = {"netbox": NETBOX, "axia": AXIA}
"""By the name of the setting `family`."""


_REQUEST = (
    Field("header", 0, "H", Mark.OBSERVED, "1234"),
    Field("command", 2, "H", Mark.OBSERVED, "high bit: names where the records shall go"),
    Field("count", 4, "I", Mark.OBSERVED, "records to send; 0: until a stop"),
)
REQUEST = Layout("a request", 8, ">", _REQUEST)
EXTENDED = Layout("an extended request", 14, ">", _REQUEST)
"""A request that names the address and the port to which the records shall go, in its last six bytes."""
RECORD = Layout(
    "a record",
    36,
    ">",
    (
        Field("rdt_sequence", 0, "I", Mark.OBSERVED, "place in this stream"),
        Field("ft_sequence", 4, "I", Mark.OBSERVED, "number of the internal sample"),
        Field("status", 8, "I", Mark.OBSERVED, bits=_NETBOX_BITS),
        *(Field(axis, 12 + 4 * place, "i", Mark.OBSERVED, unit="counts") for place, axis in enumerate(AXES)),
    ),
)
"""Its counts, divided by the page's counts per unit, are forces and torques."""
RECORD_SIZE = RECORD.size


class Request(NamedTuple):
    """One request."""

    command: int
    records: int = 0
    """Records to send; 0: until a stop."""
    extended: bool = False
    """Whether it names where the records shall go."""


class Record(NamedTuple):
    """One record."""

    rdt_sequence: int
    """Its place in this stream, 1 for the first."""
    ft_sequence: int
    """Number of the internal sample, 0 at power-up."""
    status: int
    counts: tuple[int, int, int, int, int, int]
    """fx fy fz tx ty tz; divided by the page's counts per unit they are forces and torques."""


def encode_request(command: Command, count: int = 0) -> bytes:
    """Encode a request. Raises LocalProtocolError for a count that does not fit."""
    return REQUEST.pack_row(HEADER, command, count)


def decode_request(data: bytes) -> Request:
    """Decode a request. Raises RemoteProtocolError for another length or header."""
    extended = len(data) == EXTENDED.size
    if not extended and len(data) != REQUEST.size:
        raise RemoteProtocolError(f"a request has {REQUEST.size} or {EXTENDED.size} bytes, got {len(data)}")
    header, command, count = (EXTENDED if extended else REQUEST).unpack_row(data)
    if header != HEADER:
        raise RemoteProtocolError(f"a request begins with {HEADER:04X}, got {header:04X}")
    if extended != bool(command & EXTENDED_BIT):
        raise RemoteProtocolError(f"command {command:04X} does not fit a request of {len(data)} bytes")
    return Request(command & ~EXTENDED_BIT, count, extended)


def encode_record(record: Record) -> bytes:
    """Encode a record. Raises LocalProtocolError for values that do not fit."""
    try:
        return pack_record(record[0], record[1], record[2], *record[3])
    except struct.error as error:
        raise LocalProtocolError(f"{RECORD.name}: {error}") from error


def decode_record(data: bytes) -> Record:
    """Decode a record. Raises RemoteProtocolError for another length."""
    if len(data) != RECORD_SIZE:
        raise RemoteProtocolError(f"{RECORD.name} has {RECORD_SIZE} bytes, got {len(data)}")
    rdt, ft, status, fx, fy, fz, tx, ty, tz = unpack_record(data)
    return Record(rdt, ft, status, (fx, fy, fz, tx, ty, tz))


pack_record, unpack_record = RECORD.struct.pack, RECORD.struct.unpack
"""Records come 7000 times a second: by the table's struct itself, and by names of this module."""


@lru_cache(maxsize=64)
def output_step(rate_hz: float, internal_rate_hz: float = INTERNAL_RATE_HZ) -> int:
    """Return the number of internal samples between records at a requested rate, Hz. Mark: assumed, rounded so that
    the rate is never lower.
    """
    return max(1, int(internal_rate_hz / rate_hz + 1e-6))  # a millionth keeps rounding from one step less
