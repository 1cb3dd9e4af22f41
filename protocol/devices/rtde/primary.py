"""Packets of the primary and the secondary interface: a controller's state ten times per second, and its messages.

All numbers are big-endian. A packet consists of its total length, its type, and a body. The body of a state is a
sequence of sub-packages in the same format. A message has a time, a source and a kind. A text that extends to the
end of its packet has no length field.

Source: Universal Robots' C++ client library, `primary/` with the frames of its parser's tests, and python-urx's
`ursecmon.py` for joints, tool and cartesian data.
"""

import struct
from collections.abc import Iterator, Mapping, Sequence
from enum import IntEnum
from functools import lru_cache
from typing import NamedTuple

from protocol.endpoint import RemoteProtocolError
from protocol.fields import Field, Layout
from protocol.marks import Mark

HEADER = struct.Struct(">IB")
"""Header of a packet or sub-package: its length including the header, in bytes, and its type."""
LONGEST = 1 << 16
"""Maximum number of bytes in a packet. Chosen: a state has about 1 400."""
STATE_PERIOD_S = 0.1
"""Time between two states, s. Observed: states are sent at 10 Hz."""


class PacketType(IntEnum):
    """Type of a packet."""

    STATE = 16
    MESSAGE = 20


class Part(IntEnum):
    """Type of a sub-package of a state."""

    ROBOT_MODE = 0
    JOINTS = 1
    TOOL = 2
    MASTERBOARD = 3
    CARTESIAN = 4
    KINEMATICS = 5
    CONFIGURATION = 6
    FORCE_MODE = 7
    ADDITIONAL = 8


class MessageKind(IntEnum):
    """Kind of a message."""

    TEXT = 0
    POPUP = 2
    VERSION = 3
    SAFETY_MODE = 5
    ERROR_CODE = 6
    KEY = 7
    RUNTIME_EXCEPTION = 10


class ReportLevel(IntEnum):
    """Severity of an error code."""

    INFO = 1
    WARNING = 2
    VIOLATION = 3
    FAULT = 4


class Message(NamedTuple):
    """A message without its packet's header."""

    time_ns: int
    """Time on the controller's clock, ns. Derived: with this unit, the time in a frame of URSim is 25.6 s."""
    source: int
    kind: int
    """Kind of the message: a `MessageKind`, or a number without a known meaning."""
    body: bytes


NO_SOURCE = 255
"""Source of a message that does not come from a part of a program, −1 as an unsigned byte. Assumed."""
SUDDEN_CHANGE = 204
"""Code of a protective stop caused by a sudden change of the target. Source: users of the vendor's forum."""
ORDERED = 209
"""Code of a protective stop triggered by a program. Source: tests of the C++ client library."""
NO_CODE = 0
"""Code reported for all other protective stops. Assumed: their actual codes are unknown."""
READ_ONLY = 210
"""Code of the error that is reported when a program is sent in local control. Source: the C++ client library."""


def _row(name: str, *columns: tuple[str, str, str]) -> Layout:
    """Create a layout of consecutive fields from the name, `struct` character and unit of each field."""
    fields, at = list[Field](), 0
    for field, code, unit in columns:
        fields.append(Field(field, at, code, Mark.OBSERVED, unit=unit))
        at += struct.calcsize(f">{code}")
    return Layout(name, at, ">", tuple(fields))


def _per_joint(name: str, code: str, unit: str) -> tuple[tuple[str, str, str], ...]:
    """Return one column for each joint, starting at the base."""
    return tuple((f"{name}{joint}", code, unit) for joint in range(6))


def _pose(name: str) -> tuple[tuple[str, str, str], ...]:
    """Return the fields of a position and a rotation vector."""
    place = [(f"{name}{axis}", "d", "m") for axis in "xyz"]
    return (*place, *((f"{name}r{axis}", "d", "rad") for axis in "xyz"))


_FLAGS = ("real_robot", "enabled", "powered", "emergency_stopped", "protective_stopped", "running", "paused")
_JOINT = (
    ("q", "d", "rad"),
    ("q_target", "d", "rad"),
    ("qd", "d", "rad/s"),
    ("current", "f", "A"),
    ("voltage", "f", "V"),
    ("motor_temperature", "f", "°C"),
    ("micro_temperature", "f", "°C"),
    ("mode", "B", ""),
)

