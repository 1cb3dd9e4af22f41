"""States of a controller as reported by RTDE, and their names at the dashboard.

Source: Universal Robots' C++ client library, `ur/datatypes.h`, and its RTDE guide.
"""

from enum import IntEnum, IntFlag


class RobotMode(IntEnum):
    """Mode of the robot, `robot_mode`."""

    NO_CONTROLLER = -1
    DISCONNECTED = 0
    CONFIRM_SAFETY = 1
    BOOTING = 2
    POWER_OFF = 3
    POWER_ON = 4
    IDLE = 5
    """The arm is powered and its brakes are applied."""
    BACKDRIVE = 6
    RUNNING = 7
    UPDATING_FIRMWARE = 8


class SafetyMode(IntEnum):
    """Safety mode of the robot, `safety_mode` and `safety_status`."""

    NORMAL = 1
    REDUCED = 2
    PROTECTIVE_STOP = 3
    RECOVERY = 4
    SAFEGUARD_STOP = 5
    SYSTEM_EMERGENCY_STOP = 6
    ROBOT_EMERGENCY_STOP = 7
    VIOLATION = 8
    FAULT = 9


STOPPED_MODES = (
    SafetyMode.PROTECTIVE_STOP,
    SafetyMode.SAFEGUARD_STOP,
    SafetyMode.SYSTEM_EMERGENCY_STOP,
    SafetyMode.ROBOT_EMERGENCY_STOP,
    SafetyMode.VIOLATION,
    SafetyMode.FAULT,
)
"""Safety modes in which the arm cannot move."""


class SafetyBits(IntFlag):
    """Bits of the safety status, `safety_status_bits`."""

    NORMAL = 1 << 0
    REDUCED = 1 << 1
    PROTECTIVE_STOPPED = 1 << 2
    RECOVERY = 1 << 3
    SAFEGUARD_STOPPED = 1 << 4
    SYSTEM_EMERGENCY_STOPPED = 1 << 5
    ROBOT_EMERGENCY_STOPPED = 1 << 6
    EMERGENCY_STOPPED = 1 << 7
    VIOLATION = 1 << 8
    FAULT = 1 << 9
    STOPPED = 1 << 10
    """The arm is stopped for safety. Assumed: the bit is set in every stop."""


class StatusBits(IntFlag):
    """Bits of the robot status, `robot_status_bits`."""

    POWER_ON = 1 << 0
    PROGRAM_RUNNING = 1 << 1


class Runtime(IntEnum):
    """State of the program, `runtime_state`."""

    STOPPING = 0
    STOPPED = 1
    PLAYING = 2
    PAUSING = 3
    PAUSED = 4
    RESUMING = 5


_STOP = SafetyBits.STOPPED
BITS = {
    SafetyMode.NORMAL: SafetyBits.NORMAL,
    SafetyMode.REDUCED: SafetyBits.REDUCED,
    SafetyMode.RECOVERY: SafetyBits.RECOVERY,
    SafetyMode.PROTECTIVE_STOP: SafetyBits.PROTECTIVE_STOPPED | _STOP,
    SafetyMode.SAFEGUARD_STOP: SafetyBits.SAFEGUARD_STOPPED | _STOP,
    SafetyMode.SYSTEM_EMERGENCY_STOP: SafetyBits.SYSTEM_EMERGENCY_STOPPED
    | SafetyBits.EMERGENCY_STOPPED
    | _STOP,
    SafetyMode.ROBOT_EMERGENCY_STOP: SafetyBits.ROBOT_EMERGENCY_STOPPED
    | SafetyBits.EMERGENCY_STOPPED
    | _STOP,
    SafetyMode.VIOLATION: SafetyBits.VIOLATION | _STOP,
    SafetyMode.FAULT: SafetyBits.FAULT | _STOP,
}
"""Bits of the safety status that are set in each safety mode. Derived from their names."""


def name_of(table: type[IntEnum], number: float) -> str:
    """Return the name of a state with spaces instead of underscores, or its number if it has no name."""
    return next((one.name.lower().replace("_", " ") for one in table if one == number), f"{number:g}")
