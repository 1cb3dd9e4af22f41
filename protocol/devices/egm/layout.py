"""Fixed layouts of the usual datagrams, byte for byte as Protocol Buffers encode them.

A session consists almost entirely of such datagrams: their numbers are always at the same places, apart from the
varints of the header and of the clocks. `messages` encodes and decodes any other datagram by the schema.
"""

import struct
from collections.abc import Sequence
from typing import Any

UNUSUAL = (IndexError, ValueError, struct.error)
"""Exceptions for values and datagrams without the usual layout."""
_NUMBERS = 2**32
_LONGEST_BITS = 35
"""Number of bits in the longest usual varint."""
_MICRO = 1_000_000


class Layout:
    """Numbers at fixed places, each after constant bytes."""

    def __init__(self, *fields: tuple[str, str]) -> None:
        """Each field consists of its constant bytes, in hexadecimal, and the `struct` character of its number."""
        self._constants = tuple(bytes.fromhex(constant) for constant, _ in fields)
        self._parts: list[object] = [part for constant in self._constants for part in (constant, 0)]
        codes = (f"{len(bytes.fromhex(constant))}s{code}" for constant, code in fields)
        self._struct = struct.Struct("<" + "".join(codes))
        self.size = self._struct.size

    def write(self, numbers: Sequence[float | None]) -> bytes:
        """Encode the numbers."""
        parts = self._parts.copy()
        parts[1::2] = numbers
        return self._struct.pack(*parts)

    def read(self, data: bytes, at: int) -> tuple[Any, ...]:
        """Decode the numbers from this index on."""
        parts = self._struct.unpack_from(data, at)
        if parts[::2] != self._constants:
            raise ValueError("another layout")
        return parts[1::2]


_POSE = ("09", "d"), ("11", "d"), ("19", "d"), ("122409", "d"), ("11", "d"), ("19", "d"), ("21", "d")
"""Position and quaternion."""
_PLACE = Layout(("0a3609", "d"), *[("09", "d")] * 5, ("12430a1b09", "d"), *_POSE[1:])
"""Six joints and a pose."""
REFERENCE = Layout(("124512430a1b09", "d"), *_POSE[1:])
"""Pose of an answer."""
SPEED = Layout(("1a38123609", "d"), *[("09", "d")] * 5)
"""Speed of an answer, after its pose."""
STATES = Layout(
    ("220208", "B"),
    ("2a0208", "B"),
    ("30", "B"),
    ("420208", "B"),
    ("4a3808", "B"),
    *[("11", "d")] * 6,
    ("51", "d"),
    ("58", "B"),
    ("620208", "B"),
    ("6a0208", "B"),
)
"""End of a datagram of RobotWare 7: motors, guidance, convergence, RAPID, force control, force, utilisation, move
index, collision and digital value.
"""
ONE_BYTE = 128
"""Number from which a varint takes more than one byte."""
FEEDBACK, PLANNED = 0x12, 0x1A
"""First bytes of the two positions in a datagram of a robot."""


def write_header(seqno: int, tm: int | None, kind: int) -> bytes:
    """Encode a header."""
    time = b"" if tm is None else b"\x10" + _varint(tm % _NUMBERS)
    body = b"\x08" + _varint(seqno % _NUMBERS) + time + bytes((0x18, kind))
    return bytes((0x0A, len(body))) + body


def read_header(data: bytes) -> tuple[int, int | None, int, int]:
    """Return number, time stamp and type in a header, and the index after it."""
    end, tm = 2 + data[1], None
    seqno, at = _read_varint(data, 2, 0x08)
    if data[at] == 0x10:
        tm, at = _read_varint(data, at, 0x10)
    if data[0] != 0x0A or data[at] != 0x18 or data[at + 1] >= ONE_BYTE or at + 2 != end:
        raise ValueError("another layout")
    return seqno, tm, data[at + 1], end


def write_place(first: int, numbers: Sequence[float], time_us: int) -> bytes:
    """Encode a position: six joints, position, quaternion and time."""
    sec, usec = divmod(time_us, _MICRO)
    clock = b"\x08" + _varint(sec) + b"\x10" + _varint(usec)
    body = _PLACE.write(numbers) + bytes((0x22, len(clock))) + clock
    return bytes((first,)) + _varint(len(body)) + body


def read_place(data: bytes, at: int, first: int) -> tuple[tuple[float, ...], int, int]:
    """Return the numbers and the time of a position, and the index after it."""
    size, at = _read_varint(data, at, first)
    end, clock = at + size, at + _PLACE.size
    numbers = _PLACE.read(data, at)
    sec, at = _read_varint(data, clock + 2, 0x08)
    usec, at = _read_varint(data, at, 0x10)
    if data[clock] != 0x22 or data[clock + 1] != end - clock - 2 or at != end:
        raise ValueError("another layout")
    return numbers, sec * _MICRO + usec, end


def _varint(number: int) -> bytes:
    if not 0 <= number < _NUMBERS:
        raise ValueError("not a usual number")
    last = ((number | 1).bit_length() - 1) // 7 * 7
    return bytes((*[number >> shift & 127 | ONE_BYTE for shift in range(0, last, 7)], number >> last))


def _read_varint(data: bytes, at: int, tag: int) -> tuple[int, int]:
    """Return the number after this tag, and the index after the number."""
    if data[at] != tag:
        raise ValueError("another layout")
    at += 1
    byte = number = data[at]
    shift = 7
    while byte >= ONE_BYTE:
        at += 1
        byte = data[at]
        number += byte - 1 << shift  # without the bit that announced this byte
        shift += 7
    if number >= _NUMBERS or shift > _LONGEST_BITS:
        raise ValueError("not a usual number")
    return number, at + 1
