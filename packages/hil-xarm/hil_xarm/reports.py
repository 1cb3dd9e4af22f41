"""Reports of the control box on TCP ports 30000 to 30003: packed fields, the size first.

Integers are big-endian, floating-point numbers little-endian. One table of fields gives encoder, decoder and the
description of each report. Source: xArm-Developer/xArm-Python-SDK d911319c, `xarm/x3/report.py`.
"""

import struct
from collections.abc import Iterator, Mapping, Sequence
from enum import StrEnum
from typing import NamedTuple, TypeAlias

from protocol.endpoint import RemoteProtocolError

Values: TypeAlias = Mapping[str, Sequence[float]]
"""Values of a report by field; each field has a sequence."""

_SIZE_MAX = 4096
"""Largest size of a report that is read, bytes. Chosen."""


class Port(StrEnum):
    """TCP port of the control box."""

    COMMAND = "command"
    REAL = "real"
    NORMAL = "normal"
    RICH = "rich"
    RT = "rt"


NUMBERS: Mapping[Port, int] = {
    Port.COMMAND: 502,
    Port.REAL: 30003,
    Port.NORMAL: 30001,
    Port.RICH: 30002,
    Port.RT: 30000,
}
"""TCP ports of a real control box."""


class Field(NamedTuple):
    """Field of a report."""

    name: str
    code: str
    """Code of the elements, as for `struct`."""
    length: int = 1
    unit: str = ""


class Layout:
    """Fields of one report."""

    def __init__(self, name: str, fields: Sequence[Field]) -> None:
        self.name, self.fields = name, tuple(fields)
        self._codecs = [
            (field, struct.Struct(f"{'<' if field.code == 'f' else '>'}{field.length}{field.code}"))
            for field in self.fields
        ]
        self.size = sum(codec.size for _, codec in self._codecs)
        """Size of the report, bytes."""

    def encode(self, values: Values) -> bytes:
        """Return a report. A field without a value is zero."""
        parts = []
        for field, codec in self._codecs:
            given = values.get(field.name) or (0,) * field.length
            parts.append(codec.pack(*((self.size,) if field.name == "size" else given)))
        return b"".join(parts)

    def decode(self, data: bytes) -> dict[str, tuple[float, ...]]:
        """Return the values of a report by field. Raises RemoteProtocolError for a report of another size."""
        if len(data) < self.size:
            raise RemoteProtocolError(f"a report of {len(data)} bytes in place of {self.size}")
        values, at = {}, 0
        for field, codec in self._codecs:
            values[field.name] = codec.unpack_from(data, at)
            at += codec.size
        return values


