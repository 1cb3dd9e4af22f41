"""State of an emulated controller as its outputs report it in each cycle."""

import math
from collections.abc import Callable, Mapping
from typing import NamedTuple

from emulators.devices.rtde.drives import ArmSensors
from emulators.devices.rtde.kinematics import Arm, Joints, compose, flange
from protocol.devices.rtde.fields import INPUTS, OUTPUTS, Value
from protocol.devices.rtde.rotation import six_of
from protocol.devices.rtde.states import BITS, RobotMode, Runtime, SafetyMode, StatusBits
from protocol.geometry import Pose, Wrench, inverse, product, rotation_vector

Registers = Mapping[str, Value]
"""Values by name; a missing value is 0. Immutable: a change creates another mapping."""


class Snapshot(NamedTuple):
    """State at the end of one cycle."""

    number: int
    """Number of the cycle."""
    time: float
    """Controller time, s."""
    period: float
    lengths: Arm
    sensors: ArmSensors
    joints: Joints
    """Measured joint angles at the start of the cycle, rad."""
    speeds: Joints
    """Measured joint speeds, rad/s."""
    target: Joints
    """Target joint angles given to the drives in this cycle, rad: the filtered argument of servoj."""
    target_speeds: Joints
    target_speeds_before: Joints
    """Target joint speeds one cycle earlier, rad/s."""
    pose: Pose
    """Pose of the tool at the measured joint angles, as altered by faults."""
    now: Pose
    """True pose of the tool."""
    tcp: Pose
    """Tool centre point in the flange frame."""
    force: Wrench
    """actual_TCP_force along the base axes, N and N·m."""
    raw_force: Wrench
    """actual_TCP_force along the flange axes, N and N·m."""
    mode: RobotMode
    safety: SafetyMode
    runtime: Runtime
    scaling: float
    payload: tuple[float, ...]
    """Payload: mass, kg, and centre of gravity, m."""
    inputs: Registers
    outputs: Registers


_NONE = (0.0,) * 6
_POWERED, _PLAYING = int(StatusBits.POWER_ON), int(StatusBits.PROGRAM_RUNNING)


def _speed(state: Snapshot, joints: Joints, speeds: Joints) -> Value:
    """Return the velocity of the tool at these joint speeds: the displacement in one cycle divided by the cycle
    time.
    """
    if not any(speeds):
        return _NONE
    time = state.period
    a, b, c, d, e, f = [joint - time * speed for joint, speed in zip(joints, speeds, strict=True)]
    before = compose(flange(state.lengths, (a, b, c, d, e, f)), state.tcp)
    here = compose(flange(state.lengths, joints), state.tcp)
    turned = product(here.quaternion, inverse(before.quaternion))
    (x, y, z), (u, v, w), (i, j, k) = before.position, here.position, rotation_vector(turned)
    return (u - x) / time, (v - y) / time, (w - z) / time, i / time, j / time, k / time


def _target_pose(state: Snapshot) -> Value:
    return six_of(compose(flange(state.lengths, state.target), state.tcp))


def _accelerations(state: Snapshot) -> Value:
    pairs = zip(state.target_speeds, state.target_speeds_before, strict=True)
    return tuple((now - before) / state.period for now, before in pairs)


def _currents(state: Snapshot) -> Value:
    return state.sensors.read_currents(state.number) if state.mode == RobotMode.RUNNING else _NONE


def _status(state: Snapshot) -> float:
    powered = _POWERED if state.mode >= RobotMode.POWER_ON else 0
    return powered | _PLAYING if state.runtime == Runtime.PLAYING else powered


def _safety(state: Snapshot) -> float:
    return int(state.safety)


TOOL_RUNS, TOOL_OFF = 253, 255
"""Modes of the tool's board: running and off. The first is observed."""
ANALOG_TYPES = "analog_io_types"
_FIRST_OUTPUT_TYPE = 2
"""Bit of `analog_io_types` that holds the type of the first output."""


def number_in(registers: Registers, name: str) -> float:
    """Return the value of a numeric register; 0 if it was never written."""
    value = registers.get(name, 0)
    assert not isinstance(value, tuple), "a number"
    return value


def _bits(state: Snapshot, first: int, count: int) -> int:
    """Return a range of the digital outputs."""
    return int(number_in(state.outputs, "actual_digital_output_bits")) >> first & (1 << count) - 1


def _analog(state: Snapshot, number: int) -> float:
    """Return an analogue output in its unit: 0 to 10 V, or 4 to 20 mA. Source: Universal Robots' user manuals."""
    share = number_in(state.outputs, f"standard_analog_output{number}")
    voltage = int(number_in(state.outputs, ANALOG_TYPES)) >> (_FIRST_OUTPUT_TYPE + number) & 1
    return 10.0 * share if voltage else 0.004 + 0.016 * share


