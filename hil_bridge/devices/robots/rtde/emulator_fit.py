"""Settings with which the emulated controller has the latency and noise of a measured controller."""

import math
from typing import Any

from hil_bridge.devices.emulator_fit import RobotFigures, Sections
from hil_bridge.devices.robots.rtde.facts import robot_facts

_MOST_CYCLES = 100
"""Largest delay of the emulated arm, cycles; the smallest is one cycle. Chosen: a robot with a longer delay has
another fault.
"""


def match(settings: Any, figures: RobotFigures) -> Sections:
    """Return the delay from a target to the arm in complete cycles, and the noise of the joints; see
    `hil_bridge.devices.emulator_fit`.
    """
    profile = settings.emulated
    section: dict[str, object] = {}
    servo = robot_facts(settings.client, profile).servo
    if servo is not None and not math.isnan(figures.servo_s):
        usual = servo.transport_delay_s + 2.0 * servo.damping_ratio / servo.natural_frequency_rad_s
        later = round((figures.servo_s - usual) / (profile.cycle_ms * 1e-3))
        section["follow_delay_cycles"] = min(max(1, profile.follow_delay_cycles + later), _MOST_CYCLES)
    if not math.isnan(figures.noise_ratio):
        rounding = (
            2.0 * math.pi / 2**profile.joint_bits * 1e6 / math.sqrt(12.0) if profile.joint_bits else 0.0
        )
        total = (profile.joint_noise_urad**2 + rounding**2) * figures.noise_ratio**2
        section["joint_noise_urad"] = round(math.sqrt(max(total - rounding**2, 0.0)), 2)
    return {"cell.rtde": section} if section else {}
