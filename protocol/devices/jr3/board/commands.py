"""Commands of the board, with their arguments and durations. Source: JR3 manual 5907E.

The host writes command_word2 and command_word1 first and command_word0 last. The board reports the result in
command_word0.
"""

from dataclasses import dataclass
from enum import IntEnum

from protocol.marks import Mark


class CommandCode(IntEnum):
    """Command code in the upper byte of command_word0, already shifted."""

    MEMORY_READ = 0x0100
    MEMORY_WRITE = 0x0200
    BIT_SET = 0x0300
    BIT_RESET = 0x0400
    USE_TRANSFORM = 0x0500
    USE_OFFSET = 0x0600
    SET_OFFSETS = 0x0700
    RESET_OFFSETS = 0x0800
    VECTOR_AXES = 0x0900
    SET_FULL_SCALES = 0x0A00
    READ_AND_RESET_PEAKS = 0x0B00
    READ_PEAKS = 0x0C00


@dataclass(frozen=True, slots=True)
class CommandInfo:
    """Properties of one command."""

    code: CommandCode
    name: str
    takes: str
    """Input and output words, as text; w1 and w2 are command_word1 and command_word2."""
    typical: float
    """Typical time from writing command_word0 until the board clears it, s."""
    maximum: float
    """Maximum time from writing command_word0 until the board clears it, s; equal to `typical` if the manual gives
    one value.
    """
    argument_mask: int = 0
    """Bits of command_word0 that hold an argument."""
    per_link: float = 0.0
    """Additional time for each link of the active transform, s."""
    busy: bool = False
    """Whether the board stops computing data while it executes the command."""
    mark: Mark = Mark.OBSERVED


_QUICK, _OFFSET = (40e-6, 125e-6), (150e-6, 225e-6)
_TRANSFORM, _SCALES, _LINK = (2.25e-3, 2.25e-3), (3.4e-3, 3.4e-3), 0.75e-3
_C = CommandCode

COMMANDS: dict[CommandCode, CommandInfo] = {
    info.code: info
    for info in (
        CommandInfo(_C.MEMORY_READ, "memory read", "w1 address → w2 value", *_QUICK),
        CommandInfo(_C.MEMORY_WRITE, "memory write", "w1 address, w2 value → w2 old value", *_QUICK),
        CommandInfo(_C.BIT_SET, "bit set", "w1 address, w2 mask → w2 old value", *_QUICK),
        CommandInfo(_C.BIT_RESET, "bit reset", "w1 address, w2 mask → w2 old value", *_QUICK),
        CommandInfo(
            _C.USE_TRANSFORM, "use transform", "→ transform_num", *_TRANSFORM, 0x0F, _LINK, busy=True
        ),
        CommandInfo(_C.USE_OFFSET, "use offset", "→ offsets, offset_num", *_OFFSET, 0x0F),
        CommandInfo(_C.SET_OFFSETS, "set offsets", "offsets → slot offset_num", *_OFFSET),
        CommandInfo(_C.RESET_OFFSETS, "reset offsets", "offsets grow by filter2", *_OFFSET),
        CommandInfo(_C.VECTOR_AXES, "vector axes", "→ vect_axes", *_QUICK, 0xFF),
        CommandInfo(
            _C.SET_FULL_SCALES, "set full scales", "from full_scale", *_SCALES, per_link=_LINK, busy=True
        ),
        CommandInfo(_C.READ_AND_RESET_PEAKS, "read and reset peaks", "→ minimum, maximum", *_QUICK),
        CommandInfo(_C.READ_PEAKS, "read peaks", "→ minimum, maximum", *_QUICK),
    )
}


def command_info(word0: int) -> tuple[CommandInfo, int] | None:
    """Return the command and its argument in a command_word0 (0 … 65535); None if the command or its argument is
    invalid.
    """
    code = word0 & 0xFF00
    if code not in COMMANDS:
        return None
    info = COMMANDS[CommandCode(code)]
    argument = word0 & 0x00FF
    return None if argument & ~info.argument_mask else (info, argument)