ROBOT_MODE = _row(
    "robot mode",
    ("timestamp", "Q", "ns"),
    *((flag, "B", "") for flag in _FLAGS),
    ("robot_mode", "b", ""),
    ("control_mode", "B", ""),
    ("target_speed_fraction", "d", ""),
    ("speed_scaling", "d", ""),
    ("target_speed_fraction_limit", "d", ""),
    ("reserved", "B", ""),
)
JOINTS = _row(
    "joints",
    *((f"{name}{joint}", code, unit) for joint in range(6) for name, code, unit in _JOINT),
)
TOOL = _row(
    "tool",
    ("input_range2", "B", ""),
    ("input_range3", "B", ""),
    ("input2", "d", "A or V"),
    ("input3", "d", "A or V"),
    ("voltage_48v", "f", "V"),
    ("output_voltage", "B", "V"),
    ("current", "f", "A"),
    ("temperature", "f", "°C"),
    ("mode", "B", ""),
)
MASTERBOARD = _row(
    "masterboard",
    ("digital_inputs", "I", ""),
    ("digital_outputs", "I", ""),
    ("input_range0", "B", ""),
    ("input_range1", "B", ""),
    ("input0", "d", "A or V"),
    ("input1", "d", "A or V"),
    ("output_domain0", "B", ""),
    ("output_domain1", "B", ""),
    ("output0", "d", "A or V"),
    ("output1", "d", "A or V"),
    ("temperature", "f", "°C"),
    ("voltage_48v", "f", "V"),
    ("robot_current", "f", "A"),
    ("io_current", "f", "A"),
    ("safety_mode", "B", ""),
    ("reduced", "B", ""),
    ("euromap67", "B", ""),
    ("reserved0", "I", ""),
    ("mode_selector", "B", ""),
    ("enabling_device", "B", ""),
    ("reserved1", "B", ""),
)
CARTESIAN = _row("cartesian", *_pose(""), *_pose("tcp_"))
_DH = ("theta", "a", "d", "alpha")
_UNITS = {"theta": "rad", "a": "m", "d": "m", "alpha": "rad"}
KINEMATICS = _row(
    "kinematics",
    *_per_joint("checksum", "I", ""),
    *(column for name in _DH for column in _per_joint(name, "d", _UNITS[name])),
    ("calibration", "I", ""),
)
CONFIGURATION = _row(
    "configuration",
    *((f"{end}{joint}", "d", "rad") for joint in range(6) for end in ("lower", "upper")),
    *(
        (f"{name}{joint}", "d", unit)
        for joint in range(6)
        for name, unit in (("speed_limit", "rad/s"), ("acceleration_limit", "rad/s²"))
    ),
    ("joint_speed", "d", "rad/s"),
    ("joint_acceleration", "d", "rad/s²"),
    ("tool_speed", "d", "m/s"),
    ("tool_acceleration", "d", "m/s²"),
    ("equivalent_radius", "d", "m"),
    *(column for name in ("a", "d", "alpha", "theta") for column in _per_joint(name, "d", _UNITS[name])),
    ("masterboard_version", "i", ""),
    ("box_type", "i", ""),
    ("robot_type", "i", ""),
    ("robot_sub_type", "i", ""),
)
FORCE_MODE = _row(
    "force mode",
    *((f"f{axis}", "d", "N") for axis in "xyz"),
    *((f"m{axis}", "d", "N·m") for axis in "xyz"),
    ("dexterity", "d", ""),
)
ADDITIONAL = _row(
    "additional",
    ("teach_button", "B", ""),
    ("teach_enabled", "B", ""),
    ("io_teach_enabled", "B", ""),
    ("reserved", "B", ""),
)
PARTS = {
    Part.ROBOT_MODE: ROBOT_MODE,
    Part.JOINTS: JOINTS,
    Part.CARTESIAN: CARTESIAN,
    Part.KINEMATICS: KINEMATICS,
    Part.MASTERBOARD: MASTERBOARD,
    Part.TOOL: TOOL,
    Part.CONFIGURATION: CONFIGURATION,
    Part.FORCE_MODE: FORCE_MODE,
    Part.ADDITIONAL: ADDITIONAL,
}
"""Layouts of the sub-packages of the newest version, in the order in which a state contains them."""
_E_SERIES = 5
_ADDED: Mapping[tuple[Part, str], tuple[int, int]] = {
    (Part.ROBOT_MODE, "target_speed_fraction_limit"): (3, 2),
    (Part.ROBOT_MODE, "reserved"): (3, 5),
    (Part.CARTESIAN, "tcp_x"): (3, 2),
    (Part.MASTERBOARD, "mode_selector"): (3, 2),
    (Part.MASTERBOARD, "reserved1"): (3, 5),
}
"""First CB3 version that sends a field and the fields after it. Every e-Series version sends all fields.

Source: ROS's ur_modern_driver and its successor, `robot_mode.h` (bodies of 33, 41 and 42 bytes) and
`master_board.h` (`V3_0__1`, `V3_2`); python-urx's `ursecmon.py` for cartesian data. Assumed: the last byte of the
masterboard was introduced together with the last byte of the robot mode.
"""
_SINCE_3_2 = frozenset({Part.FORCE_MODE, Part.ADDITIONAL})
"""Sub-packages that versions 3.0 and 3.1 do not send. Source: python-urx, which reads them from version 3.2 on."""


