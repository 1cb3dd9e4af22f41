"""Known payloads as typed values in SI units. Source: computer-link specification, section 3."""

import math
from collections.abc import Collection, Mapping, Sequence
from typing import Any, Self, TypeAlias

from protocol.adlp import HEADER_SIZE
from protocol.arap import layouts
from protocol.arap.codes import FunctionCode, Mode, MoveKind, TelegramType, refusal_text, suffix_text
from protocol.arap.telegram import Telegram
from protocol.endpoint import LocalProtocolError, RemoteProtocolError
from protocol.values import dataclass

Vector: TypeAlias = tuple[float, float, float]
Quaternion: TypeAlias = tuple[float, float, float, float]
Words3: TypeAlias = tuple[int, int, int]
Words4: TypeAlias = tuple[int, int, int, int]

MOVE_LENGTHS = (52, 60)
"""Lengths of a move telegram that an emulated controller takes. Mark: derived (52), assumed (60)."""


def _to_word(value: float, per_unit: float, low: int, high: int, what: str) -> int:
    word = round(value * per_unit) if math.isfinite(value) else None
    if word is None or not low <= word <= high:
        raise LocalProtocolError(f"{what} {value:g} is outside {low / per_unit:g} … {high / per_unit:g}")
    return word


def position_words(position: Sequence[float]) -> Words3:
    """Position in m as device words of 0.125 mm, rounded to the nearest.

    Raises LocalProtocolError outside ±4.095875 m.
    """
    limit = layouts.POSITION_WORD_LIMIT
    x, y, z = (
        _to_word(value, layouts.STEPS_PER_METRE, -limit, limit, f"position {axis} in m")
        for axis, value in zip("xyz", position, strict=True)
    )
    return x, y, z


def position_from_words(words: Sequence[int]) -> Vector:
    """Position in m that device words of 0.125 mm mean."""
    x, y, z = (word / layouts.STEPS_PER_METRE for word in words)
    return x, y, z


def round_position(position: Sequence[float]) -> Vector:
    """What the controller understands when it is sent this position, m; errors as `position_words`."""
    return position_from_words(position_words(position))


def quaternion_words(quaternion: Sequence[float]) -> Words4:
    """Quaternion w x y z as device words of 1/16384. Raises LocalProtocolError for a component beyond ±1."""
    one = layouts.QUATERNION_ONE
    w, x, y, z = (
        _to_word(value, one, -one, one, f"quaternion {axis}")
        for axis, value in zip("wxyz", quaternion, strict=True)
    )
    return w, x, y, z


def quaternion_from_words(words: Sequence[int]) -> Quaternion:
    """Quaternion w x y z that device words of 1/16384 mean, not normalised."""
    w, x, y, z = (word / layouts.QUATERNION_ONE for word in words)
    return w, x, y, z


def _pose_values(position: Words3, quaternion: Words4) -> dict[str, float]:
    return dict(zip(("x", "y", "z", "q1", "q2", "q3", "q4"), position + quaternion, strict=True))


def _position_of(raw: Mapping[str, float]) -> Words3:
    return int(raw["x"]), int(raw["y"]), int(raw["z"])


def _quaternion_of(raw: Mapping[str, float]) -> Words4:
    return int(raw["q1"]), int(raw["q2"]), int(raw["q3"]), int(raw["q4"])


def _expect(telegram: Telegram, function: int, *types: int) -> None:
    if telegram.function != function or telegram.type not in types:
        raise RemoteProtocolError(f"expected function {function}, got {telegram}")


_STATUS_NUMBERS = ("program", "instruction", "tcp", "frame")
_STATUS_FLAGS = {"flags_16": layouts.FLAG_BITS_16, "flags_17": layouts.FLAG_BITS_17}


