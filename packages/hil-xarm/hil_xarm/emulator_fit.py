"""Settings with which the emulated devices have the figures of measured ones; see `hil_bridge.devices.emulator_fit`."""

import math
from typing import Any

from hil_bridge.devices.emulator_fit import RobotFigures, Sections, SensorFigures, given, known


def match_robot(settings: Any, figures: RobotFigures) -> Sections:
    """Return a delay of complete cycles and a natural frequency."""
    if math.isnan(figures.servo_s):
        return {}
    profile = settings.emulated
    response = 2.0 * profile.damping_ratio / profile.natural_frequency_rad_s
    cycles = max(0, math.floor((figures.servo_s - response) / profile.cycle_s))
    rest = max(figures.servo_s - cycles * profile.cycle_s, 0.1 * response)
    return {
        "cell.xarm": {
            "transport_delay_ms": cycles * profile.control_ms,
            "natural_frequency_rad_s": round(2.0 * profile.damping_ratio / rest, 3),
        }
    }


def match_sensor(settings: Any, figures: SensorFigures) -> Sections:
    """Return noise and drift."""
    return {
        "cell.xarm": given(
            noise_n=known(figures.noise[:3]),
            noise_nm=known(figures.noise[3:]),
            slope_n_min=known(figures.drift_n_min),
        )
    }
