"""Packets of Stream Motion: big-endian, without gaps.

Sources: FANUC-CORPORATION/fanuc_driver, fanuc_libs/stream_motion (versions 3 and 4); a dissector and
valstad-shipworks/fanuc_ucl (versions 1 and 2). The number in bytes 14 and 15 of a command is the data style, although
the first source calls it unused: with 0, the controller reads the nine numbers as a pose (observed:
airo-ugent/airo-fanuc).
"""

import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum, IntFlag
from typing import NamedTuple, TypeAlias

from protocol.endpoint import RemoteProtocolError
from protocol.geometry import Wrench

AXES = 9
"""Numbers of a position: six joints, or X Y Z W P R, and three external axes."""
IO_BYTES = 256
CARTESIAN, JOINTS = 0, 0xFFFF
"""Data styles of a command from version 3 on. Assumed: any number but 0 means joints."""
THRESHOLDS = 20
"""Entries of a table of thresholds: for 5, 10 … 100 % of the largest Cartesian speed."""
NO_SENSOR = 0xFFFFFFFF
"""Type of the force sensor of a controller that has none."""
STEP_V1_S = 0.002
"""Resolution of the time stamp of versions 1 and 2, s."""

Nine: TypeAlias = tuple[float, ...]
"""Nine numbers of a position."""


class Kind(IntEnum):
    """Type of a packet. A controller answers a request with the type of the request."""

    START_V1 = 0
    COMMAND_V1 = 1
    STOP = 2
    THRESHOLD = 3
    COMMAND_POSITION = 4
    COMMAND_V2 = 5
    VERSION = 6
    GET_CAPABILITY = 7
    SET_CAPABILITY = 8
    START = 200
    COMMAND = 201
    REPORT = 202
    GPIO = 203
    REPORT_V4 = 204
    FORCE_SENSOR = 205


class Status(IntFlag):
    """Lower four bits of the status byte of a report."""

    READY = 1
    """Ready for commands."""
    RECEIVED = 2
    SYSTEM_READY = 4
    MOVING = 8


class RobotStatus(IntFlag):
    """Robot status of a report, from version 3 on."""

    ERROR = 1
    PENDANT = 2
    EMERGENCY_STOP = 4


class ContactStop(IntEnum):
    """State of the contact stop of a collaborative robot."""

    NONE = 0
    SAFE = 1
    STOP = 2
    DISABLED = 3
    ESCAPE = 4


class Limit(IntEnum):
    """Kind of a threshold."""

    SPEED = 0
    ACCELERATION = 1
    JERK = 2


class Header(NamedTuple):
    """First words of every packet."""

    kind: int
    version: int


class Command(NamedTuple):
    """Set point of a client."""

    version: int
    sequence: int
    position: Nine
    """Joints, degrees, or X Y Z in mm and W P R in degrees; then the external axes."""
    data_style: int = JOINTS
    """Version 3 and later: `CARTESIAN` or any other number for joints. Versions 1 and 2: 0 or 1."""
    is_last: bool = False
    moves: bool = True
    """Whether the position is a set point; otherwise only the I/O is written."""


class Report(NamedTuple):
    """State of the controller."""

    version: int
    sequence: int
    status: int
    """Bits of `Status`, and the packet rate in the upper four bits."""
    time_s: float
    """Time stamp of the controller, s."""
    pose: Nine
    joints: Nine
    currents: Nine = (0.0,) * AXES
    robot_status: int = 0
    contact_stop: int = ContactStop.NONE
    safety_scale: float = 1.0
    wrench: Wrench | None = None
    """Force, N, and moment, N·m; None before version 4."""
    sensor: int = NO_SENSOR


class ThresholdRequest(NamedTuple):
    """Request of the limits of an axis, 1 to 9."""

    version: int
    axis: int
    limit: int


class Threshold(NamedTuple):
    """Limits of an axis without load and with the largest load, by the speed of the tool."""

    version: int
    axis: int
    limit: int
    speed_mm_s: int
    """Largest Cartesian speed, that of the last entry."""
    interval_ms: int
    no_load: tuple[float, ...]
    full_load: tuple[float, ...]


class Capability(NamedTuple):
    """Request or answer of `GET_CAPABILITY` and `SET_CAPABILITY`."""

    kind: int
    version: int
    id: int = 1
    sampling_ms: int = 0
    start_move: int = 0
    """Number of set points that the controller buffers before it moves, 0 to 9."""
    available_version: int = 0
    reports_tcp: int = 0
    """Whether reports contain the tool centre point instead of the face plate."""


