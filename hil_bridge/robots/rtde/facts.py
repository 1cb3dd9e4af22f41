"""Facts of a controller of Universal Robots, for a run."""

import math

from emulators.rtde import RtdeProfile
from hil_bridge.facts import RobotFacts, ServoFacts
from hil_bridge.robots.seam import Pacing
from protocol.marks import Mark
from protocol.rtde.profile import ClientProfile

_DELAY_CYCLES = 2.0
"""From an input package to the arm. Derived of measurements: two to three cycles there and back."""
_LATE = "its program goes to the last target, brakes after hold_cycles without a new one, and goes on with the next"
"""Reaction of the program to a late target."""


def robot_facts(client: ClientProfile, emulated: RtdeProfile) -> RobotFacts:
    """Facts with these settings; the servo is that of the emulator's model."""
    stiffness = emulated.servo_gain_scale * client.gain
    frequency = math.sqrt(stiffness)
    marks = {
        "interpolation_s": Mark.OBSERVED,
        "transport_delay_s": Mark.DERIVED,
        "natural_frequency_rad_s": Mark.ASSUMED,
        "damping_ratio": Mark.ASSUMED,
    }
    servo = ServoFacts(
        interpolation_s=client.cycle_s,
        transport_delay_s=_DELAY_CYCLES * client.cycle_s,
        natural_frequency_rad_s=frequency,
        damping_ratio=client.lookahead_s * frequency / 2.0,
        marks={name: mark.value for name, mark in marks.items()},
    )
    return RobotFacts(
        "Universal Robots, RTDE", Pacing.STREAMED, cycle_s=client.cycle_s, servo=servo, late=_LATE
    )
