"""Settings with which the emulated controller has the latency of a measured controller."""

import math
from typing import Any

from hil_bridge.devices.emulator_fit import RobotFigures, Sections


def match(settings: Any, figures: RobotFigures) -> Sections:
    """Return the delay in complete cycles, and a natural frequency for the remaining delay; see
    `hil_bridge.devices.emulator_fit`.
    """
    if math.isnan(figures.servo_s):
        return {}
    profile = settings.emulated
    arm, cycle_s = profile.arm, profile.cycle_ms * 1e-3
    usual = 2.0 * arm.damping_ratio / arm.natural_frequency_rad_s
    cycles = max(0, round((figures.servo_s - usual) / cycle_s) - arm.servo_delay_cycles)
    rest = max(figures.servo_s - (cycles + arm.servo_delay_cycles) * cycle_s, 0.1 * usual)
    return {
        "cell.egm": {"ref_delay_cycles": min(cycles, 100)},
        "cell.egm.arm": {"natural_frequency_rad_s": round(2.0 * arm.damping_ratio / rest, 3)},
    }