class ForceSensor(NamedTuple):
    """Selection of the force sensor."""

    version: int
    reset: int
    sensor: int
    """1: built in, 2: external."""


class GpioLine(NamedTuple):
    """Assignment of I/O to the 256 bytes of commands and reports."""

    command: int = 0
    """0: none, 1: write I/O, 2: read I/O, 3: write a numeric register, 4: read one."""
    io: int = 0
    start: int = 1
    length: int = 0


class GpioResult(NamedTuple):
    """Answer to a GPIO configuration."""

    result: int
    process_time_factor: int


class Signal(NamedTuple):
    """Packet without contents: start, stop, or a request of versions 1 and 2. The answer to `VERSION` has the version
    of the controller.
    """

    kind: int
    version: int


class CommandPosition(NamedTuple):
    """Newest set point of the controller."""

    version: int
    time_s: float
    pose: Nine
    joints: Nine


class GpioRequest(NamedTuple):
    """GPIO configuration of a client."""

    version: int
    lines: tuple[GpioLine, ...]


ToRobot: TypeAlias = Signal | Command | ThresholdRequest | Capability | ForceSensor | GpioRequest
ToClient: TypeAlias = Report | Threshold | Capability | GpioResult | CommandPosition | Signal

_HEADER = struct.Struct(">II")
_COMMAND = struct.Struct(f">IIIBBH{AXES}d{IO_BYTES}x")
_COMMAND_V1, _COMMAND_V2 = struct.Struct(f">IIIBBHHBBHHHH{AXES}f"), struct.Struct(f">IIIBBHHBBHHHH4x{AXES}d")
_COMMAND_POSITION = struct.Struct(f">III{AXES}f{AXES}f")
_REPORT_V1 = struct.Struct(f">IIIBBHHHI{AXES}f{AXES}f{AXES}f")
_REPORT = struct.Struct(f">IIIBBBxI{AXES}f{AXES}f{AXES}ff{IO_BYTES}x")
_REPORT_V4 = struct.Struct(f">IIIBBBxI{AXES}f{AXES}f{AXES}ff6fI{IO_BYTES}x")
_FOUR, _CAPABILITY, _GPIO_RESULT = struct.Struct(">IIII"), struct.Struct(">7I"), struct.Struct(">III")
_THRESHOLD = struct.Struct(f">6I{THRESHOLDS}f{THRESHOLDS}f")
_GPIO_LINES = 32
_GPIO = struct.Struct(f">II{4 * _GPIO_LINES}I")


@dataclass(frozen=True, slots=True)
class _Layout:
    """Size of a packet, and its name in messages."""

    name: str
    size: int


_TO_ROBOT = {
    Kind.START_V1: _Layout("start", _HEADER.size),
    Kind.COMMAND_V1: _Layout("command", _COMMAND_V1.size),
    Kind.COMMAND_V2: _Layout("command", _COMMAND_V2.size),
    Kind.COMMAND_POSITION: _Layout("request of the set point", _HEADER.size),
    Kind.VERSION: _Layout("request of the version", _HEADER.size),
    Kind.STOP: _Layout("stop", _HEADER.size),
    Kind.THRESHOLD: _Layout("threshold request", _FOUR.size),
    Kind.GET_CAPABILITY: _Layout("capability request", _CAPABILITY.size),
    Kind.SET_CAPABILITY: _Layout("capability setting", _CAPABILITY.size),
    Kind.START: _Layout("start", _HEADER.size),
    Kind.COMMAND: _Layout("command", _COMMAND.size),
    Kind.GPIO: _Layout("GPIO configuration", _GPIO.size),
    Kind.FORCE_SENSOR: _Layout("force sensor selection", _FOUR.size),
}
_TO_CLIENT = {
    Kind.START_V1: _Layout("report", _REPORT_V1.size),
    Kind.COMMAND_POSITION: _Layout("set point", _COMMAND_POSITION.size),
    Kind.VERSION: _Layout("version", _HEADER.size),
    Kind.THRESHOLD: _Layout("thresholds", _THRESHOLD.size),
    Kind.GET_CAPABILITY: _Layout("capability", _CAPABILITY.size),
    Kind.SET_CAPABILITY: _Layout("capability", _CAPABILITY.size),
    Kind.REPORT: _Layout("report", _REPORT.size),
    Kind.GPIO: _Layout("GPIO result", _GPIO_RESULT.size),
    Kind.REPORT_V4: _Layout("report", _REPORT_V4.size),
}


