"""Named words of the receiver board's memory: one table for client, emulator and monitor.

Source: JR3 manual 5907E, and the public header of Linux's jr3_pci driver.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from protocol.devices.jr3.board.words import MEMORY_WORDS, to_signed
from protocol.endpoint import RemoteProtocolError
from protocol.marks import Mark
from protocol.wrench import AXES

SLOTS = 16
"""Number of slots each for offsets, load envelopes and transforms."""
SLOT_WORDS = 16
"""Number of words in one slot for load envelopes or transforms. A longer entry extends into the next slots."""
FILTERS = 7
"""Number of filters: filter0, which is unfiltered, to filter6."""
VECTORS = ("v1", "v2")
CHANNELS = 16

_ELEMENTS = {len(AXES): AXES, len(AXES) + len(VECTORS): (*AXES, *VECTORS)}


@dataclass(frozen=True, slots=True)
class Register:
    """One named word or array of the memory."""

    name: str
    address: int
    count: int
    signed: bool
    meaning: str
    unit: str = ""
    scale: float = 1.0
    """Size of one raw unit, expressed in `unit`."""
    settable: bool = False
    """Whether the board reacts to a value that a host writes here."""
    mark: Mark = Mark.OBSERVED

    def element(self, index: int) -> str:
        """Return the name of one word: `filter2.fx`, `copyright[3]`, `errors`."""
        if self.count == 1:
            return self.name
        names = _ELEMENTS.get(self.count)
        return f"{self.name}.{names[index]}" if names else f"{self.name}[{index}]"

    def values(self, words: Sequence[int]) -> tuple[int, ...]:
        """Convert the raw words of this register to signed or unsigned numbers."""
        return tuple(map(to_signed, words)) if self.signed else tuple(words)


def _channels() -> list[Register]:
    carries = {0: "excitation voltage", 7: "calibration data, one byte a sample"} | {
        1 + i: f"{axis}, not decoupled" for i, axis in enumerate(AXES)
    }
    rows = []
    for k in range(CHANNELS):
        what = carries.get(k, "depends on the sensor")
        rows += [
            Register(f"raw{k}_time", 4 * k, 1, False, "board clock at the sample", "s", 1e-6),
            Register(f"raw{k}_data", 4 * k + 1, 1, True, f"raw channel {k}: {what}", "counts"),
        ]
    return rows


_FULL_SCALE = "in the unit that `units` names"
_COUNTS = "counts of full scale / 16384"

_TABLE = (
    *_channels(),
    Register("copyright", 0x40, 24, False, "text, one character in the high byte of a word"),
    Register("shunts", 0x60, 6, True, "shunt readings, 0 for a sensor of fixed gain"),
    Register("default_fs", 0x68, 6, True, "full scales unless the host sets others", _FULL_SCALE),
    Register("load_envelope_num", 0x6F, 1, True, "load envelope in use", settable=True),
    Register("min_full_scale", 0x70, 6, True, "smallest without early saturation", _FULL_SCALE),
    Register("transform_num", 0x77, 1, True, "transform in use"),
    Register("max_full_scale", 0x78, 6, True, "largest without losing a bit", _FULL_SCALE),
    Register("peak_address", 0x7F, 1, False, "first of the eight words watched for peaks", settable=True),
    Register(
        "full_scale", 0x80, 8, True, "full scales, in use after command 0A00", _FULL_SCALE, settable=True
    ),
    Register("offsets", 0x88, 6, True, "subtracted from the data", _COUNTS, settable=True),
    Register("offset_num", 0x8E, 1, True, "slot of offsets in use"),
    Register("vect_axes", 0x8F, 1, False, "components of the vectors"),
    *(
        Register(f"filter{n}", 0x90 + 8 * n, 8, True, "filtered data" if n else "unfiltered data", _COUNTS)
        for n in range(FILTERS)
    ),
    Register("rate", 0xC8, 8, True, "difference of eight words between two calculations", _COUNTS),
    Register("minimum", 0xD0, 8, True, "lowest values, put here by commands 0B00 and 0C00", _COUNTS),
    Register("maximum", 0xD8, 8, True, "highest values, put here by commands 0B00 and 0C00", _COUNTS),
    Register("near_sat_value", 0xE0, 1, True, "raw magnitude that warns", "counts", settable=True),
    Register("sat_value", 0xE1, 1, True, "raw magnitude that is an error", "counts", settable=True),
    Register("rate_address", 0xE2, 1, False, "first of the eight words of the rate", settable=True),
    Register(
        "rate_divisor", 0xE3, 1, False, "samples from rate to rate, 0 = 65536", "samples", settable=True
    ),
    Register("rate_count", 0xE4, 1, False, "samples since the last rate", "samples", settable=True),
    Register("command_word2", 0xE5, 1, True, "second argument or result of a command", settable=True),
    Register("command_word1", 0xE6, 1, True, "first argument or result of a command", settable=True),
    Register("command_word0", 0xE7, 1, True, "command, written last; 0 done, negative failed", settable=True),
    *(Register(f"count{n}", 0xE7 + n, 1, False, f"calculations of filter{n}") for n in range(1, FILTERS)),
    Register("error_count", 0xEE, 1, False, "samples received badly"),
    Register("count_x", 0xEF, 1, False, "rounds in which the processor had nothing to do"),
    Register("warnings", 0xF0, 1, False, "bits of near saturation"),
    Register("errors", 0xF1, 1, False, "error bits", settable=True),
    Register("threshold_bits", 0xF2, 1, False, "bits set by the load envelope", settable=True),
    Register("last_crc", 0xF3, 1, True, "remainder of the calibration's check, 0 = good"),
    Register("eeprom_ver", 0xF4, 1, True, "version of the sensor's memory"),
    Register("software_ver", 0xF5, 1, True, "version of the board's program", "version", 0.01),
    Register("software_day", 0xF6, 1, True, "day of the year of that program"),
    Register("software_year", 0xF7, 1, True, "year of that program"),
    Register("serial_no", 0xF8, 1, False, "serial number of the sensor, 0 = not read yet"),
    Register("model_no", 0xF9, 1, False, "model of the sensor, 0 = not read yet"),
    Register("cal_day", 0xFA, 1, True, "day of the year of the calibration"),
    Register("cal_year", 0xFB, 1, True, "year of the calibration"),
    Register("units", 0xFC, 1, False, "unit of full scales and lengths"),
    Register("bits", 0xFD, 1, True, "resolution of the converter", "bit"),
    Register("channels", 0xFE, 1, False, "channels that the sensor can send, a bit each"),
    Register("thickness", 0xFF, 1, True, "of the sensor, flange to flange", _FULL_SCALE),
    *(
        Register(f"load_envelope{n}", 0x100 + n * SLOT_WORDS, 16, True, "slot of thresholds", settable=True)
        for n in range(SLOTS)
    ),
    *(
        Register(f"transform{n}", 0x200 + n * SLOT_WORDS, 16, True, "slot of links", settable=True)
        for n in range(SLOTS)
    ),
)

REGISTERS: dict[str, Register] = {register.name: register for register in _TABLE}
"""All named words and arrays by name, in order of address."""

_BY_ADDRESS = {
    register.address + index: (register, index) for register in _TABLE for index in range(register.count)
}


def register_at(address: int) -> tuple[Register, int] | None:
    """Return the register that contains the word at an address, and the index of the word in that register; None
    for a word without a name.
    """
    return _BY_ADDRESS.get(address)


def check_range(address: int, count: int) -> None:
    """Raise RemoteProtocolError if a burst is empty or exceeds the memory."""
    if count < 1 or address < 0 or address + count > MEMORY_WORDS:
        raise RemoteProtocolError(
            f"{count} words from {address:#06x} are not inside the board's memory 0x0000 … {MEMORY_WORDS - 1:#06x}"
        )


INSTRUCTIONS = 0x4000
"""Capacity of the board processor's program memory, in instructions. Source: Linux's jr3_pci driver."""


def check_instructions(address: int, words: Sequence[int]) -> None:
    """Raise RemoteProtocolError if an instruction is incomplete or outside the program memory."""
    if len(words) % 2 or address < 0 or address + len(words) // 2 > INSTRUCTIONS:
        raise RemoteProtocolError(
            f"{len(words)} half instructions from {address:#06x} are not within the program's memory "
            f"0x0000 … {INSTRUCTIONS - 1:#06x}"
        )


def describe(address: int, words: Sequence[int]) -> list[dict[str, object]]:
    """Describe every named word of a burst for display: name, raw value, value in its unit, mark and meaning."""
    rows: list[dict[str, object]] = []
    for offset, word in enumerate(words):
        if (entry := _BY_ADDRESS.get(address + offset)) is None:
            continue
        register, index = entry
        raw = to_signed(word) if register.signed else word
        rows.append(
            {
                "name": register.element(index),
                "raw": raw,
                "value": raw * register.scale if register.scale != 1.0 else raw,
                "unit": register.unit,
                "mark": register.mark.value,
                "meaning": register.meaning,
            }
        )
    return rows