@dataclass(frozen=True, slots=True)
class Status:
    """Answer to read status: state and pose of the tool in the base frame, as device words."""

    position_words: Words3
    """X Y Z, 0.125 mm."""
    quaternion_words: Words4
    """Q1 … Q4, 1/16384."""
    program: int = 0
    """Number of the program."""
    instruction: int = 0
    """Number of the instruction."""
    tcp: int = 0
    """Number of the active TCP."""
    frame: int = 0
    """Number of the active frame."""
    local: bool = False
    interrupt_permitted: bool = False
    programming_unit: bool = False
    """The programming unit is connected."""
    key_auto: bool = False
    """The key stands in AUTO."""
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
        """Tool orientation in the base frame, w x y z, as reported (norm 1 within rounding)."""
        return quaternion_from_words(self.quaternion_words)

    @classmethod
    def from_telegram(cls, telegram: Telegram) -> Self:
        """Raises RemoteProtocolError when the telegram is no complete status answer."""
        _expect(telegram, FunctionCode.READ_STATUS, TelegramType.RESPONSE)
        raw = layouts.STATUS.unpack(telegram.data)
        values: dict[str, Any] = {name: int(raw[name]) for name in _STATUS_NUMBERS}
        for byte, bits in _STATUS_FLAGS.items():
            values |= {name: bool(int(raw[byte]) >> bit & 1) for name, bit in bits.items()}
        return cls(_position_of(raw), _quaternion_of(raw), **values)

    def to_telegram(self) -> Telegram:
        """The controller's answer. Raises LocalProtocolError for a number that its field cannot hold."""
        values = _pose_values(self.position_words, self.quaternion_words)
        values |= {name: getattr(self, name) for name in _STATUS_NUMBERS}
        for byte, bits in _STATUS_FLAGS.items():
            values[byte] = sum(getattr(self, name) << bit for name, bit in bits.items())
        data = layouts.STATUS.pack(values)
        return Telegram(FunctionCode.READ_STATUS, TelegramType.RESPONSE, 0, data, from_robot=True)


@dataclass(frozen=True, slots=True)
class Move:
    """One telegram of a movement sequence: a start, any number of points, an end at the last point."""

    kind: MoveKind
    position: Vector = (0.0, 0.0, 0.0)
    """Absolute target of the tool in the base frame, m; zeros in a start."""
    quaternion: Quaternion = (0.0, 0.0, 0.0, 0.0)
    """Target orientation w x y z; zeros in a start."""
    velocity: float = 0.0
    """m/s"""
    run_speed: float = 1.0
    """Share of the velocity, 0 … 7.9998."""
    robot_coordinates: bool = False
    """Robot coordinates instead of rectangular ones."""

    def to_telegram(self, move_length: int = 52) -> Telegram:
        """The order, `move_length` bytes in all, values rounded to device words.

        Raises LocalProtocolError for a value out of range.
        """
        ends = layouts.MOVE_FLAG_ENDS if self.kind is not MoveKind.POINT else 0
        values = _pose_values(position_words(self.position), quaternion_words(self.quaternion))
        values["flags"] = ends | (layouts.MOVE_FLAG_ROBOT_COORDINATES if self.robot_coordinates else 0)
        values["velocity"] = _to_word(self.velocity, layouts.STEPS_PER_METRE, 0, 0xFFFF, "velocity in m/s")
        values["run_speed"] = _to_word(self.run_speed, layouts.RUN_SPEED_ONE, 0, 0xFFFF, "run speed")
        data = layouts.MOVE.pack(values).ljust(move_length - HEADER_SIZE, b"\0")
        return Telegram(FunctionCode.MOVE, TelegramType.ORDER, self.kind, data)

    @classmethod
    def from_telegram(cls, telegram: Telegram, lengths: Collection[int] = MOVE_LENGTHS) -> Self:
        """Raises RemoteProtocolError for no move, a length that is not accepted or an unknown suffix."""
        _expect(telegram, FunctionCode.MOVE, TelegramType.ORDER)
        length = len(telegram.data) + HEADER_SIZE
        if length not in lengths:
            raise RemoteProtocolError(f"a move of {length} bytes, expected {' or '.join(map(str, lengths))}")
        try:
            kind = MoveKind(telegram.suffix)
        except ValueError as error:
            raise RemoteProtocolError(f"bytes 6–7: move has no suffix {telegram.suffix}") from error
        raw = layouts.MOVE.unpack(telegram.data)
        return cls(
            kind,
            position_from_words(_position_of(raw)),
            quaternion_from_words(_quaternion_of(raw)),
            raw["velocity"] / layouts.STEPS_PER_METRE,
            raw["run_speed"] / layouts.RUN_SPEED_ONE,
            bool(int(raw["flags"]) & layouts.MOVE_FLAG_ROBOT_COORDINATES),
        )


