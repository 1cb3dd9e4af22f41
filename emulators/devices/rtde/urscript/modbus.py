"""Functions of the Modbus client and of the Modbus server's ports. None has an effect.

No unit answers: `modbus_get_error` reports a refused connection, so that a program that waits for a unit continues.
Source: the script manual of the e-Series, module interfaces.
"""

from emulators.devices.rtde.urscript.table import tagged

NO_CONNECTION = 111 << 16
"""Error of a signal for which no unit answers: the connection error in the upper two bytes, ECONNREFUSED of Linux
(assumed).
"""

MODBUS = (
    tagged(
        "modbus_add_signal(IP, slave_number, signal_address, signal_type, signal_name, sequential_mode=False, "
        "register_count=1)"
    ),
    tagged(
        "modbus_add_rw_signal(IP, slave_number, read_address, read_register_count, write_address, "
        "write_register_count, signal_name, sequential_mode=False)"
    ),
    tagged("modbus_delete_signal(signal_name)"),
    tagged("modbus_get_error(signal_name, error_source=0)", NO_CONNECTION),
    tagged("modbus_get_signal_status(signal_name, is_secondary_program=False)", False),
    tagged("modbus_get_time_since_signal_invalid(signal_name)", 0.0),
    tagged("modbus_request_update_signal_value(signal_name)"),
    tagged("modbus_reset_connection(connection_id, is_blocking=True)"),
    tagged("modbus_send_custom_command(IP, slave_number, function_code, data)"),
    tagged("modbus_set_digital_input_action(signal_name, action)"),
    tagged("modbus_set_output_register(signal_name, register_value, is_secondary_program=False)"),
    tagged("modbus_set_output_signal(signal_name, digital_value, is_secondary_program=False)"),
    tagged("modbus_set_runstate_dependent_choice(signal_name, runstate_choice)"),
    tagged("modbus_set_signal_update_frequency(signal_name, update_frequency)"),
    tagged("modbus_set_signal_watchdog(signal_name, new_timeout_in_sec)"),
    tagged("read_port_bit(address)", False),
    tagged("read_port_register(address)", 0),
    tagged("write_port_bit(address, value)"),
    tagged("write_port_register(address, value)"),
)
