"""Typed values of the known payloads, in SI units. Source: computer-link specification, section 3."""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Self, TypeAlias

from protocol.devices.s3.adlp import HEADER_SIZE, TRAILER
from protocol.devices.s3.arap import layouts
from protocol.devices.s3.arap.codes import (
    FunctionCode,
    Mode,
    MoveKind,
    TelegramType,
    refusal_text,
    suffix_text,
)
from protocol.devices.s3.arap.telegram import Telegram
from protocol.endpoint import LocalProtocolError, RemoteProtocolError
from protocol.geometry import Quaternion, Vector

Words3: TypeAlias = tuple[int, int, int]
Words4: TypeAlias = tuple[int, int, int, int]

# Used in every cycle, so bound to module names: before Python 3.12 an enum member lookup is five times slower.
_READ_STATUS, _MOVE, _POINT = FunctionCode.READ_STATUS, FunctionCode.MOVE, MoveKind.POINT
_RESPONSE, _ORDER = TelegramType.RESPONSE, TelegramType.ORDER

MOVE_LENGTHS = (52, 60)
"""Sizes of a move telegram that an emulated controller accepts, in bytes. Mark: derived (52), observed (60)."""


def _to_word(value: float, per_unit: float, low: int, high: int, what: str) -> int:
    if math.isfinite(value) and low <= (word := round(value * per_unit)) <= high:
        return word
    raise LocalProtocolError(f"{what} {value:g} is outside {low / per_unit:g} … {high / per_unit:g}")


def position_words(position: Sequence[float]) -> Words3:
    """Convert a position, m, to the nearest device words, in units of 0.125 mm.

    Raises LocalProtocolError outside ±4.095875 m.
    """
    x, y, z = position
    steps, limit = layouts.STEPS_PER_METRE, layouts.POSITION_WORD_LIMIT
    return (
        _to_word(x, steps, -limit, limit, "position x in m"),
        _to_word(y, steps, -limit, limit, "position y in m"),
        _to_word(z, steps, -limit, limit, "position z in m"),
    )


def position_from_words(words: Sequence[int]) -> Vector:
    """Convert device words, in units of 0.125 mm, to a position, m."""
    (x, y, z), steps = words, layouts.STEPS_PER_METRE
    return x / steps, y / steps, z / steps


def quaternion_words(quaternion: Sequence[float]) -> Words4:
    """Convert a quaternion w x y z to device words, in units of 1/16384. Raises LocalProtocolError for a component
    beyond ±1.
    """
    w, x, y, z = quaternion
    one = layouts.QUATERNION_ONE
    return (
        _to_word(w, one, -one, one, "quaternion w"),
        _to_word(x, one, -one, one, "quaternion x"),
        _to_word(y, one, -one, one, "quaternion y"),
        _to_word(z, one, -one, one, "quaternion z"),
    )


def quaternion_from_words(words: Sequence[int]) -> Quaternion:
    """Convert device words, in units of 1/16384, to a quaternion w x y z, which is not normalised."""
    (w, x, y, z), one = words, layouts.QUATERNION_ONE
    return w / one, x / one, y / one, z / one


def _without_trailer(words: Sequence[int], exact: Sequence[float]) -> list[int]:
    """Return words whose bytes do not contain DLE ETX. A word that contains or starts DLE ETX is changed by one
    step.

    The changed word is the neighbour nearer to the exact value; if both neighbours are equally near, it is the
    upper one. Each word is therefore less than one step from the exact value, or exactly one step if the original
    word was exact.
    """
    trailer, (first, second) = int.from_bytes(TRAILER, "big"), TRAILER
    high_bytes = [word >> 8 & 0xFF for word in words[1:]]
    return [
        word + (1 if value >= word else -1)
        if word & 0xFFFF == trailer or (word & 0xFF, high) == (first, second)
        else word
        for word, value, high in zip(words, exact, [*high_bytes, 0], strict=True)
    ]


def _expect(telegram: Telegram, function: int, *types: int) -> None:
    if telegram.function != function or telegram.type not in types:
        raise RemoteProtocolError(f"expected function {function}, got {telegram}")


def _flags(names: Mapping[str, int]) -> tuple[tuple[bool, ...], ...]:
    """Return the flags for every value of a byte, in the order of `names`, which gives the bit number of each flag."""
    return tuple(tuple(bool(byte >> bit & 1) for bit in names.values()) for byte in range(256))


_FLAGS_16, _FLAGS_17 = _flags(layouts.FLAG_BITS_16), _flags(layouts.FLAG_BITS_17)


