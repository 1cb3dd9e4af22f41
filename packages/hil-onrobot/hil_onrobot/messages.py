"""Datagrams of an OnRobot HEX behind its Ethernet converter, big-endian: requests of 8 bytes and records of 36 bytes,
as those of a Net F/T, with other commands; and its messages over TCP.

Source of all facts, unless noted otherwise: the maker's examples and the driver in jsbyysheng/onrobot_hex_ft_sensor,
consulted for facts only.
"""

import struct
from collections.abc import Sequence
from enum import IntEnum
from typing import NamedTuple

from protocol.devices.netft.records import HEADER, REQUEST
from protocol.endpoint import RemoteProtocolError
from protocol.fields import Field, Layout
from protocol.marks import Mark
from protocol.wrench import AXES

DATA_PORT = 49152
"""UDP port of the sensor."""
TCP_PORT = 49151
"""TCP port of the sensor."""
RATE_HZ = 1000
"""Largest number of records per second. Assumed: also the number of samples."""
COUNTS_PER_N = 10_000
COUNTS_PER_NM = 100_000
"""Default numbers of counts per unit."""
FILTERS_HZ = (0.0, 500.0, 150.0, 50.0, 15.0, 5.0, 1.5)
"""Cut-off of each low-pass filter, Hz, by the number of the filter; 0 means unfiltered. Assumed: each filter has one
pole.
"""
PAUSE_S = 0.005
"""Time for which the maker's example waits after each request, s."""
WRAP = 1 << 32
"""Modulus of both sequence numbers. Assumed, as of a Net F/T."""
BIAS_ON, BIAS_OFF = 0xFF, 0x00
"""Values that switch the bias."""


class Command(IntEnum):
    """Command in a request."""

    STOP = 0x0000
    START = 0x0002
    """The value is the number of records; 0 means until a stop."""
    BIAS = 0x0042
    SET_FILTER = 0x0081
    """The value is the number of the filter."""
    SET_RATE = 0x0082
    """The value is the number of samples from record to record."""

    @property
    def label(self) -> str:
        """Name for display."""
        return self.name.lower().replace("_", " ")


class Request(NamedTuple):
    """One request."""

    command: int
    value: int


RECORD = Layout(
    "a record",
    36,
    ">",
    (
        Field("sequence", 0, "I", Mark.OBSERVED, "sequence number in this stream"),
        Field("sample", 4, "I", Mark.OBSERVED, "number of the sample"),
        Field("status", 8, "I", Mark.OBSERVED, "0: no error; the meaning of other values is unknown"),
        *(
            Field(
                axis,
                12 + 4 * place,
                "i",
                Mark.OBSERVED,
                "with the default numbers of counts",
                1.0 / (COUNTS_PER_N if place < 3 else COUNTS_PER_NM),
                "N" if place < 3 else "N·m",
            )
            for place, axis in enumerate(AXES)
        ),
    ),
)


def encode_request(command: Command, value: int = 0) -> bytes:
    """Encode a request. Raises LocalProtocolError if the value does not fit."""
    return REQUEST.pack_row(HEADER, command, value)


def decode_request(data: bytes) -> Request:
    """Decode a request as the device does. Raises RemoteProtocolError if the length or the header is wrong.

    The device uses the low half of the data only. Assumed, because the only public driver sends the low half twice
    and works.
    """
    header, command, value = REQUEST.unpack_exact(data)
    if header != HEADER:
        raise RemoteProtocolError(f"a request begins with {HEADER:04X}, got {header:04X}")
    return Request(command, value & 0xFFFF)


# --- TCP

TCP_REQUEST_SIZE = 20
READ, READ_CALIBRATION = 0, 1
"""First byte of a request over TCP; the other bytes are reserved."""
_NEWTON, _NEWTON_METRE = 2, 3
_READING = struct.Struct(">HH6h")
_CALIBRATION = struct.Struct(">HBBII6H")
CALIBRATION_SIZE = _CALIBRATION.size
_END = 32767


class Calibration(NamedTuple):
    """Scales of the values over TCP. A value in N or N·m is reading / counts × factor."""

    counts_per_n: int
    counts_per_nm: int
    factors: tuple[int, ...]


def encode_reading(status: int, counts: Sequence[float], calibration: Calibration) -> bytes:
    """Encode the answer that contains a measurement, in counts. Assumed: the low half of the status."""
    values = [
        max(-_END, min(_END, round(count / factor)))
        for count, factor in zip(counts, calibration.factors, strict=True)
    ]
    return _READING.pack(HEADER, status & 0xFFFF, *values)


def encode_calibration(calibration: Calibration) -> bytes:
    """Encode the answer that contains the scales."""
    per_n, per_nm, factors = calibration
    return _CALIBRATION.pack(HEADER, _NEWTON, _NEWTON_METRE, per_n, per_nm, *factors)


def decode_calibration(data: bytes) -> Calibration:
    """Decode the scales. Raises RemoteProtocolError if the answer is invalid or has other units than N and N·m."""
    if len(data) != _CALIBRATION.size:
        raise RemoteProtocolError(f"a calibration has {_CALIBRATION.size} bytes, got {len(data)}")
    header, force, moment, per_n, per_nm, *factors = _CALIBRATION.unpack(data)
    if header != HEADER or (force, moment) != (_NEWTON, _NEWTON_METRE) or not (per_n and per_nm):
        raise RemoteProtocolError(f"an invalid calibration: {data.hex()}")
    return Calibration(per_n, per_nm, tuple(factors))


def decode_reading(data: bytes, calibration: Calibration) -> tuple[int, tuple[float, ...]]:
    """Decode the status and the measurement, N and N·m. Raises RemoteProtocolError if the answer is invalid."""
    if len(data) != _READING.size:
        raise RemoteProtocolError(f"a reading has {_READING.size} bytes, got {len(data)}")
    header, status, *values = _READING.unpack(data)
    if header != HEADER:
        raise RemoteProtocolError(f"a reading begins with {HEADER:04X}, got {header:04X}")
    counts = (calibration.counts_per_n,) * 3 + (calibration.counts_per_nm,) * 3
    rows = zip(values, counts, calibration.factors, strict=True)
    return status, tuple(value / count * factor for value, count, factor in rows)