_NEW = frozenset(
    (Kind.GET_CAPABILITY, Kind.SET_CAPABILITY, Kind.START, Kind.COMMAND, Kind.GPIO, Kind.FORCE_SENSOR)
)


def is_known(kind: int, version: int) -> bool:
    """Return whether a controller of this version knows packets of a type. Assumed: a newer one knows those of versions
    1 and 2 too.
    """
    if kind in (Kind.COMMAND_V2, Kind.COMMAND_POSITION, Kind.VERSION):
        return version >= 2
    return version >= 3 or kind not in _NEW


def header_of(data: bytes) -> Header:
    """Return type and version of a packet. Raises RemoteProtocolError if it is too short."""
    if len(data) < _HEADER.size:
        raise RemoteProtocolError(f"a packet of {len(data)} bytes, shorter than any of Stream Motion")
    return Header(*_HEADER.unpack_from(data))


def _check(data: bytes, layouts: dict[Kind, _Layout]) -> int:
    """Return the type of a packet. Raises RemoteProtocolError if type or size is invalid."""
    kind = header_of(data).kind
    layout = layouts.get(kind)  # type: ignore[call-overload]
    if layout is None:
        raise RemoteProtocolError(f"a packet of the unknown type {kind}")
    if len(data) != layout.size:
        raise RemoteProtocolError(f"a {layout.name} (type {kind}) of {len(data)} bytes, not {layout.size}")
    return int(kind)


def decode_to_robot(data: bytes) -> ToRobot:
    """Decode a packet of a client. Raises RemoteProtocolError if it is invalid."""
    match kind := _check(data, _TO_ROBOT):
        case Kind.START_V1 | Kind.START | Kind.STOP | Kind.COMMAND_POSITION | Kind.VERSION:
            return Signal(*_HEADER.unpack(data))
        case Kind.COMMAND:
            _, version, sequence, last, moves, style, *position = _COMMAND.unpack(data)
            return Command(version, sequence, tuple(position), style, bool(last), bool(moves))
        case Kind.COMMAND_V1 | Kind.COMMAND_V2:
            layout = _COMMAND_V1 if kind == Kind.COMMAND_V1 else _COMMAND_V2
            _, version, sequence, last, _, _, _, style, _, _, _, _, _, *position = layout.unpack(data)
            return Command(version, sequence, tuple(position), style, bool(last))
        case Kind.THRESHOLD:
            return ThresholdRequest(*_FOUR.unpack(data)[1:])
        case Kind.GET_CAPABILITY | Kind.SET_CAPABILITY:
            return Capability(*_CAPABILITY.unpack(data))
        case Kind.FORCE_SENSOR:
            return ForceSensor(*_FOUR.unpack(data)[1:])
        case _:
            _, version, *words = _GPIO.unpack(data)
            lines = (GpioLine(*words[k : k + 4]) for k in range(0, len(words), 4))
            return GpioRequest(version, tuple(lines))


def encode_to_robot(packet: ToRobot) -> bytes:
    """Encode a packet for the controller, in the layout of its version."""
    match packet:
        case Signal(kind, version):
            if kind == Kind.START and version < 3:
                kind = Kind.START_V1
            return _HEADER.pack(kind, version)
        case Command():
            return _encode_command(packet)
        case ThresholdRequest():
            return _FOUR.pack(Kind.THRESHOLD, *packet)
        case Capability():
            return _CAPABILITY.pack(*packet)
        case ForceSensor():
            return _FOUR.pack(Kind.FORCE_SENSOR, *packet)
        case GpioRequest(version, lines):
            padded = (*lines, *(GpioLine(),) * (_GPIO_LINES - len(lines)))
            return _GPIO.pack(Kind.GPIO, version, *(word for line in padded for word in line))


def _encode_command(command: Command) -> bytes:
    version, sequence, position, style, last, moves = command
    if version >= 3:
        return _COMMAND.pack(Kind.COMMAND, version, sequence, last, moves, style, *position)
    kind, layout = (Kind.COMMAND_V1, _COMMAND_V1) if version == 1 else (Kind.COMMAND_V2, _COMMAND_V2)
    style = min(style, 1)
    return layout.pack(kind, version, sequence, last, 0, 0, 0, style, 0, 0, 0, 0, 0xFFFF, *position)


