"""Settings with which the emulated controller has the latency of a measured controller."""

import math
from typing import Any

from hil_bridge.devices.emulator_fit import RobotFigures, Sections


def match(settings: Any, figures: RobotFigures) -> Sections:
    """Return a delay of complete cycles and a natural frequency; see `hil_bridge.devices.emulator_fit`."""
    if math.isnan(figures.servo_s):
        return {}
    profile = settings.emulated
    response = 2.0 * profile.damping_ratio / profile.natural_frequency_rad_s
    cycles = max(0, math.floor((figures.servo_s - response) / profile.cycle_s))
    rest = max(figures.servo_s - cycles * profile.cycle_s, 0.1 * response)
    return {
        "cell.fanuc": {
            "transport_delay_ms": cycles * profile.cycle_ms,
            "natural_frequency_rad_s": round(2.0 * profile.damping_ratio / rest, 3),
        }
    }
