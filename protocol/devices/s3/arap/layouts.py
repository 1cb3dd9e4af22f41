"""Field tables of the known ARAP payloads. Source: computer-link specification, section 3.

Offsets are written as in the specification, as the byte number in the telegram minus the 8 bytes of the header.
"""

from dataclasses import replace

from protocol.devices.s3.adlp import HEADER_SIZE
from protocol.fields import Field, Layout
from protocol.marks import Mark

STEPS_PER_METRE = 8000
POSITION_STEP = 1.0 / STEPS_PER_METRE
"""Size of one unit of a position word, m (0.125 mm). Mark: observed."""
POSITION_WORD_LIMIT = 32767
"""Largest magnitude of a position word that is sent; it equals 4.095875 m. Mark: observed."""
QUATERNION_ONE = 16384
"""Quaternion word that represents 1.0. Mark: observed."""
VELOCITY_STEP = POSITION_STEP
"""Size of one unit of a velocity word, m/s (0.125 mm/s). Mark: observed."""
RUN_SPEED_ONE = 8192
"""Run speed word that represents 1.0. Mark: observed."""

FLAG_BITS_16 = {"local": 0, "interrupt_permitted": 1, "programming_unit": 2, "key_auto": 3}
"""Bit numbers of the flags in byte 16 of the status. Mark: assumed."""
FLAG_BITS_17 = {"standby": 0, "operation": 1, "execution": 2, "emergency_stop": 3}
"""Bit numbers of the flags in byte 17 of the status. Mark: observed."""
MOVE_FLAG_ENDS = 2
"""Move flag that is set in the first and the last telegram of a movement. Mark: observed."""
MOVE_FLAG_ROBOT_COORDINATES = 4
"""Move flag for robot coordinates. If it is clear, the coordinates are rectangular. Mark: observed."""


def _word(byte: int, name: str, mark: Mark, meaning: str) -> Field:
    return Field(name, byte - HEADER_SIZE, "H", mark, meaning)


def _bits(bits: dict[str, int]) -> str:
    return ", ".join(f"bit {bit} {name.replace('_', ' ')}" for name, bit in bits.items())


_POSE = (
    *(
        Field(axis, byte - HEADER_SIZE, "h", Mark.OBSERVED, f"position {axis.upper()}", POSITION_STEP, "m")
        for axis, byte in (("x", 18), ("y", 20), ("z", 22))
    ),
    *(
        Field(f"q{n}", 22 + 2 * n - HEADER_SIZE, "h", Mark.OBSERVED, meaning, 1.0 / QUATERNION_ONE)
        for n, meaning in ((1, "cos(θ/2)"), (2, "n_x sin(θ/2)"), (3, "n_y sin(θ/2)"), (4, "n_z sin(θ/2)"))
    ),
)

HEADER = Layout(
    "telegram header",
    HEADER_SIZE,
    ">",
    (
        Field("length", 0, "H", Mark.OBSERVED, "of the entire telegram; from the PC also of its data alone"),
        Field("source", 2, "B", Mark.OBSERVED, "1 from the PC, 0 from the S3"),
        Field("destination", 3, "B", Mark.OBSERVED, "0"),
        Field("function", 4, "B", Mark.OBSERVED, "function code"),
        Field("type", 5, "B", Mark.OBSERVED, "telegram type"),
        Field("suffix", 6, "H", Mark.OBSERVED, "function suffix"),
    ),
)
"""Layout of the header. Its offsets count from the telegram's first byte, unlike the offsets of the payloads."""
STATUS = Layout(
    "status",
    32 - HEADER_SIZE,
    ">",
    (
        _word(8, "program", Mark.ASSUMED, "program number"),
        _word(10, "instruction", Mark.ASSUMED, "instruction number"),
        _word(12, "tcp", Mark.ASSUMED, "active TCP"),
        _word(14, "frame", Mark.ASSUMED, "active frame"),
        Field("flags_16", 16 - HEADER_SIZE, "B", Mark.ASSUMED, _bits(FLAG_BITS_16)),
        Field("flags_17", 17 - HEADER_SIZE, "B", Mark.OBSERVED, _bits(FLAG_BITS_17)),
        *_POSE,
    ),
)
MOVE = Layout(
    "move",
    32 - HEADER_SIZE,
    ">",
    (
        Field("hand", 12 - HEADER_SIZE, "B", Mark.OBSERVED, "hand position, 0"),
        Field("flags", 13 - HEADER_SIZE, "B", Mark.OBSERVED, "2 first or last telegram, 4 robot coordinates"),
        replace(_word(14, "velocity", Mark.OBSERVED, "velocity"), scale=VELOCITY_STEP, unit="m/s"),
        replace(
            _word(16, "run_speed", Mark.OBSERVED, "run speed, factor on the velocity"),
            scale=1.0 / RUN_SPEED_ONE,
        ),
        *_POSE,
    ),
)
EMPTY = Layout("no data", 0, ">", ())
START_PROGRAM = Layout("start program", 2, ">", (_word(8, "program", Mark.OBSERVED, "program number"),))
STOP_PROGRAM = Layout("stop program", 0, ">", ())
WRITE_MODE = Layout("write mode", 0, ">", ())
READ_STATUS = Layout("read status", 0, ">", ())
RECEIVE_PROGRAM = Layout("receive program", 4, ">", (_word(8, "program", Mark.OBSERVED, "program number"),))
"""Request for the bytes of a program. Two bytes of 0 follow the program number."""
PROGRAM_ANSWER = Layout(
    "program answer",
    4,
    ">",
    (
        _word(8, "error", Mark.OBSERVED, "error, 0 for none"),
        _word(10, "program", Mark.OBSERVED, "program number"),
    ),
)
"""Start of the answer to receive program. The bytes of the program follow, in several blocks if needed."""
SPONTANEOUS = Layout(
    "spontaneous",
    4,
    ">",
    (
        _word(8, "x", Mark.OBSERVED, 'first half of "x.y"'),
        _word(10, "y", Mark.OBSERVED, 'second half of "x.y"'),
    ),
)
REFUSAL = Layout("refusal", 2, ">", (_word(8, "code", Mark.OBSERVED, "refusal code"),))