FIELDS: Mapping[str, Callable[[Snapshot], Value]] = {
    "timestamp": lambda state: state.time,
    "target_q": lambda state: state.target,
    "target_qd": lambda state: state.target_speeds,
    "target_qdd": _accelerations,
    "actual_q": lambda state: state.joints,
    "actual_qd": lambda state: state.speeds,
    "actual_TCP_pose": lambda state: six_of(state.pose),
    "actual_TCP_speed": lambda state: _speed(state, state.joints, state.speeds),
    "actual_TCP_force": lambda state: state.force,
    "target_TCP_pose": _target_pose,
    "target_TCP_speed": lambda state: _speed(state, state.target, state.target_speeds),
    "actual_current": _currents,
    "ft_raw_wrench": lambda state: state.raw_force,
    "tcp_force_scalar": lambda state: math.hypot(*state.force[:3]),
    "tcp_offset": lambda state: six_of(state.tcp),
    "robot_mode": lambda state: int(state.mode),
    "joint_mode": lambda state: (253 if state.mode == RobotMode.RUNNING else 255,) * 6,
    "safety_mode": _safety,
    "safety_status": _safety,
    "safety_status_bits": lambda state: int(BITS[state.safety]),
    "robot_status_bits": _status,
    "runtime_state": lambda state: int(state.runtime),
    "speed_scaling": lambda state: state.scaling,
    "target_speed_fraction": lambda state: state.scaling,
    "payload": lambda state: state.payload[0],
    "payload_cog": lambda state: state.payload[1:],
    "joint_temperatures": lambda state: (28.0,) * 6,
    "actual_joint_voltage": lambda state: (48.0,) * 6,
    "actual_main_voltage": lambda state: 48.0,
    "actual_robot_voltage": lambda state: 48.0,
    "actual_robot_current": lambda state: 0.6,
    "actual_execution_time": lambda state: 0.5,
    "actual_tool_accelerometer": lambda state: state.sensors.read_acceleration(state.number),
    "target_execution_time": lambda state: 0.5,
    "tool_mode": lambda state: TOOL_RUNS if state.mode == RobotMode.RUNNING else TOOL_OFF,
    "tool_temperature": lambda state: 28.0,
    "actual_configurable_digital_output_bits": lambda state: _bits(state, 8, 8),
    "analog_io_types": lambda state: number_in(state.outputs, ANALOG_TYPES),
    "standard_analog_output0": lambda state: _analog(state, 0),
    "standard_analog_output1": lambda state: _analog(state, 1),
    "wrench_calc_from_currents": lambda state: state.force,
}
"""Outputs that are not always 0. Temperatures, voltages and similar values are plausible constants."""


_NOISE_ALONE = "actual_current", "actual_tool_accelerometer"
_CONSTANT = (
    "joint_temperatures",
    "actual_joint_voltage",
    "actual_main_voltage",
    "actual_robot_voltage",
    "actual_robot_current",
    "actual_execution_time",
    "target_execution_time",
    "tool_temperature",
)


def not_modelled(name: str) -> str:
    """Return how the emulator treats a variable that it does not model; empty if it models the variable."""
    if name in _CONSTANT:
        return "constant"
    if name in _NOISE_ALONE:
        return "noise only"
    return "" if "_register" in name or name in FIELDS or name in INPUTS else "always 0"


def getter(name: str) -> Callable[[Snapshot], tuple[float, ...]]:
    """Return a function that reads the encoded numbers of an output."""
    kind = OUTPUTS[name].type
    nothing: Value = _NONE if kind.startswith("VECTOR6") else (0.0,) * 3 if kind == "VECTOR3D" else 0
    if name in FIELDS:
        read = FIELDS[name]
    elif name in INPUTS:
        read = lambda state: state.inputs.get(name, nothing)  # noqa: E731
    else:
        read = lambda state: state.outputs.get(name, nothing)  # noqa: E731
    if kind.startswith("VECTOR"):
        is_integer = "INT" in kind

        def vector(state: Snapshot) -> tuple[float, ...]:
            value = read(state)
            assert isinstance(value, tuple), "a vector"
            return tuple(map(int, value)) if is_integer else value

        return vector
    convert = float if kind == "DOUBLE" else bool if kind == "BOOL" else int

    def scalar(state: Snapshot) -> tuple[float, ...]:
        value = read(state)
        assert not isinstance(value, tuple), "a scalar"
        return (convert(value),)

    return scalar