_COMMON = (
    Field("size", "I", unit="bytes"),
    Field("state_mode", "B"),
    Field("queue", "H"),
    Field("joints", "f", 7, "rad"),
    Field("pose", "f", 6, "mm, rad"),
    Field("torques", "f", 7, "N·m"),
)
_FORCES = (Field("external", "f", 6, "N, N·m"), Field("raw", "f", 6, "N, N·m"))
_STATUS = (
    Field("brakes", "B"),
    Field("enabled", "B"),
    Field("error", "B"),
    Field("warning", "B"),
    Field("tcp_offset", "f", 6, "mm, rad"),
    Field("load", "f", 4, "kg, mm"),
    Field("collision", "B"),
    Field("teach", "B"),
)
_GRAVITY = (Field("gravity", "f", 3),)
_BOX = (
    Field("type", "B"),
    Field("axes", "B"),
    Field("ids", "B", 4),
    Field("version", "B", 30),
    Field("tcp_limits", "f", 5, "mm, s"),
    Field("joint_limits", "f", 5, "rad, s"),
    Field("turn_limits", "f", 2, "rad, s"),
    Field("joint_status", "B", 14),
    Field("tool_status", "B", 2),
    Field("temperatures", "b", 7, "°C"),
    Field("tcp_speed", "f", 1, "mm/s"),
    Field("joint_speeds", "f", 7, "rad/s"),
    Field("counter", "I"),
    Field("world_offset", "f", 6, "mm, rad"),
    Field("io_reset", "B", 2),
    Field("simulated", "B"),
    Field("self_collision", "B"),
    Field("collision_tool", "B"),
    Field("collision_tool_size", "f", 6, "mm"),
    Field("voltages", "H", 7, "0.01 V"),
    Field("currents", "f", 7, "A"),
    Field("io_status", "B", 2),
    Field("io", "H", 8),
    Field("io_functions", "B", 32),
    *_FORCES,
    Field("identification", "B"),
    Field("axis_angle", "f", 3, "rad"),
    Field("configuration", "B"),
    Field("reduced", "B"),
    Field("reduced_boundary", "h", 6, "mm"),
    Field("reduced_speeds", "f", 2, "mm/s, rad/s"),
    Field("reduced_ranges", "f", 14, "rad"),
    Field("fence", "B"),
    Field("rebound", "B"),
    Field("io_alarm", "I"),
    Field("switches", "B"),
    Field("device", "B", 2),
    Field("device_values", "h", 3),
)
_RT = (
    Field("size", "I", unit="bytes"),
    Field("time", "Q"),
    Field("state_mode", "B"),
    Field("queue", "H"),
    Field("reserved_1", "B", 17),
    Field("target_joints", "f", 7, "rad"),
    Field("target_joint_speeds", "f", 7, "rad/s"),
    Field("target_joint_accelerations", "f", 7, "rad/s²"),
    Field("joints", "f", 7, "rad"),
    Field("joint_speeds", "f", 7, "rad/s"),
    Field("joint_accelerations", "f", 7, "rad/s²"),
    Field("currents", "f", 7, "A"),
    Field("torques", "f", 7, "N·m"),
    Field("reserved_2", "f", 42),
    Field("target_pose", "f", 6, "mm, rad"),
    Field("target_speed", "f", 6, "mm/s, rad/s"),
    Field("pose", "f", 6, "mm, rad"),
    Field("speed", "f", 6, "mm/s, rad/s"),
    Field("tcp_torque", "f", 6, "N, N·m"),
    Field("target_acceleration", "f", 6, "mm/s², rad/s²"),
    Field("acceleration", "f", 6, "mm/s², rad/s²"),
    Field("reserved_3", "f", 24),
    Field("raw", "f", 6, "N, N·m"),
    Field("external", "f", 6, "N, N·m"),
    Field("device", "B", 2),
    Field("device_values", "h", 3),
    Field("reserved_4", "B", 40),
    Field("io", "h", 10),
)

PLAIN = Layout("real report without forces", _COMMON)
REAL = Layout("real report", (*_COMMON, *_FORCES))
NORMAL_OLD = Layout("normal report without gravity", (*_COMMON, *_STATUS))
NORMAL = Layout("normal report", (*_COMMON, *_STATUS, *_GRAVITY))
RICH = Layout("rich report", (*_COMMON, *_STATUS, *_GRAVITY, *_BOX))
RT = Layout("RT report", _RT)
LAYOUTS: Mapping[int, Layout] = {
    layout.size: layout for layout in (PLAIN, REAL, NORMAL_OLD, NORMAL, RICH, RT)
}
"""Known reports by their size, bytes."""


class ReportReader:
    """Splitter of the byte stream of one port into reports. As the maker's client, it accepts one size only.

    Nothing marks the end of a report. Data that begin with the size while a report is incomplete are the begin of the
    next one: the box sends each report at once, and no number in a report has these bytes.
    """

    def __init__(self) -> None:
        self._buffer, self._size = b"", 0
        self.cut = 0
        """Number of reports that were cut off."""

    def feed(self, data: bytes) -> Iterator[bytes]:
        """Yield each complete report. Raises RemoteProtocolError for a size that is impossible or has changed; the
        bytes received so far are then dropped.
        """
        if self._buffer and self._size and data[:4] == self._size.to_bytes(4, "big"):
            self._buffer, self.cut = b"", self.cut + 1
        self._buffer += data
        while len(self._buffer) >= 4:
            size = int.from_bytes(self._buffer[:4], "big")
            if not PLAIN.size <= size <= _SIZE_MAX or (self._size and size != self._size):
                self._buffer = b""
                raise RemoteProtocolError(f"a report with the size {size}")
            if len(self._buffer) < size:
                return
            self._size = size
            report, self._buffer = self._buffer[:size], self._buffer[size:]
            yield report


def reports_in(data: bytes) -> list[bytes]:
    """Split the bytes of a port into reports; a rest that is no report is one piece."""
    pieces = []
    while len(data) >= 4 and 4 <= (size := int.from_bytes(data[:4], "big")) <= len(data):
        pieces.append(data[:size])
        data = data[size:]
    return [*pieces, data] if data else pieces
