"""Settings with which the emulated controller has the latency of a measured controller."""

import math
from typing import Any

from hil_bridge.devices.emulator_fit import RobotFigures, Sections, split_servo


def match(settings: Any, figures: RobotFigures) -> Sections:
    """Return a transport delay and a natural frequency; see `hil_bridge.devices.emulator_fit`."""
    if math.isnan(figures.servo_s):
        return {}
    servo = settings.emulated
    response = 2.0 * servo.damping_ratio / servo.natural_frequency_rad_s
    delay, frequency = split_servo(figures.servo_s, response, servo.damping_ratio)
    return {
        "cell.rsi": {
            "transport_delay_ms": round(delay * 1e3, 3),
            "natural_frequency_rad_s": round(frequency, 3),
        }
    }