class Status(NamedTuple):
    """Answer to read status: state of the controller, and pose of the tool in the base frame as device words."""

    position_words: Words3
    """Position X Y Z in units of 0.125 mm."""
    quaternion_words: Words4
    """Orientation Q1 … Q4 in units of 1/16384."""
    program: int = 0
    """Number of the current program."""
    instruction: int = 0
    """Number of the current instruction."""
    tcp: int = 0
    """Number of the active TCP."""
    frame: int = 0
    """Number of the active frame."""
    local: bool = False
    interrupt_permitted: bool = False
    programming_unit: bool = False
    """Whether the programming unit is connected."""
    key_auto: bool = False
    """Whether the key switch is in position AUTO."""
    standby: bool = False
    operation: bool = False
    execution: bool = False
    emergency_stop: bool = False

    @property
    def position(self) -> Vector:
        """Tool position in the base frame, m."""
        return position_from_words(self.position_words)

    @property
    def quaternion(self) -> Quaternion:
        """Tool orientation in the base frame, w x y z, as reported. Its norm is 1 within rounding."""
        return quaternion_from_words(self.quaternion_words)

    @classmethod
    def from_telegram(cls, telegram: Telegram) -> Self:
        """Decode a status from an answer. Raises RemoteProtocolError if the answer is incomplete."""
        _expect(telegram, _READ_STATUS, _RESPONSE)
        row = layouts.STATUS.unpack_row(telegram.data)
        program, instruction, tcp, frame, flags_16, flags_17, x, y, z, q1, q2, q3, q4 = row
        flags = _FLAGS_16[flags_16] + _FLAGS_17[flags_17]
        return cls((x, y, z), (q1, q2, q3, q4), program, instruction, tcp, frame, *flags)

    def to_telegram(self) -> Telegram:
        """Encode the status as the controller's answer. Raises LocalProtocolError if a number does not fit into its
        field.
        """
        flags_16, flags_17 = (
            sum(getattr(self, name) << bit for name, bit in bits.items())
            for bits in (layouts.FLAG_BITS_16, layouts.FLAG_BITS_17)
        )
        numbers = self.program, self.instruction, self.tcp, self.frame
        data = layouts.STATUS.pack_row(
            *numbers, flags_16, flags_17, *self.position_words, *self.quaternion_words
        )
        return Telegram(FunctionCode.READ_STATUS, TelegramType.RESPONSE, 0, data, from_robot=True)


class Move(NamedTuple):
    """One telegram of a movement sequence, which consists of a start, any number of points, and an end at the last
    point.
    """

    kind: MoveKind
    position: Vector = (0.0, 0.0, 0.0)
    """Absolute target position of the tool in the base frame, m; zeros in a start."""
    quaternion: Quaternion = (0.0, 0.0, 0.0, 0.0)
    """Target orientation w x y z in the base frame; zeros in a start."""
    velocity: float = 0.0
    """Velocity, m/s."""
    run_speed: float = 1.0
    """Factor by which the velocity is multiplied, 0 … 7.9998."""
    robot_coordinates: bool = False
    """Whether robot coordinates are used instead of rectangular coordinates."""

    def to_telegram(self, move_length: int = 52, *, avoid_trailer: bool = False) -> Telegram:
        """Encode the order as a telegram of `move_length` bytes, with values rounded to device words.

        With `avoid_trailer`, each word of position and orientation that would contain or start DLE ETX is replaced
        by a neighbour. A coordinate then differs from the ordered one by up to one step of 0.125 mm, instead of
        half a step due to rounding. Raises LocalProtocolError if a value is out of range.
        """
        pose: Sequence[int] = (*position_words(self.position), *quaternion_words(self.quaternion))
        if avoid_trailer:
            position = (value * layouts.STEPS_PER_METRE for value in self.position)
            orientation = (value * layouts.QUATERNION_ONE for value in self.quaternion)
            pose = _without_trailer(pose, (*position, *orientation))
        ends = layouts.MOVE_FLAG_ENDS if self.kind is not _POINT else 0
        data = layouts.MOVE.pack_row(
            0,
            ends | (layouts.MOVE_FLAG_ROBOT_COORDINATES if self.robot_coordinates else 0),
            _to_word(self.velocity, layouts.STEPS_PER_METRE, 0, 0xFFFF, "velocity in m/s"),
            _to_word(self.run_speed, layouts.RUN_SPEED_ONE, 0, 0xFFFF, "run speed"),
            *pose,
        ).ljust(move_length - HEADER_SIZE, b"\0")
        return Telegram(_MOVE, _ORDER, self.kind, data)

    @classmethod
    def from_telegram(cls, telegram: Telegram, lengths: Collection[int] = MOVE_LENGTHS) -> Self:
        """Decode a move.

        Raises RemoteProtocolError if the telegram is not a move, has a length that is not accepted, or has an
        unknown suffix.
        """
        _expect(telegram, FunctionCode.MOVE, TelegramType.ORDER)
        length = len(telegram.data) + HEADER_SIZE
        if length not in lengths:
            raise RemoteProtocolError(f"a move of {length} bytes, expected {' or '.join(map(str, lengths))}")
        try:
            kind = MoveKind(telegram.suffix)
        except ValueError as error:
            raise RemoteProtocolError(f"bytes 6–7: move has no suffix {telegram.suffix}") from error
        _, flags, velocity, run_speed, *pose = layouts.MOVE.unpack_row(telegram.data)
        return cls(
            kind,
            position_from_words(pose[:3]),
            quaternion_from_words(pose[3:]),
            velocity / layouts.STEPS_PER_METRE,
            run_speed / layouts.RUN_SPEED_ONE,
            bool(flags & layouts.MOVE_FLAG_ROBOT_COORDINATES),
        )


