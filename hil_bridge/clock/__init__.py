"""Time: the only package that reads a clock, and an event loop in virtual time."""

from hil_bridge.clock.clock import Clock, Timer, wall_time
from hil_bridge.clock.devices import device_clock
from hil_bridge.clock.heartbeat import Heartbeat
from hil_bridge.clock.run import LeakedTasks, Main, run_real, run_real_on, run_virtual, run_virtual_on
from hil_bridge.clock.virtual import (
    VIRTUAL_EPOCH,
    VIRTUAL_WALL_NS,
    VirtualDeadlock,
    VirtualLoop,
    VirtualTimeError,
)

__all__ = [
    "VIRTUAL_EPOCH",
    "VIRTUAL_WALL_NS",
    "Clock",
    "Heartbeat",
    "LeakedTasks",
    "Main",
    "Timer",
    "VirtualDeadlock",
    "VirtualLoop",
    "VirtualTimeError",
    "device_clock",
    "run_real",
    "run_real_on",
    "run_virtual",
    "run_virtual_on",
    "wall_time",
]
