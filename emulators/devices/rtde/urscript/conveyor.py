"""Encoder and conveyor functions. They have no effect, since the emulated controller has neither.

Source: the script manual of the e-Series, module motion.
"""

from emulators.devices.rtde.urscript.table import tagged

CONVEYOR = (
    tagged("conveyor_pulse_decode(type, A, B=0)"),
    tagged("get_conveyor_tick_count()", 0.0),
    tagged("set_conveyor_tick_count(tick_count, absolute_encoder_resolution=0)"),
    tagged("track_conveyor_circular(center, ticks_per_revolution, rotate_tool=False, encoder_index=0)"),
    tagged("track_conveyor_linear(direction, ticks_per_meter, encoder_index=0)"),
    tagged("stop_conveyor_tracking(a=20)"),
    tagged("encoder_enable_pulse_decode(encoder_index, decoder_type, A, B)"),
    tagged("encoder_enable_set_tick_count(encoder_index, range_id)"),
    tagged("encoder_get_tick_count(encoder_index, opt='')", 0.0),
    tagged("encoder_set_tick_count(encoder_index, count)"),
    tagged("encoder_unwind_delta_tick_count(encoder_index, delta_tick_count)", 0.0),
)