@dataclass(frozen=True, slots=True)
class ProgramAnswer:
    """Answer to receive program, with all blocks joined."""

    program: int
    """Number of the program."""
    content: bytes
    """Bytes of the program as stored in the controller."""
    error: int = 0
    """Error code; 0 means no error, and the meaning of other values is unknown."""

    @classmethod
    def from_telegram(cls, telegram: Telegram) -> Self:
        """Decode the answer. Raises RemoteProtocolError if the telegram is not such an answer."""
        _expect(telegram, FunctionCode.RECEIVE_PROGRAM, TelegramType.RESPONSE)
        raw = layouts.PROGRAM_ANSWER.unpack(telegram.data)
        return cls(int(raw["program"]), telegram.data[layouts.PROGRAM_ANSWER.size :], int(raw["error"]))

    def to_telegram(self) -> Telegram:
        """Encode the controller's answer, which must then be split into blocks. Raises LocalProtocolError if a
        number exceeds 65535.
        """
        head = layouts.PROGRAM_ANSWER.pack({"error": self.error, "program": self.program})
        function, type_ = FunctionCode.RECEIVE_PROGRAM, TelegramType.RESPONSE
        return Telegram(function, type_, 0, head + self.content, from_robot=True)


@dataclass(frozen=True, slots=True)
class Refusal:
    """Refusal of an order by the controller."""

    code: int

    @property
    def text(self) -> str:
        """Text of the reason for display."""
        return refusal_text(self.code)

    @classmethod
    def from_telegram(cls, telegram: Telegram) -> Self:
        """Decode a refusal. Raises RemoteProtocolError if it is incomplete."""
        _expect(telegram, telegram.function, TelegramType.REFUSAL)
        return cls(int(layouts.REFUSAL.unpack(telegram.data)["code"]))

    def to_telegram(self, order: Telegram) -> Telegram:
        """Encode the controller's refusal of this order. Assumed: its suffix is 0."""
        data = layouts.REFUSAL.pack({"code": self.code})
        return Telegram(order.function, TelegramType.REFUSAL, 0, data, from_robot=True)


@dataclass(frozen=True, slots=True)
class Spontaneous:
    """Unsolicited status or error of the controller."""

    suffix: int
    """Kind of the message, a `SpontaneousKind` if it is known."""
    x: int
    y: int

    @property
    def text(self) -> str:
        """Kind and number in the format of the controller's manuals, "x.y"."""
        kind = suffix_text(FunctionCode.SPONTANEOUS, self.suffix) or f"unknown kind {self.suffix}"
        return f"{kind} {self.x}.{self.y}"

    @classmethod
    def from_telegram(cls, telegram: Telegram) -> Self:
        """Decode an unsolicited telegram. Raises RemoteProtocolError if it is incomplete."""
        _expect(telegram, FunctionCode.SPONTANEOUS, TelegramType.SPONTANEOUS)
        raw = layouts.SPONTANEOUS.unpack(telegram.data)
        return cls(telegram.suffix, int(raw["x"]), int(raw["y"]))

    def to_telegram(self) -> Telegram:
        """Encode the unsolicited message as a telegram."""
        data = layouts.SPONTANEOUS.pack({"x": self.x, "y": self.y})
        return Telegram(
            FunctionCode.SPONTANEOUS, TelegramType.SPONTANEOUS, self.suffix, data, from_robot=True
        )


def write_mode(mode: Mode) -> Telegram:
    """Create the order to change the operation mode."""
    return Telegram(FunctionCode.WRITE_MODE, TelegramType.ORDER, mode)


def start_program(program: int, from_start: bool = True) -> Telegram:
    """Create the order to run a program, from its start or from where it stopped. Raises LocalProtocolError if its
    number exceeds 65535.
    """
    data = layouts.START_PROGRAM.pack({"program": program})
    return Telegram(FunctionCode.START_PROGRAM, TelegramType.ORDER, 0 if from_start else 1, data)


def receive_program(program: int) -> Telegram:
    """Create the query for the bytes of a program. Raises LocalProtocolError if its number exceeds 65535."""
    data = layouts.RECEIVE_PROGRAM.pack({"program": program})
    return Telegram(FunctionCode.RECEIVE_PROGRAM, TelegramType.ORDER, 1, data)
