"""Variables of RTDE with their types and units, and recipes, which list the variables of a data packet in order.

Source: Universal Robots' RTDE guide; for names and types also its C++ client library, `rtde/data_package.cpp`, and
ur_rtde. Where no source gives a version, the first version of the product line is used. All units are SI. A pose is
x y z and a rotation vector, of the tool centre point in the base frame.
"""

import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, TypeAlias

from protocol.devices.rtde.packets import Kind, encode
from protocol.endpoint import LocalProtocolError, RemoteProtocolError
from protocol.marks import Mark

Value: TypeAlias = float | tuple[float, ...]
"""Value of a variable: a number for a scalar type, a tuple of numbers for a vector."""

NOT_FOUND, IN_USE = "NOT_FOUND", "IN_USE"
"""Texts that the controller reports instead of a type: the variable does not exist, or another connection holds it."""

CODES: Mapping[str, tuple[int, str]] = {
    "BOOL": (1, "?"),
    "UINT8": (1, "B"),
    "UINT32": (1, "I"),
    "UINT64": (1, "Q"),
    "INT32": (1, "i"),
    "DOUBLE": (1, "d"),
    "VECTOR3D": (3, "d"),
    "VECTOR6D": (6, "d"),
    "VECTOR6INT32": (6, "i"),
    "VECTOR6UINT32": (6, "I"),
}
"""Number of values and `struct` character of each type."""


class Variable(NamedTuple):
    """One output or input variable."""

    type: str
    unit: str = ""
    meaning: str = ""
    since: tuple[int, int, int] = (0, 0, 0)
    """First e-Series version that supports the variable."""
    since_cb3: tuple[int, int, int] = (0, 0, 0)
    """First CB3 version that supports the variable."""
    mark: Mark = Mark.OBSERVED


def _numbered(first: int, end: int, name: str, kind: str) -> Iterator[tuple[str, Variable]]:
    for number in range(first, end):
        yield f"{name}_{number}", Variable(kind)


NEVER = (1000, 0, 0)
"""Version of a variable that no CB3 supports."""
_E_SERIES = 5
"""Major version of the first e-Series software."""


def _joint(unit: str, meaning: str) -> Variable:
    return Variable("VECTOR6D", unit, f"{meaning}, base to wrist 3")


def _double(unit: str, meaning: str) -> Variable:
    return Variable("DOUBLE", unit, meaning)


def _registers(direction: str) -> dict[str, Variable]:
    return {
        f"{direction}_bit_registers0_to_31": Variable("UINT32"),
        f"{direction}_bit_registers32_to_63": Variable("UINT32"),
        **dict(_numbered(64, 128, f"{direction}_bit_register", "BOOL")),
        **dict(_numbered(0, 48, f"{direction}_int_register", "INT32")),
        **dict(_numbered(0, 48, f"{direction}_double_register", "DOUBLE")),
    }


INPUTS: Mapping[str, Variable] = {
    **_registers("input"),
    "speed_slider_mask": Variable("UINT32", "", "1: the fraction is applied"),
    "speed_slider_fraction": Variable("DOUBLE", "", "0 … 1"),
    "external_force_torque": Variable("VECTOR6D", "N, N·m", "wrench along the tool's axes", (3, 3, 0)),
    "standard_digital_output_mask": Variable("UINT8"),
    "standard_digital_output": Variable("UINT8"),
    "configurable_digital_output_mask": Variable("UINT8"),
    "configurable_digital_output": Variable("UINT8"),
    "tool_digital_output_mask": Variable("UINT8"),
    "tool_digital_output": Variable("UINT8"),
    "standard_analog_output_mask": Variable("UINT8"),
    "standard_analog_output_type": Variable("UINT8"),
    "standard_analog_output_0": Variable("DOUBLE"),
    "standard_analog_output_1": Variable("DOUBLE"),
}
"""Input variables by name."""

_POSE, _SPEED = ("m, rad", "pose of the tool"), ("m/s, rad/s", "velocity of the tool, base axes")

Number: TypeAlias = tuple[int, int, int]


def _declare_assumed(
    kind: str, unit: str = "", meaning: str = "", since: Number = (0, 0, 0), cb3: Number = (0, 0, 0)
) -> Variable:
    """Declare a variable whose first versions are not given in any public source."""
    return Variable(kind, unit, meaning, since, cb3, Mark.ASSUMED)


