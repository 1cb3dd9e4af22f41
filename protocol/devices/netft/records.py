"""Datagrams of an ATI Net F/T's raw data transfer (RDT): requests of 8 bytes and records of 36 bytes, big-endian.

Sources: ATI manuals 9620-05-NET FT, 9610-05-Ethernet Axia-09 and 9620-05-C-Ethernet Axia-02; the clients netft-cpp
and NetFT, consulted for facts only.
"""

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from functools import lru_cache
from typing import NamedTuple

from protocol.endpoint import LocalProtocolError, RemoteProtocolError
from protocol.fields import Field, Layout, describe_bits
from protocol.marks import Mark
from protocol.wrench import AXES

HEADER = 0x1234
"""Number with which every request begins. Source: manual."""
INTERNAL_RATE_HZ = 7000
"""Number of internal samples per second of a Net Box. Source: manual."""
AXIA_RATES_HZ = (488, 976, 1953, 3906, 7812)
"""Numbers of internal samples per second that an Axia supports, in the order of its setting `setadcrate`. Source:
manual; net_ft_driver's Axia interface.
"""
WRAP = 1 << 32
"""Modulus of both sequence numbers. Source: manual of the Axia."""
BUFFER_LIMIT = 40
"""Maximum number of records in one datagram. Source: clients."""


class Command(IntEnum):
    """Command in a request. Source: manual."""

    STOP = 0x0000
    START = 0x0002
    START_BUFFERED = 0x0003
    START_SYNCHRONISED = 0x0004
    RESET_LATCH = 0x0041
    BIAS = 0x0042


EXTENDED_BIT = 0x8000
"""Bit that marks the command of an extended request."""

SUMMARY = 1 << 31
"""Status bit: summary, which is set for any error."""
SATURATED = 1 << 17
"""Status bit: a gage is saturated, or the converter has failed; the counts are no longer valid."""
MONITOR = 1 << 16
"""Status bit: a threshold was exceeded. The bit is latched."""
OUT_OF_RANGE = 1 << 30
"""Status bit of an Axia: the combined load exceeds its ratings."""
BUSY = 1 << 3
"""Status bit of an Axia: the sensor stores or changes a setting. This is not an error, although the summary bit may
be set with it.
"""
SIMULATED = 1 << 28
"""Status bit of an Axia: a simulated error, which is not an error."""
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
"""Meaning of each status bit of a Net Box except the summary bit. Source: netft-cpp."""
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
"""Meaning of each status bit of an Axia. Source: manuals 9610-05-Ethernet Axia-09, tables 4.7 and 4.9, and
9620-05-C-02, table 5.7.
"""


@dataclass(frozen=True, slots=True)
class Family:
    """A family of sensors that support RDT, with its sample rate and its status bits."""

    rate_hz: int
    """Maximum number of internal samples per second."""
    bits: Mapping[int, str]
    """Meaning of each status bit except the summary bit."""
    harmless: int
    """Status bits that are not errors."""
    summarised: int
    """Harmless bits with which the summary bit may be set."""
    saturated: int
    """Status bits of an excessive load; the counts are no longer valid."""
    overloaded: int
    """Status word of a sensor with a saturated gage."""
    unplugged: int
    """Status word without a transducer. Mark: assumed."""

    def words(self, status: int) -> str:
        """Describe the bits of a status except the summary bit; empty if no other bit is set."""
        return describe_bits(status, self.bits)

    def is_warning(self, status: int) -> bool:
        """Return whether the status contains at least one harmless bit and no error; the record can then be used."""
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
"""Sensor families by the value of the setting `family`."""


_REQUEST = (
    Field("header", 0, "H", Mark.OBSERVED, "1234"),
    Field("command", 2, "H", Mark.OBSERVED, "high bit: names the destination of the records"),
    Field("count", 4, "I", Mark.OBSERVED, "records to send; 0: until a stop"),
)
REQUEST = Layout("a request", 8, ">", _REQUEST)
EXTENDED = Layout("an extended request", 14, ">", _REQUEST)
"""Layout of a request that names the destination address and port of the records in its last six bytes."""
RECORD = Layout(
    "a record",
    36,
    ">",
    (
        Field("rdt_sequence", 0, "I", Mark.OBSERVED, "sequence number in this stream"),
        Field("ft_sequence", 4, "I", Mark.OBSERVED, "number of the internal sample"),
        Field("status", 8, "I", Mark.OBSERVED, bits=_NETBOX_BITS),
        *(Field(axis, 12 + 4 * place, "i", Mark.OBSERVED, unit="counts") for place, axis in enumerate(AXES)),
    ),
)
"""Layout of a record. Its counts, divided by the counts per unit from the page, are forces and torques."""
RECORD_SIZE = RECORD.size


class Request(NamedTuple):
    """One request."""

    command: int
    records: int = 0
    """Number of records to send; 0 means until a stop."""
    extended: bool = False
    """Whether the request names the destination of the records."""


class Record(NamedTuple):
    """One record."""

    rdt_sequence: int
    """Sequence number in this stream; the first record has 1."""
    ft_sequence: int
    """Sequence number of the internal sample, counted from 0 at power-up."""
    status: int
    counts: tuple[int, int, int, int, int, int]
    """Counts of fx fy fz tx ty tz. Divided by the counts per unit from the page, they are forces and torques."""


def encode_request(command: Command, count: int = 0) -> bytes:
    """Encode a request. Raises LocalProtocolError if the count does not fit."""
    return REQUEST.pack_row(HEADER, command, count)


def decode_request(data: bytes) -> Request:
    """Decode a request. Raises RemoteProtocolError if the length or the header is wrong."""
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
    """Encode a record. Raises LocalProtocolError if a value does not fit."""
    try:
        return pack_record(record[0], record[1], record[2], *record[3])
    except struct.error as error:
        raise LocalProtocolError(f"{RECORD.name}: {error}") from error


def decode_record(data: bytes) -> Record:
    """Decode a record. Raises RemoteProtocolError if the length is wrong."""
    if len(data) != RECORD_SIZE:
        raise RemoteProtocolError(f"{RECORD.name} has {RECORD_SIZE} bytes, got {len(data)}")
    rdt, ft, status, fx, fy, fz, tx, ty, tz = unpack_record(data)
    return Record(rdt, ft, status, (fx, fy, fz, tx, ty, tz))


pack_record, unpack_record = RECORD.struct.pack, RECORD.struct.unpack
"""Functions that pack and unpack a record: methods of the layout's own struct, for speed, because records arrive
7000 times per second.
"""


@lru_cache(maxsize=64)
def output_step(rate_hz: float, internal_rate_hz: float = INTERNAL_RATE_HZ) -> int:
    """Return the number of internal samples between two records at a requested rate, Hz. Mark: assumed; it is
    rounded so that the actual rate is never lower.
    """
    return max(1, int(internal_rate_hz / rate_hz + 1e-6))  # the millionth prevents rounding to one step less
