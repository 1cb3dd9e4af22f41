"""Errors and warnings of the control box. Numbers: xArm-Developer/xArm-Python-SDK d911319c, `x_code.py`."""

from collections.abc import Mapping
from enum import IntEnum


class Error(IntEnum):
    """Error that stops the arm until it is cleared."""

    NONE = 0
    STOP_BUTTON = 1
    STOP_INPUT = 2
    JOINT = 11
    SENSOR_LOST = 18
    KINEMATICS = 21
    JOINT_LIMIT = 23
    SPEED = 24
    PLANNING = 25
    COLLISION = 31
    SENSOR_READ = 50
    SENSOR_MODE = 51
    SENSOR_ZERO = 52
    SENSOR_OVERLOAD = 53
    SERVO_SPEED = 60


class Warning(IntEnum):
    """Warning about a command."""

    NONE = 0
    QUEUE_FULL = 11
    PARAMETER = 12
    UNKNOWN_COMMAND = 13
    NO_SOLUTION = 14


_TEXTS: Mapping[int, str] = {
    1: "the emergency stop button is pressed",
    2: "the emergency stop input is active",
    3: "the emergency stop of the enabling switch is pressed",
    10: "servo motor",
    18: "no communication with the force sensor",
    19: "no communication with the end effector",
    21: "kinematics",
    22: "collision with itself",
    23: "a joint beyond its range",
    24: "speed beyond the limit",
    25: "planning",
    30: "measured speed beyond the limit",
    31: "collision",
    35: "outside the safety boundary",
    37: "abnormal motion in manual mode",
    38: "abnormal joint angle",
    50: "force sensor cannot be read",
    51: "mode of the force sensor cannot be set",
    52: "zero of the force sensor cannot be set",
    53: "force sensor overloaded",
    60: "speed of the tool beyond the limit in servo mode",
}


def error_text(code: int) -> str:
    """Return the number of an error with its meaning."""
    text = f"servo motor of joint {code - 10}" if 11 <= code <= 17 else _TEXTS.get(code, "")
    return f"error {code}, {text}" if text else f"error {code}"