_FURTHER: Mapping[str, Variable] = {
    "actual_current_window": _declare_assumed("VECTOR6D", "A", "windows of the currents"),
    "actual_configurable_digital_input_bits": _declare_assumed("UINT64"),
    "actual_configurable_digital_output_bits": _declare_assumed("UINT64"),
    "target_execution_time": _declare_assumed("DOUBLE", "ms", "of the controller's cycle"),
    "elbow_position": _declare_assumed("VECTOR3D", "m", "of the elbow, base frame", (5, 0, 0), (3, 5, 0)),
    "elbow_velocity": _declare_assumed("VECTOR3D", "m/s", "of the elbow, base axes", (5, 0, 0), (3, 5, 0)),
    "analog_io_types": _declare_assumed("UINT32", "", "bits 0, 1: inputs, 2, 3: outputs; set: voltage"),
    "io_current": _declare_assumed("DOUBLE", "A", "of the I/O"),
    "encoder0_raw": _declare_assumed("INT32", "", "ticks"),
    "encoder1_raw": _declare_assumed("INT32", "", "ticks"),
    "euromap67_input_bits": _declare_assumed("UINT32"),
    "euromap67_output_bits": _declare_assumed("UINT32"),
    "euromap67_24V_voltage": _declare_assumed("DOUBLE", "V", ""),
    "euromap67_24V_current": _declare_assumed("DOUBLE", "A", ""),
    "tool_mode": _declare_assumed("UINT32", "", "253: running"),
    "tool_analog_input_types": _declare_assumed("UINT32", "", "bits 0, 1; set: voltage"),
    "tool_analog_input0": _declare_assumed("DOUBLE", "A or V", ""),
    "tool_analog_input1": _declare_assumed("DOUBLE", "A or V", ""),
    "tool_output_voltage": _declare_assumed("INT32", "V", "0, 12 or 24"),
    "tool_output_current": _declare_assumed("DOUBLE", "A", ""),
    "tool_temperature": _declare_assumed("DOUBLE", "°C", ""),
    "tool_output_mode": _declare_assumed("UINT8", "", "", (5, 2, 0), NEVER),
    "tool_digital_output0_mode": _declare_assumed("UINT8", "", "", (5, 2, 0), NEVER),
    "tool_digital_output1_mode": _declare_assumed("UINT8", "", "", (5, 2, 0), NEVER),
    "joint_position_deviation_ratio": _declare_assumed(
        "DOUBLE", "", "largest deviation of a joint, of its limit"
    ),
    "collision_detection_ratio": _declare_assumed("DOUBLE", "", "0 … 1", (5, 15, 0), NEVER),
    "wrench_calc_from_currents": _declare_assumed("VECTOR6D", "N, N·m", "base axes", (5, 9, 0), NEVER),
    "script_control_line": _declare_assumed("UINT32", "", "line of the script that moves the arm"),
    "time_scale_source": _declare_assumed("INT32", "", "the limit that slows the arm", (5, 17, 0), NEVER),
    "actual_robot_energy_consumed": Variable("DOUBLE", "J", "", (5, 23, 0), NEVER),
    "actual_robot_braking_energy_dissipated": Variable("DOUBLE", "J", "", (5, 23, 0), NEVER),
    "target_gravity": _declare_assumed("VECTOR3D", "m/s²", "", (5, 23, 0), NEVER),
    "target_base_acceleration": _declare_assumed("VECTOR6D", "m/s², rad/s²", "", (5, 23, 0), NEVER),
    "target_base_wrench": _declare_assumed("VECTOR6D", "N, N·m", "", (5, 23, 0), NEVER),
    "control_step": _declare_assumed("UINT64", "", "", (5, 23, 0), NEVER),
}
"""Outputs in the vendor's C++ client library; their first versions are assumed, except for the energies."""

