"""Settings of the emulated controller that is as late as a measured one."""

import math
from typing import Any

from hil_bridge.devices.emulator_fit import RobotFigures, Sections, split_servo


def match(settings: Any, figures: RobotFigures) -> Sections:
    """As `hil_bridge.devices.emulator_fit` says: a transport delay, with the loops as they are."""
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
