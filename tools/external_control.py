"""Universal Robots' external control: the messages of a client, and our own program that executes them, for tests.

A program at the controller connects to its client three times, and then executes the messages that it receives. All
values are integers of 32 bits, big-endian. Where the maker's library is run, its own program is used unchanged.

Source: Universal Robots' C++ client library, `control/` and `comm/control_mode.h`.
"""

import re
import struct
from collections.abc import Iterator, Sequence
from enum import IntEnum
from pathlib import Path
from typing import NamedTuple

from protocol.endpoint import RemoteProtocolError

MICRO = 1_000_000
"""Number of message units per 1 of a value, or per second of a point's time."""
TRAJECTORY, COMMANDS, REVERSE, SENDER = 50003, 50004, 50001, 50002
"""Ports of the client, in the order in which the program connects. The last port provides the program's text."""
SERVICES = {TRAJECTORY: "trajectory", COMMANDS: "commands", REVERSE: "reverse", SENDER: "sender"}


class Mode(IntEnum):
    """Mode of an order: the meaning of its values."""

    STOPPED = -2
    IDLE = 0
    SERVOJ = 1
    SPEEDJ = 2
    FORWARD = 3
    SPEEDL = 4
    POSE = 5
    FREEDRIVE = 6
    TOOL_IN_CONTACT = 7
    TORQUE = 8


class Forward(IntEnum):
    """First value of an order in mode forward."""

    CANCEL = -1
    NOTHING = 0
    START = 1
    STREAM_START = 2
    STREAM_END = 3


class Freedrive(IntEnum):
    """First value of an order in mode freedrive."""

    STOP = -1
    NOTHING = 0
    START = 1


class Motion(IntEnum):
    """Kind of a trajectory point."""

    MOVEJ = 0
    MOVEL = 1
    MOVEP = 2
    MOVEC = 3
    OPTIMOVEJ = 4
    OPTIMOVEL = 5
    MOVEJ_POSE = 6
    MOVEL_JOINT = 7
    MOVEP_JOINT = 8
    MOVEC_JOINT = 9
    OPTIMOVEJ_POSE = 12
    OPTIMOVEL_JOINT = 13
    SPLINE = 51


class Spline(IntEnum):
    """Kind of a spline point."""

    CUBIC = 1
    QUINTIC = 2


class Command(IntEnum):
    """Command that is not a motion."""

    ZERO_FTSENSOR = 0
    SET_PAYLOAD = 1
    SET_TOOL_VOLTAGE = 2
    START_FORCE_MODE = 3
    END_FORCE_MODE = 4
    START_TOOL_CONTACT = 5
    END_TOOL_CONTACT = 6
    SET_FRICTION_COMPENSATION = 7
    FT_RTDE_INPUT_ENABLE = 8
    SET_GRAVITY = 9
    SET_TCP_OFFSET = 10
    SET_FRICTION_SCALES = 11
    SET_TARGET_PAYLOAD = 12


class Result(IntEnum):
    """Result of a trajectory. The first two values are also the results of a search for contact."""

    SUCCESS = 0
    CANCELLED = 1
    FAILURE = 2


_ORDER, _POINT, _COMMAND, _RESULT = (struct.Struct(f">{count}i") for count in (8, 21, 28, 1))


class Order(NamedTuple):
    """Message to the reverse port."""

    timeout_ms: int
    """Maximum time until the next message, ms; 0 if there is no limit."""
    values: tuple[int, ...]
    """Six values: joints, speeds or a pose in millionths. In some modes they have another meaning."""
    mode: int

    def encode(self) -> bytes:
        """Encode the message."""
        return _ORDER.pack(self.timeout_ms, *self.values, self.mode)


class Point(NamedTuple):
    """Message to the trajectory port, in SI units."""

    kind: int
    target: tuple[float, ...]
    """Target joints or target pose."""
    other: tuple[float, ...] = (0.0,) * 6
    """Via point of an arc, or speeds of a spline."""
    rest: tuple[float, ...] = (0.0,) * 6
    """Speed and acceleration of a move, or accelerations of a spline."""
    time: float = 0.0
    blend: int = 0
    """Blend radius, µm, or kind of a spline."""

    def encode(self) -> bytes:
        """Encode the message."""
        values = (round(value * MICRO) for value in (*self.target, *self.other, *self.rest))
        return _POINT.pack(*values, round(self.time * MICRO), self.blend, self.kind)


def encode_command(command: Command, *values: float) -> bytes:
    """Encode a message to the command port. Values are in SI units."""
    numbers = [round(value * MICRO) for value in values]
    return _COMMAND.pack(command, *numbers, *(0,) * (27 - len(numbers)))


def read_orders(data: bytes) -> Iterator[Order]:
    """Return all messages to the reverse port. Raises RemoteProtocolError for an incomplete message."""
    for timeout_ms, *values, mode in _rows(_ORDER, data):
        yield Order(timeout_ms, tuple(values), mode)


def read_points(data: bytes) -> Iterator[Point]:
    """Return all messages to the trajectory port. Raises RemoteProtocolError for an incomplete message."""
    for *numbers, time, blend, kind in _rows(_POINT, data):
        values = tuple(number / MICRO for number in numbers)
        yield Point(kind, values[:6], values[6:12], values[12:], time / MICRO, blend)


def read_commands(data: bytes) -> Iterator[tuple[Command, tuple[float, ...]]]:
    """Return all messages to the command port, with their values. Raises RemoteProtocolError for an incomplete
    message.
    """
    for command, *numbers in _rows(_COMMAND, data):
        yield Command(command), tuple(number / MICRO for number in numbers)


def read_results(data: bytes) -> list[Result]:
    """Return the answers of the program. Raises RemoteProtocolError for an incomplete answer."""
    return [Result(value) for (value,) in _rows(_RESULT, data)]


def _rows(layout: struct.Struct, data: bytes) -> Iterator[Sequence[int]]:
    if len(data) % layout.size:
        raise RemoteProtocolError(f"{len(data)} bytes are not a multiple of the message size {layout.size}")
    return layout.iter_unpack(data)


# --- the program

_TEXT = Path(__file__).with_suffix(".script").read_text(encoding="utf-8")
_OPTIMISED = re.compile(r" *elif kind == \d+:\n *optimove.*\n")
_RECORDED = re.compile(rb"def externalControl\(\):\n# (\S+)\nend\n")
_HOST = re.compile(rb'connect_socket_with_retry\("([^"]+)"')


def control_program(
    host: str = "127.0.0.1", lookahead_s: float = 0.03, gain: int = 2000, *, optimised: bool = True
) -> str:
    """Return the program, with its client's address and the settings of servoj.

    If `optimised` is false, the motions that PolyScope 5.21 introduced are left out.
    """
    text = _TEXT if optimised else _OPTIMISED.sub("", _TEXT)
    return text.replace("HOST", host).replace("AHEAD", str(lookahead_s)).replace("GAIN", str(gain))


def recorded_form(text: bytes) -> bytes:
    """Return the short form that replaces a client's program in a transcript."""
    address = _HOST.search(text)
    return b"def externalControl():\n# %s\nend\n" % (address[1] if address else b"127.0.0.1")


def played_form(data: bytes) -> bytes:
    """Return data of a transcript with our program in place of its short form. The controller is older than
    PolyScope 5.21.
    """
    return _RECORDED.sub(lambda short: control_program(short[1].decode(), optimised=False).encode(), data)