def decode_to_client(data: bytes) -> ToClient:
    """Decode a packet of the controller. Raises RemoteProtocolError if it is invalid."""
    match _check(data, _TO_CLIENT):
        case Kind.START_V1:
            _, version, sequence, status, _, _, _, _, stamp, *values = _REPORT_V1.unpack(data)
            pose, joints, currents = _nines(values)
            return Report(version, sequence, status, stamp / 1e3, pose, joints, currents)
        case Kind.REPORT:
            return _report(_REPORT.unpack(data), None)
        case Kind.REPORT_V4:
            *most, a, b, c, d, e, f, sensor = _REPORT_V4.unpack(data)
            return _report(most, (a, b, c, d, e, f))._replace(sensor=sensor)
        case Kind.THRESHOLD:
            _, version, axis, limit, speed, interval, *tables = _THRESHOLD.unpack(data)
            return Threshold(
                version, axis, limit, speed, interval, tuple(tables[:THRESHOLDS]), tuple(tables[THRESHOLDS:])
            )
        case Kind.GPIO:
            return GpioResult(*_GPIO_RESULT.unpack(data)[1:])
        case Kind.VERSION:
            return Signal(*_HEADER.unpack(data))
        case Kind.COMMAND_POSITION:
            _, version, stamp, *values = _COMMAND_POSITION.unpack(data)
            return CommandPosition(version, stamp / 1e3, tuple(values[:AXES]), tuple(values[AXES:]))
        case _:
            return Capability(*_CAPABILITY.unpack(data))


def _report(values: Sequence[float], wrench: Wrench | None) -> Report:
    _, version, sequence, status, robot_status, contact_stop, stamp, *numbers = values
    pose, joints, currents = _nines(numbers)
    scale = numbers[3 * AXES]
    return Report(
        int(version), int(sequence), int(status), stamp / 1e3, pose, joints, currents, int(robot_status),
        int(contact_stop), scale, wrench,
    )  # fmt: skip


def _nines(values: Sequence[float]) -> tuple[Nine, Nine, Nine]:
    return tuple(values[:AXES]), tuple(values[AXES : 2 * AXES]), tuple(values[2 * AXES : 3 * AXES])


def encode_to_client(packet: ToClient) -> bytes:
    """Encode a packet for a client, in the layout of its version."""
    match packet:
        case Report():
            return _encode_report(packet)
        case Threshold(version, axis, limit, speed, interval, no_load, full_load):
            return _THRESHOLD.pack(
                Kind.THRESHOLD, version, axis, limit, speed, interval, *no_load, *full_load
            )
        case Capability():
            return _CAPABILITY.pack(*packet)
        case GpioResult():
            return _GPIO_RESULT.pack(Kind.GPIO, *packet)
        case Signal():
            return _HEADER.pack(*packet)
        case CommandPosition(version, time_s, pose, joints):
            stamp = round(time_s * 1e3) & 0xFFFFFFFF
            return _COMMAND_POSITION.pack(Kind.COMMAND_POSITION, version, stamp, *pose, *joints)


def _encode_report(report: Report) -> bytes:
    numbers = (*report.pose, *report.joints, *report.currents)
    stamp = round(report.time_s * 1e3) & 0xFFFFFFFF
    sequence = report.sequence & 0xFFFFFFFF
    if report.version < 3:
        stamp -= stamp % round(STEP_V1_S * 1e3)
        return _REPORT_V1.pack(
            Kind.START_V1, report.version, sequence, report.status, 0, 0, 0, 0, stamp, *numbers
        )
    head = (report.version, sequence, report.status, report.robot_status, report.contact_stop, stamp)
    if report.version == 3:
        return _REPORT.pack(Kind.REPORT, *head, *numbers, report.safety_scale)
    wrench = report.wrench or (0.0,) * 6
    return _REPORT_V4.pack(Kind.REPORT_V4, *head, *numbers, report.safety_scale, *wrench, report.sensor)


def nine(values: Sequence[float]) -> Nine:
    """Return six numbers with zeros for the external axes."""
    return (*values, *(0.0,) * (AXES - len(values)))


def is_finite(values: Sequence[float]) -> bool:
    """Return whether all numbers are finite."""
    return all(map(math.isfinite, values))
