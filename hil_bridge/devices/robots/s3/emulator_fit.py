"""Settings of the emulated controller that is as late as a measured one."""

import math
from typing import Any

from hil_bridge.devices.emulator_fit import RobotFigures, Sections, split_servo
from hil_bridge.devices.robots.s3.latency import late_settings


def match(settings: Any, figures: RobotFigures) -> Sections:
    """As `hil_bridge.devices.emulator_fit` says: turnarounds as quantiles, and the servo's transport delay."""
    found: dict[str, dict[str, object]] = {}
    if figures.turnarounds_ms:
        found |= late_settings(figures.turnarounds_ms, settings.client.link)
    if not math.isnan(figures.servo_s):
        servo = settings.emulated.servo
        response = 2.0 * servo.damping_ratio / servo.natural_frequency_rad_s
        delay, frequency = split_servo(figures.servo_s, response, servo.damping_ratio)
        found["cell.s3.servo"] = {
            "transport_delay_ms": round(delay * 1e3, 3),
            "natural_frequency_rad_s": round(frequency, 3),
        }
    return found