@lru_cache(maxsize=16)
def parts_of(version: tuple[int, ...]) -> Mapping[Part, Layout]:
    """Return the layouts of the sub-packages of a controller with this version."""
    layouts = dict[Part, Layout]()
    for part, layout in PARTS.items():
        if version[0] >= _E_SERIES or version[:2] >= (3, 2) or part not in _SINCE_3_2:
            layouts[part] = _truncate(part, layout, version)
    return layouts


def _truncate(part: Part, layout: Layout, version: tuple[int, ...]) -> Layout:
    """Return the layout with only the fields that this version sends."""
    for at, field in enumerate(layout.fields):
        since = _ADDED.get((part, field.name))
        if since is not None and version[0] < _E_SERIES and version[:2] < since:
            return Layout(layout.name, field.offset, layout.byte_order, layout.fields[:at])
    return layout


def encode(kind: int, body: bytes) -> bytes:
    """Encode a packet, or a sub-package of a state."""
    return HEADER.pack(HEADER.size + len(body), kind) + body


def split(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Split data into packets, as pairs of type and body. If the data is the body of a state, return its
    sub-packages.

    Raises RemoteProtocolError if a length is invalid.
    """
    at = 0
    while at < len(data):
        if len(data) - at < HEADER.size:
            raise RemoteProtocolError(f"{len(data) - at} bytes are fewer than a packet's header")
        length, kind = HEADER.unpack_from(data, at)
        if not HEADER.size <= length <= min(LONGEST, len(data) - at):
            raise RemoteProtocolError(f"a packet of {length} bytes among {len(data) - at}")
        yield kind, data[at + HEADER.size : at + length]
        at += length


_MESSAGE = struct.Struct(">QBB")
_CODE = (("code", "i", ""), ("argument", "i", ""))
_DATA = (("data_type", "I", ""), ("data", "I", ""))


class Body(NamedTuple):
    """Format of a message's body: a layout, a short text, another layout, and a text up to the end."""

    before: Layout
    title: str = ""
    """Name of the short text; empty if there is none."""
    behind: Layout = Layout("", 0, ">", ())
    text: str = "text"


BODIES: Mapping[int, Body] = {
    MessageKind.TEXT: Body(_row("text message")),
    MessageKind.POPUP: Body(
        _row(
            "pop-up",
            ("request", "I", ""),
            ("request_type", "?", ""),
            ("warning", "?", ""),
            ("error", "?", ""),
            ("blocking", "?", ""),
        ),
        "title",
    ),
    MessageKind.VERSION: Body(
        _row("version"),
        "project",
        _row("version", ("major", "B", ""), ("minor", "B", ""), ("bugfix", "i", ""), ("build", "i", "")),
        "built",
    ),
    MessageKind.SAFETY_MODE: Body(_row("safety mode", *_CODE, ("safety_mode", "B", ""), *_DATA)),
    MessageKind.ERROR_CODE: Body(_row("error code", *_CODE, ("level", "i", ""), *_DATA)),
    MessageKind.KEY: Body(_row("key message", *_CODE), "title"),
    MessageKind.RUNTIME_EXCEPTION: Body(_row("runtime exception", ("line", "i", ""), ("column", "i", ""))),
}
"""Body format of each known message. Source: the C++ client library; python-urx for a pop-up."""


def encode_body(kind: MessageKind, *values: float, title: str = "", text: str = "") -> bytes:
    """Encode the body of a message from the values of all fields, in order."""
    form = BODIES[kind]
    count = len(form.before.fields)
    short = title.encode("ascii", "replace")[:255]
    return b"".join(
        (
            form.before.pack_row(*values[:count]),
            bytes((len(short),)) + short if form.title else b"",
            form.behind.pack_row(*values[count:]),
            text.encode("utf-8", "replace"),
        )
    )


class ReadBody(NamedTuple):
    """Decoded body of a message."""

    fields: tuple[tuple[Field, float], ...]
    texts: tuple[tuple[str, str], ...]
    """Texts of the message by name."""


def read_body(message: Message) -> ReadBody | None:
    """Decode the fields and texts of a message; None if its kind is unknown.

    Raises RemoteProtocolError if the body is too short.
    """
    form = BODIES.get(message.kind)
    if form is None:
        return None
    rest, values, texts = message.body, list[tuple[Field, float]](), list[tuple[str, str]]()
    for layout, title in ((form.before, form.title), (form.behind, "")):
        raw = layout.unpack(rest)
        values += ((field, raw[field.name]) for field in layout.fields)
        rest = rest[layout.size :]
        if title:
            if not rest or len(rest) <= rest[0]:
                raise RemoteProtocolError(f"the {title} of a message is truncated")
            texts.append((title, rest[1 : 1 + rest[0]].decode("ascii", "replace")))
            rest = rest[1 + rest[0] :]
    texts.append((form.text, rest.decode("utf-8", "replace")))
    return ReadBody(tuple(values), tuple(texts))


def encode_message(message: Message) -> bytes:
    """Encode a message as a packet."""
    head = _MESSAGE.pack(message.time_ns & (1 << 64) - 1, message.source, message.kind)
    return encode(PacketType.MESSAGE, head + message.body)


def read_message(body: bytes) -> Message:
    """Decode a message from the body of its packet. Raises RemoteProtocolError if the body is too short."""
    if len(body) < _MESSAGE.size:
        raise RemoteProtocolError(f"a message of {len(body)} bytes is shorter than its head")
    time_ns, source, kind = _MESSAGE.unpack_from(body)
    return Message(time_ns, source, kind, body[_MESSAGE.size :])


def version_body(version: Sequence[int], built: str) -> bytes:
    """Encode the body of a version message: major, minor, bugfix and build number of the controller's software, and
    its build date.
    """
    return encode_body(MessageKind.VERSION, *version, title="URControl", text=built)


def key_body(title: str, text: str) -> bytes:
    """Encode the body of a key message: a key, such as `PROGRAM_XXX_STARTED`, and a text, such as the name of a
    program.
    """
    return encode_body(MessageKind.KEY, 0, 0, title=title, text=text)


def runtime_exception_body(line: int, column: int, text: str) -> bytes:
    """Encode the body of a runtime exception: line and column of an error in a program, counted from 1, and its
    text.
    """
    return encode_body(MessageKind.RUNTIME_EXCEPTION, line, column, text=text)


def safety_mode_body(mode: int) -> bytes:
    """Encode the body of a safety mode message that reports the start of a safety mode, without a code."""
    return encode_body(MessageKind.SAFETY_MODE, 0, 0, mode, 0, 0)


def error_body(code: int, argument: int, level: ReportLevel, text: str = "") -> bytes:
    """Encode the body of an error message, C`code`A`argument`."""
    return encode_body(MessageKind.ERROR_CODE, code, argument, level, 0, 0, text=text)


def popup_body(title: str, text: str) -> bytes:
    """Encode the body of a pop-up that needs no response."""
    return encode_body(MessageKind.POPUP, 0, False, False, False, False, title=title, text=text)
