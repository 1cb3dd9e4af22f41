"""Settings of the emulated controller that is as late, and as noisy, as a measured one."""

import math
from typing import Any

from hil_bridge.devices.emulator_fit import RobotFigures, Sections
from hil_bridge.devices.robots.rtde.facts import robot_facts

_MOST_CYCLES = 100
"""Chosen: a robot that is later than that has another fault. The emulated one has one cycle at least."""


def match(settings: Any, figures: RobotFigures) -> Sections:
    """As `hil_bridge.devices.emulator_fit` says: whole cycles from a target to the arm, and the noise of the joints."""
    profile = settings.emulated
    found: dict[str, object] = {}
    servo = robot_facts(settings.client, profile).servo
    if servo is not None and not math.isnan(figures.servo_s):
        usual = servo.transport_delay_s + 2.0 * servo.damping_ratio / servo.natural_frequency_rad_s
        later = round((figures.servo_s - usual) / (profile.cycle_ms * 1e-3))
        found["follow_delay_cycles"] = min(max(1, profile.follow_delay_cycles + later), _MOST_CYCLES)
    if not math.isnan(figures.noise_ratio):
        rounding = (
            2.0 * math.pi / 2**profile.joint_bits * 1e6 / math.sqrt(12.0) if profile.joint_bits else 0.0
        )
        whole = (profile.joint_noise_urad**2 + rounding**2) * figures.noise_ratio**2
        found["joint_noise_urad"] = round(math.sqrt(max(whole - rounding**2, 0.0)), 2)
    return {"cell.rtde": found} if found else {}
