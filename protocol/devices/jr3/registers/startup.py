"""Procedures of a host on a board's registers, as sequences of steps: the kernel driver's start-up, commands, and a
zero.

A sequence is a generator of steps. It receives the words of each Read, and nothing for the other steps. It is
independent of wire and clock: the caller reads, writes and waits. Order and pauses are the same as in Linux's
jr3_pci driver.
"""

from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass
from typing import TypeAlias, TypeVar

from protocol.devices.jr3.board import (
    REGISTERS,
    UNIT_SCALES,
    CommandCode,
    Errors,
    LinkType,
    Units,
    command_info,
    to_signed,
)
from protocol.devices.jr3.registers.profile import BoardClientProfile
from protocol.endpoint import RemoteProtocolError
from protocol.wrench import AXES


@dataclass(frozen=True, slots=True)
class Read:
    """Step that reads consecutive words as one snapshot."""

    address: int
    count: int = 1


@dataclass(frozen=True, slots=True)
class Write:
    """Step that writes consecutive words in order of address."""

    address: int
    words: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Reset:
    """Step that activates the board's reset line."""


@dataclass(frozen=True, slots=True)
class Load:
    """Step that writes instructions to the board's processor; without words, it resets the processor and lets its
    program start.
    """

    address: int
    words: tuple[int, ...] = ()
    """Low and high half of each instruction, in alternation."""


@dataclass(frozen=True, slots=True)
class ProgramWord:
    """One instruction of the board's processor: 24 bits in two halves."""

    address: int
    low: int
    high: int


@dataclass(frozen=True, slots=True)
class Wait:
    """Step that pauses."""

    duration: float
    """Duration of the pause, s."""


Step: TypeAlias = Read | Write | Reset | Load | Wait
Result = TypeVar("Result")
Steps: TypeAlias = Generator[Step, Sequence[int], Result]


@dataclass(frozen=True, slots=True)
class BoardIdentity:
    """Identity of the sensor as read by the board, and the full scales of its counts."""

    serial_no: int
    model_no: int
    full_scales: tuple[float, ...]
    """Full scales of fx fy fz mx my mz, N and N·m."""


_ERRORS = REGISTERS["errors"].address
_SERIAL = REGISTERS["serial_no"].address
_MODEL = REGISTERS["model_no"].address
_FULL_SCALE = REGISTERS["full_scale"].address
_MAX_FULL_SCALE = REGISTERS["max_full_scale"].address
_OFFSETS = REGISTERS["offsets"].address
_UNITS = REGISTERS["units"].address
_TRANSFORM = REGISTERS["transform0"].address
_WORD0 = REGISTERS["command_word0"].address
_WORD2 = REGISTERS["command_word2"].address

DEAF = Errors.WATCH_DOG | Errors.WATCH_DOG2
"""Error bits that mean that the board receives no sensor data."""
NEW = Errors.SENSOR_CHANGE | Errors.CALIBRATION_CRC
"""Error bits that mean that the board has another sensor, or is reading the calibration of the same sensor again."""


_LOADED_AT_ONCE = 128
"""Maximum number of instructions in one telegram. Source: the register protocol's limit of 256 words."""


def start_up(profile: BoardClientProfile, program: Sequence[ProgramWord] = ()) -> Steps[BoardIdentity]:
    """Start up a board until it measures with an empty transform, its largest full scales, and no offsets.

    The program is loaded between the reset and the pause after it. If it is empty, the board or its server must
    already have a program. Raises RemoteProtocolError if there is no sensor or the board refuses a command.
    """
    yield Load(0) if program else Reset()
    yield from _split_program(program)
    yield Wait(profile.reset_ms * 1e-3)
    return (yield from configure(profile))


