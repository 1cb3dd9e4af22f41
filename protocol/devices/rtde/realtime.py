"""Packets of the real-time interface: a controller's state in each of its cycles, without negotiation.

All numbers are big-endian. A packet consists of its total length and doubles; two sets of bits are 64-bit integers.
Newer versions append fields, so the length identifies the fields that are present.

Source: Universal Robots' manual of the interface, RealTime 5.9 and 5.10, with its note on the bits. Lengths by
version: a user's table of the older manuals (UR5arm_ReubenPython2and3Class), and ROS's ur_modern_driver,
`rt_state.h`.
"""

import struct
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from typing import NamedTuple

from protocol.devices.rtde.fields import CODES, NEVER, OUTPUTS, Number
from protocol.endpoint import RemoteProtocolError
from protocol.fields import Field, Layout
from protocol.marks import Mark

HEADER = struct.Struct(">I")
"""Header of a packet: the length of the packet including its header, in bytes."""
_BITS = ("actual_digital_input_bits", "actual_digital_output_bits")
_E_SERIES = 5


class Group(NamedTuple):
    """Fields that a version has added."""

    since: Number
    """First e-Series version that sends these fields."""
    since_cb3: Number
    names: tuple[str, ...]
    """Names of the equivalent RTDE outputs. An integer represents this number of doubles without a published
    meaning.
    """


GROUPS: tuple[Group, ...] = (
    Group(
        (0, 0, 0),
        (3, 0, 0),
        (
            "timestamp",
            "target_q",
            "target_qd",
            "target_qdd",
            "target_current",
            "target_moment",
            "actual_q",
            "actual_qd",
            "actual_current",
            "joint_control_output",
            "actual_TCP_pose",
            "actual_TCP_speed",
            "actual_TCP_force",
            "target_TCP_pose",
            "target_TCP_speed",
            "actual_digital_input_bits",
            "joint_temperatures",
            "actual_execution_time",
            "1",
            "robot_mode",
            "joint_mode",
            "safety_mode",
            "6",
            "actual_tool_accelerometer",
            "6",
            "speed_scaling",
            "actual_momentum",
            "2",
            "actual_main_voltage",
            "actual_robot_voltage",
            "actual_robot_current",
            "actual_joint_voltage",
        ),
    ),
    Group((0, 0, 0), (3, 2, 0), ("actual_digital_output_bits", "runtime_state")),
    Group((0, 0, 0), (3, 5, 0), ("elbow_position", "elbow_velocity")),
    Group((5, 4, 0), (3, 10, 0), ("safety_status",)),
    Group((5, 9, 0), (3, 14, 0), ("3",)),
    Group((5, 10, 0), NEVER, ("payload", "payload_cog", "payload_inertia")),
)
"""All groups of fields, in order."""


class RealtimeLayout(NamedTuple):
    """Layout of the packets of one version."""

    layout: Layout
    """Layout of the fields after the header."""
    outputs: tuple[str, ...]
    """Name of the RTDE output of each number, in order; empty for a double without a meaning."""

    @property
    def size(self) -> int:
        """Size of a packet including its header, in bytes."""
        return HEADER.size + self.layout.size

    def encode(self, values: Sequence[float]) -> bytes:
        """Encode a packet from the numbers for all fields, in order.

        Raises LocalProtocolError if a number does not fit.
        """
        return HEADER.pack(self.size) + self.layout.pack_row(*values)


def _columns(name: str, number: int) -> Iterator[tuple[str, str, str]]:
    """Return the name, `struct` character and unit of each double of a field. `number` counts the doubles without a
    meaning.
    """
    if name.isdigit():
        for at in range(int(name)):
            yield f"reserved{number + at}", "d", ""
        return
    variable = OUTPUTS[name]
    count = CODES[variable.type][0]
    for at in range(count):
        yield name if count == 1 else f"{name}_{at}", "Q" if name in _BITS else "d", variable.unit


@cache
def _build(groups: int) -> RealtimeLayout:
    fields, outputs, at, reserved = list[Field](), list[str](), 0, 0
    for name in (name for group in GROUPS[:groups] for name in group.names):
        outputs += [""] * int(name) if name.isdigit() else [name]
        for column, code, unit in _columns(name, reserved):
            fields.append(Field(column, at, code, Mark.OBSERVED, unit=unit))
            at += struct.calcsize(f">{code}")
        reserved += int(name) if name.isdigit() else 0
    return RealtimeLayout(Layout("real-time state", at, ">", tuple(fields)), tuple(outputs))


def layout_of(version: Sequence[int]) -> RealtimeLayout:
    """Return the packet layout of a controller with this version."""
    number = tuple(version[:3])
    e_series = version[0] >= _E_SERIES
    return _build(sum(number >= (group.since if e_series else group.since_cb3) for group in GROUPS) or 1)


LAYOUTS: Mapping[int, RealtimeLayout] = {
    layout.size: layout for layout in (_build(count) for count in range(1, len(GROUPS) + 1))
}
"""Packet layouts by the length of the packet."""


def decode(packet: bytes) -> dict[str, float]:
    """Decode a complete packet to values by name. Raises RemoteProtocolError if no version has packets of this
    length.
    """
    layout = LAYOUTS.get(len(packet))
    if layout is None or HEADER.unpack_from(packet)[0] != len(packet):
        raise RemoteProtocolError(f"{len(packet)} bytes are not a packet of the real-time interface")
    return layout.layout.unpack(packet[HEADER.size :])
