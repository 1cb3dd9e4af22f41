"""Settings with which the emulated controller has the latency of a measured controller."""

import math
from typing import Any

from hil_bridge.devices.emulator_fit import RobotFigures, Sections, split_servo
from hil_bridge.devices.robots.s3.latency import late_settings


def match(settings: Any, figures: RobotFigures) -> Sections:
    """Return the turnaround times as quantiles, and the transport delay of the servo; see
    `hil_bridge.devices.emulator_fit`.
    """
    sections: dict[str, dict[str, object]] = {}
    if figures.turnarounds_ms:
        sections |= late_settings(figures.turnarounds_ms, settings.client.link)
    if not math.isnan(figures.servo_s):
        servo = settings.emulated.servo
        response = 2.0 * servo.damping_ratio / servo.natural_frequency_rad_s
        delay, frequency = split_servo(figures.servo_s, response, servo.damping_ratio)
        sections["cell.s3.servo"] = {
            "transport_delay_ms": round(delay * 1e3, 3),
            "natural_frequency_rad_s": round(frequency, 3),
        }
    return sections