@dataclass(frozen=True, slots=True)
class ProgramAnswer:
    """Answer to receive program, all blocks in one."""

    program: int
    """Number of the program."""
    content: bytes
    """Its bytes as the controller keeps them."""
    error: int = 0
    """0 for none; other values are not known."""

    @classmethod
    def from_telegram(cls, telegram: Telegram) -> Self:
        """Raises RemoteProtocolError when the telegram is no such answer."""
        _expect(telegram, FunctionCode.RECEIVE_PROGRAM, TelegramType.RESPONSE)
        raw = layouts.PROGRAM_ANSWER.unpack(telegram.data)
        return cls(int(raw["program"]), telegram.data[layouts.PROGRAM_ANSWER.size :], int(raw["error"]))

    def to_telegram(self) -> Telegram:
        """The controller's answer, to be split into blocks. Raises LocalProtocolError past 65535."""
        head = layouts.PROGRAM_ANSWER.pack({"error": self.error, "program": self.program})
        function, type_ = FunctionCode.RECEIVE_PROGRAM, TelegramType.RESPONSE
        return Telegram(function, type_, 0, head + self.content, from_robot=True)


@dataclass(frozen=True, slots=True)
class Refusal:
    """The controller's refusal of an order."""

    code: int

    @property
    def text(self) -> str:
        """The reason, for people to read."""
        return refusal_text(self.code)

    @classmethod
    def from_telegram(cls, telegram: Telegram) -> Self:
        """Raises RemoteProtocolError when the telegram is no complete refusal."""
        _expect(telegram, telegram.function, TelegramType.REFUSAL)
        return cls(int(layouts.REFUSAL.unpack(telegram.data)["code"]))

    def to_telegram(self, order: Telegram) -> Telegram:
        """The controller's refusal of this order. Assumed: its suffix is 0."""
        data = layouts.REFUSAL.pack({"code": self.code})
        return Telegram(order.function, TelegramType.REFUSAL, 0, data, from_robot=True)


@dataclass(frozen=True, slots=True)
class Spontaneous:
    """A status or error that the controller tells unasked."""

    suffix: int
    """`SpontaneousKind` where known."""
    x: int
    y: int

    @property
    def text(self) -> str:
        """Kind and number as the controller's manuals write it, "x.y"."""
        kind = suffix_text(FunctionCode.SPONTANEOUS, self.suffix) or f"unknown kind {self.suffix}"
        return f"{kind} {self.x}.{self.y}"

    @classmethod
    def from_telegram(cls, telegram: Telegram) -> Self:
        """Raises RemoteProtocolError when the telegram is no complete spontaneous one."""
        _expect(telegram, FunctionCode.SPONTANEOUS, TelegramType.SPONTANEOUS)
        raw = layouts.SPONTANEOUS.unpack(telegram.data)
        return cls(telegram.suffix, int(raw["x"]), int(raw["y"]))

    def to_telegram(self) -> Telegram:
        """What the controller sends."""
        data = layouts.SPONTANEOUS.pack({"x": self.x, "y": self.y})
        return Telegram(
            FunctionCode.SPONTANEOUS, TelegramType.SPONTANEOUS, self.suffix, data, from_robot=True
        )


def write_mode(mode: Mode) -> Telegram:
    """Order to change the operation mode."""
    return Telegram(FunctionCode.WRITE_MODE, TelegramType.ORDER, mode)


def start_program(program: int, from_start: bool = True) -> Telegram:
    """Order to run a program, from its start or where it stopped. Raises LocalProtocolError past 65535."""
    data = layouts.START_PROGRAM.pack({"program": program})
    return Telegram(FunctionCode.START_PROGRAM, TelegramType.ORDER, 0 if from_start else 1, data)


def receive_program(program: int) -> Telegram:
    """Query of a program's bytes. Raises LocalProtocolError past 65535."""
    data = layouts.RECEIVE_PROGRAM.pack({"program": program})
    return Telegram(FunctionCode.RECEIVE_PROGRAM, TelegramType.ORDER, 1, data)
