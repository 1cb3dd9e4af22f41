"""Interpretation of single words of the board's memory: sign, bits, units.

Source: JR3 manual 5907E; bit names follow the public header of Linux's jr3_pci driver.
"""

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum, IntFlag

from protocol.endpoint import LocalProtocolError

WORD_MODULUS = 1 << 16
MEMORY_WORDS = 1 << 14
"""Number of words that a host can address."""
RAM_WORDS = 1 << 13
"""Number of words in the lower half of the memory, which the host may write. Status registers follow."""
COMMAND_ERROR = -1
"""Value of command_word0 after a failed command. Assumed: the manual says only that it is negative."""
CLOCK_HZ = 1_000_000
"""Clock rate of the raw channels' time stamps, Hz: a tenth of the slowest processor's 10 MHz."""


def to_signed(word: int) -> int:
    """Convert a word, 0 … 65535, from two's complement to a signed number."""
    return word - WORD_MODULUS if word >= WORD_MODULUS // 2 else word


def from_signed(value: int) -> int:
    """Convert a number to a word. A number beyond 16 bits wraps around, as in a processor register."""
    return value % WORD_MODULUS


def pack_words(words: Sequence[int]) -> bytes:
    """Encode words, 0 … 65535, in wire format, big-endian. Raises LocalProtocolError for a number beyond 16 bits."""
    try:
        return struct.pack(f">{len(words)}H", *words)
    except struct.error as error:
        raise LocalProtocolError(f"a word has 16 bits, unsigned, got {min(words)} … {max(words)}") from error


class Warnings(IntFlag):
    """Bits of the word `warnings`: raw channels that have reached near_sat_value."""

    FX_NEAR_SATURATION = 0x0001
    FY_NEAR_SATURATION = 0x0002
    FZ_NEAR_SATURATION = 0x0004
    MX_NEAR_SATURATION = 0x0008
    MY_NEAR_SATURATION = 0x0010
    MZ_NEAR_SATURATION = 0x0020


class Errors(IntFlag):
    """Bits of the word `errors`: raw channels that have reached sat_value, and errors of the sensor or the board."""

    FX_SATURATION = 0x0001
    FY_SATURATION = 0x0002
    FZ_SATURATION = 0x0004
    MX_SATURATION = 0x0008
    MY_SATURATION = 0x0010
    MZ_SATURATION = 0x0020
    MEMORY = 0x0400
    """The memory test at power-up failed."""
    SENSOR_CHANGE = 0x0800
    """The calibration of another sensor has been read. Latched until the host clears it."""
    SYSTEM_BUSY = 0x1000
    """No data is computed, because a transform, full scales or a calibration is being processed."""
    CALIBRATION_CRC = 0x2000
    """The calibration has not been read, or its CRC is wrong."""
    WATCH_DOG2 = 0x4000
    """The sensor's data or clock is missing."""
    WATCH_DOG = 0x8000
    """The sensor is not connected."""


SATURATIONS = 0x003F
"""Bits of the six axes in the words `warnings` and `errors`."""


class VectorAxes(IntFlag):
    """Bits of the word `vect_axes`: components of V1 (of forces, unless changed) and V2 (of moments)."""

    V1_X = 0x01
    V1_Y = 0x02
    V1_Z = 0x04
    V2_X = 0x08
    V2_Y = 0x10
    V2_Z = 0x20
    V2_OF_FORCES = 0x40
    V1_OF_MOMENTS = 0x80


class Units(IntEnum):
    """Unit system of full scales and transforms, word `units`."""

    POUND = 0
    NEWTON = 1
    KILOGRAM_FORCE = 2
    KILOPOUND = 3


@dataclass(frozen=True, slots=True)
class UnitScales:
    """SI values of the raw units of force, moment and length."""

    force: float
    """Size of one raw unit of force, N."""
    moment: float
    """Size of one raw unit of moment, N·m."""
    length: float
    """Size of one raw unit of length, m."""


_POUND, _INCH, _STANDARD_GRAVITY = 0.45359237, 0.0254, 9.80665
_POUND_FORCE = _POUND * _STANDARD_GRAVITY
UNIT_SCALES: dict[Units, UnitScales] = {
    Units.POUND: UnitScales(_POUND_FORCE, _POUND_FORCE * _INCH, _INCH / 1000),
    Units.NEWTON: UnitScales(1.0, 0.1, 1e-4),
    Units.KILOGRAM_FORCE: UnitScales(_STANDARD_GRAVITY / 10, _STANDARD_GRAVITY / 100, 1e-4),
    Units.KILOPOUND: UnitScales(_POUND_FORCE * 1000, _POUND_FORCE * _INCH * 1000, _INCH / 1000),
}
"""SI values of the raw units in each unit system: lb, in·lb, mil; N, N·m×10, mm×10; kgf×10, kgf·cm, mm×10; klb,
kin·lb, mil.
"""