OUTPUTS: Mapping[str, Variable] = {
    "timestamp": _double("s", "since the controller started"),
    "target_q": _joint("rad", "target joints"),
    "target_qd": _joint("rad/s", "target velocities"),
    "target_qdd": _joint("rad/s²", "target accelerations"),
    "target_current": _joint("A", "target currents"),
    "target_moment": _joint("N·m", "target moments"),
    "actual_q": _joint("rad", "joints"),
    "actual_qd": _joint("rad/s", "velocities"),
    "actual_current": _joint("A", "currents"),
    "joint_control_output": _joint("A", "control currents"),
    "actual_TCP_pose": Variable("VECTOR6D", *_POSE),
    "actual_TCP_speed": Variable("VECTOR6D", *_SPEED),
    "actual_TCP_force": Variable("VECTOR6D", "N, N·m", "wrench, base axes"),
    "target_TCP_pose": Variable("VECTOR6D", *_POSE),
    "target_TCP_speed": Variable("VECTOR6D", *_SPEED),
    "ft_raw_wrench": Variable("VECTOR6D", "N, N·m", "wrench of the sensor", (5, 9, 0), NEVER),
    "tcp_offset": Variable("VECTOR6D", "m, rad", "tool in the flange", (5, 5, 1), (3, 12, 3)),
    "actual_digital_input_bits": Variable("UINT64"),
    "actual_digital_output_bits": Variable("UINT64"),
    "joint_temperatures": _joint("°C", "temperatures"),
    "actual_execution_time": _double("ms", "of the controller's cycle"),
    "robot_mode": Variable("INT32", "", "7: running"),
    "joint_mode": Variable("VECTOR6INT32", "", "253: running"),
    "safety_mode": Variable("INT32", "", "1: normal"),
    "safety_status": Variable("INT32", "", "as safety_mode", (5, 4, 0), (3, 10, 0)),
    "safety_status_bits": Variable("UINT32", "", "bit 0: normal"),
    "robot_status_bits": Variable("UINT32", "", "bit 0: power, bit 1: a program plays"),
    "runtime_state": Variable("UINT32", "", "2: playing"),
    "actual_tool_accelerometer": Variable("VECTOR3D", "m/s²"),
    "speed_scaling": _double("", "0 … 1"),
    "target_speed_fraction": _double("", "0 … 1"),
    "actual_momentum": _double("kg·m/s", "of the arm"),
    "actual_main_voltage": _double("V", "of the control box"),
    "actual_robot_voltage": _double("V", "of the arm"),
    "actual_robot_current": _double("A", "of the arm"),
    "actual_joint_voltage": _joint("V", "voltages"),
    "actual_current_as_torque": Variable("VECTOR6D", "N·m", "", (5, 23, 0), NEVER),
    "standard_analog_input0": _double("A or V", ""),
    "standard_analog_input1": _double("A or V", ""),
    "standard_analog_output0": _double("A or V", ""),
    "standard_analog_output1": _double("A or V", ""),
    "tcp_force_scalar": _double("N", "length of the force"),
    "payload": Variable("DOUBLE", "kg", "", (5, 5, 1), (3, 12, 3)),
    "payload_cog": Variable("VECTOR3D", "m", "centre of gravity", (5, 5, 1), (3, 12, 3)),
    "payload_inertia": Variable("VECTOR6D", "kg·m²", "", (5, 11, 0), (3, 15, 0)),
    **_FURTHER,
    **_registers("output"),
    **{name: variable for name, variable in INPUTS.items() if "_register" in name},
}
"""Output variables by name. Input registers can be read back as outputs."""


def type_of(table: Mapping[str, Variable], name: str, version: Sequence[int]) -> str:
    """Return the type of a variable on a controller with this version, or `NOT_FOUND`."""
    variable = table.get(name)
    if variable is None:
        return NOT_FOUND
    since = variable.since if version[0] >= _E_SERIES else variable.since_cb3
    return variable.type if tuple(version[:3]) >= since else NOT_FOUND


@dataclass(frozen=True)
class Recipe:
    """Variables of a data packet, in order."""

    number: int
    """Number of the recipe, 1 … 255, with which a data packet starts."""
    names: tuple[str, ...]
    types: tuple[str, ...]
    """Type of each variable, as named in `CODES`."""

    @cached_property
    def _layout(self) -> tuple[struct.Struct, tuple[int, ...]]:
        codes = [CODES[kind] for kind in self.types]
        return struct.Struct(">B" + "".join(code * count for count, code in codes)), tuple(
            count for count, _ in codes
        )

    @property
    def size(self) -> int:
        """Size of a data packet's payload in bytes."""
        return self._layout[0].size

    def pack(self, *numbers: float) -> bytes:
        """Encode a data packet from all its numbers, with vectors flattened.

        Raises LocalProtocolError if a number does not fit.
        """
        try:
            return encode(Kind.DATA, self._layout[0].pack(self.number, *numbers))
        except struct.error as error:
            raise LocalProtocolError(f"recipe {self.number}: {error}") from error

    def unpack(self, payload: bytes) -> tuple[float, ...]:
        """Decode all numbers of a data packet, with vectors flattened.

        Raises RemoteProtocolError if the packet has another recipe or length.
        """
        layout = self._layout[0]
        if len(payload) != layout.size or payload[0] != self.number:
            raise RemoteProtocolError(
                f"a data packet of {len(payload)} bytes does not match recipe {self.number} of {layout.size} bytes"
            )
        return layout.unpack(payload)[1:]

    def values(self, numbers: Sequence[float]) -> dict[str, Value]:
        """Convert flattened numbers to values by name."""
        values: dict[str, Value] = {}
        at = 0
        for name, count in zip(self.names, self._layout[1], strict=True):
            values[name] = numbers[at] if count == 1 else tuple(numbers[at : at + count])
            at += count
        return values
