"""All functions that a program may call, by name. A program that calls any other function does not compile."""

from functools import lru_cache

from emulators.devices.rtde.urscript.arithmetic import ARITHMETIC
from emulators.devices.rtde.urscript.conveyor import CONVEYOR
from emulators.devices.rtde.urscript.dynamics import DYNAMICS
from emulators.devices.rtde.urscript.force import FORCE
from emulators.devices.rtde.urscript.modbus import MODBUS
from emulators.devices.rtde.urscript.motion import MOTION
from emulators.devices.rtde.urscript.poses import POSES
from emulators.devices.rtde.urscript.system import SYSTEM
from emulators.devices.rtde.urscript.table import Function, Functions, by_name, tagged
from emulators.devices.rtde.urscript.versions import SINCE

_NONE = (0.0,) * 6
_INTERPRETER = "returns at once: port 30020 is not served"


def _add_versions(function: Function) -> Function:
    since = SINCE.get(function.name)
    return function if since is None else function._replace(since=since.e_series, since_cb3=since.cb3)


FUNCTIONS: Functions = by_name(
    _add_versions(function)
    for function in (
        *ARITHMETIC,
        *POSES,
        *SYSTEM,
        *MOTION,
        *FORCE,
        tagged("rpc_factory(type, url)"),
        tagged("interpreter_mode(clearQueueOnEnter=True, clearOnEnd=True)", detail=_INTERPRETER),
        tagged("clear_interpreter()"),
        tagged("end_interpreter()"),
        tagged("screw_driving(f, v_limit)"),
        tagged("end_screw_driving()"),
        tagged("position_deviation_warning(enabled, threshold=0.8)"),
        tagged("set_safety_mode_transition_hardness(type)"),
        tagged("reset_revolution_counter(qNear=None)"),
        tagged("get_target_payload_inertia()", _NONE),
        tagged("get_tool_accelerometer_reading()", (0.0, 0.0, -9.82)),
        tagged("get_controller_temp()", 25.0),
        tagged("get_joint_temp(j)", 28.0),
        tagged("get_tool_temp()", 28.0),
        tagged("get_tool_current()", 0.0),
        tagged("get_tool_analog_in(n)", 0.0),
        tagged("set_gravity(d)"),
        tagged("get_gravity()", (0.0, 0.0, 9.82)),
        tagged("set_base_acceleration(a)"),
        tagged("get_base_acceleration()", (0.0, 0.0, 0.0)),
        tagged("high_holding_torque_enable()"),
        tagged("high_holding_torque_disable()"),
        tagged("set_tool_voltage(voltage)"),
        tagged("set_tool_communication(enabled, baud_rate, parity, stop_bits, rx_idle_chars, tx_idle_chars)"),
        tagged("set_tool_output_mode(mode)"),
        tagged("set_pos(q)"),
        tagged("set_tool_digital_output_mode(n, mode)"),
        tagged("set_analog_inputrange(port, range)"),
        tagged("set_analog_outputdomain(port, domain)"),
        tagged("set_standard_analog_input_domain(port, domain)"),
        tagged("set_tool_analog_input_domain(port, domain)"),
        tagged("set_standard_digital_input_action(port, action)"),
        tagged("set_configurable_digital_input_action(port, action)"),
        tagged("set_tool_digital_input_action(port, action)"),
        tagged("set_gp_boolean_input_action(port, action)"),
        tagged("set_input_actions_to_default()"),
        tagged("set_runstate_standard_digital_output_to_value(outputId, state)"),
        tagged("set_runstate_configurable_digital_output_to_value(outputId, state)"),
        tagged("set_runstate_tool_digital_output_to_value(outputId, state)"),
        tagged("set_runstate_gp_boolean_output_to_value(outputId, state)"),
        tagged("set_runstate_standard_analog_output_to_value(outputId, state)"),
        tagged("set_baselight_off()"),
        tagged("set_baselight_iec()"),
        tagged("set_baselight_solid(r, g, b)"),
        tagged("motion_version_set(version)"),
        tagged("motion_version_get()", 1),
        tagged("jerk_gain_scaling_set(gain)"),
        tagged("jerk_gain_scaling_get()", 1.0),
        tagged("path_offset_enable()"),
        tagged("path_offset_disable(a=20)"),
        tagged("path_offset_set(offset, type)"),
        tagged("path_offset_set_alpha_filter(alpha)"),
        tagged("path_offset_set_max_offset(transLimit, rotLimit)"),
        tagged("pause_on_error_code(code, argument=None)"),
        tagged("set_euromap_output(port_number, signal_value)"),
        tagged("get_euromap_input(port_number)", False),
        tagged("get_euromap_output(port_number)", False),
        *DYNAMICS,
        *MODBUS,
        *CONVEYOR,
        tagged("eip_reader_factory(instance_name, data_size)"),
        tagged("eip_writer_factory(instance_name, data_size)"),
    )
)
"""Functions of all versions, by name."""


@lru_cache(maxsize=16)
def functions_of(version: tuple[int, ...]) -> Functions:
    """Return the functions that a controller of this version provides."""
    return {name: function for name, function in FUNCTIONS.items() if function.is_in(version)}