def _split_program(program: Sequence[ProgramWord]) -> Iterator[Load]:
    """Split the program at its gaps and at the maximum length of a telegram."""
    first, words = 0, list[int]()
    for word in program:
        if words and (word.address != first + len(words) // 2 or len(words) == 2 * _LOADED_AT_ONCE):
            yield Load(first, tuple(words))
            words = []
        first = first if words else word.address
        words += (word.low, word.high)
    if words:
        yield Load(first, tuple(words))


def configure(profile: BoardClientProfile) -> Steps[BoardIdentity]:
    """Run the start-up without the reset, as required after another sensor has been plugged in."""
    yield from _wait_for_sensor(profile, profile.offset_polls)
    yield Write(_TRANSFORM, (LinkType.END, 0))
    yield from command(profile, CommandCode.USE_TRANSFORM)
    scales = yield Read(_MAX_FULL_SCALE, len(AXES))
    _check_scales(scales)
    yield Write(_FULL_SCALE, tuple(scales))
    yield from command(profile, CommandCode.SET_FULL_SCALES)
    yield from command(profile, CommandCode.USE_OFFSET, pause_ms=profile.use_offset_ms)
    yield Write(_OFFSETS, (0,) * len(AXES))
    yield from command(profile, CommandCode.SET_OFFSETS)
    return (yield from _read_identity())


def attach(profile: BoardClientProfile) -> Steps[BoardIdentity]:
    """Read the identity of a board that is already running. Raises RemoteProtocolError if there is no sensor."""
    yield from _wait_for_sensor(profile, 0)
    return (yield from _read_identity())


def zero(profile: BoardClientProfile) -> Steps[None]:
    """Use the present value of filter2 as offsets. The slot that stores offsets does not change."""
    yield from command(profile, CommandCode.RESET_OFFSETS)


def command(
    profile: BoardClientProfile,
    code: int,
    word1: int | None = None,
    word2: int = 0,
    pause_ms: float | None = None,
) -> Steps[None]:
    """Execute a command and wait for its end. If the command has arguments, command_word2 and command_word1 are
    written first; command_word0 is written last.

    Raises RemoteProtocolError if the board reports a failure or does not respond.
    """
    yield Write(_WORD0, (code,)) if word1 is None else Write(_WORD2, (word2, word1, code))
    pause = (profile.command_ms if pause_ms is None else pause_ms) * 1e-3
    waited = 0.0
    while waited < profile.command_timeout_s:
        yield Wait(pause)
        waited += pause
        answer = to_signed((yield Read(_WORD0))[0])
        if answer == 0:
            return
        if answer < 0:
            raise RemoteProtocolError(f"{_name(code)} failed with {answer}")
        pause = profile.command_ms * 1e-3
    raise RemoteProtocolError(
        f"{_name(code)} has not ended after {waited:g} s", "does the board's program run?"
    )


def errors_text(word: int) -> str:
    """Return the names of the bits set in the word `errors`."""
    return ", ".join(bit.name.lower().replace("_", " ") for bit in Errors if bit & word and bit.name)


def _wait_for_sensor(profile: BoardClientProfile, further: int) -> Steps[None]:
    """Poll until a sensor is present, then poll `further` more times. Raises RemoteProtocolError if there is no
    sensor after the time-out.
    """
    good, waited = 0, 0.0
    while True:
        words = yield Read(_ERRORS, _MODEL - _ERRORS + 1)
        errors, serial, model = words[0], words[_SERIAL - _ERRORS], words[_MODEL - _ERRORS]
        if errors & Errors.SENSOR_CHANGE:
            # Latched: the driver would poll forever. According to the manual, the host clears it with this command.
            yield from command(profile, CommandCode.BIT_RESET, _ERRORS, Errors.SENSOR_CHANGE)
        if errors & (DEAF | NEW) or not serial or not model:
            good = 0
            if waited >= profile.ready_timeout_s:
                why = f" ({errors_text(errors)})" if errors else ""
                what = "no sensor" if errors & DEAF else "the sensor's calibration has not been read"
                raise RemoteProtocolError(f"{what} after {waited:g} s{why}", "is it plugged in?")
            waited += profile.poll_s
        elif good == further:
            return
        else:
            good += 1
        yield Wait(profile.poll_s)


def _read_identity() -> Steps[BoardIdentity]:
    scales = yield Read(_FULL_SCALE, len(AXES))
    _check_scales(scales)
    words = yield Read(_SERIAL, _UNITS - _SERIAL + 1)
    units, serial, model = words[-1], words[0], words[_MODEL - _SERIAL]
    if units not in list(Units):
        raise RemoteProtocolError(f"the board counts in unit {units}, which is unknown")
    unit = UNIT_SCALES[Units(units)]
    full_scales = (
        *(word * unit.force for word in scales[:3]),
        *(word * unit.moment for word in scales[3:]),
    )
    return BoardIdentity(serial, model, full_scales)


def _check_scales(words: Sequence[int]) -> None:
    for axis, word in zip(AXES, words, strict=True):
        if to_signed(word) <= 0:
            raise RemoteProtocolError(f"full scale of {axis} is {to_signed(word)}", "calibration not read?")


def _name(code: int) -> str:
    info = command_info(code)
    return f"command {code:04X}" + (f" ({info[0].name})" if info else "")


def step_name(step: Step | None) -> str:
    """Return the name of a step for messages."""
    match step:
        case Read(address, count):
            return f"a read of {count} words from {address:04X}"
        case Write(address, words):
            return f"a write of {len(words)} words to {address:04X}"
        case Load(_, words) if words:
            return "a program"
        case _:
            return "a reset"
