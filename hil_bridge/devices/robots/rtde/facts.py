"""Facts of a Universal Robots controller, for a run."""

import math

from emulators.devices.rtde import RtdeProfile
from hil_bridge.devices.facts import RobotFacts, ServoFacts, WitnessFacts
from hil_bridge.devices.robots.seam import Pacing
from hil_bridge.devices.robots.streamed import STALE
from protocol.devices.rtde.profile import ClientProfile
from protocol.marks import Mark

_DELAY_CYCLES = 2.0
"""Delay from an input package to the arm. Derived from measurements: two to three cycles there and back."""
_LATE = "its program moves to the last target, brakes after hold_ms without a new one, and continues with the next"
"""Reaction of the program to a late target."""
_ORDINARY_N, _ORDINARY_CB3_N = 12.0, 25.0
"""Derived from recordings of real arms. An e-Series: 4 N of zero drift after power-up, three times its noise of 0.34 N
in motion, and 6 N for 3 kg accelerated by 2 m/s². A CB3 has no sensor: its maker specifies ±10 N, ten lifts of 3 kg had
a standard deviation of 3.6 N, and the zero differs from pose to pose.
"""
_NOISE_M, _NOISE_CB3_M = 1e-5, 4e-6
"""Observed on stationary arms: median of each axis of actual_TCP_pose. An e-Series 5 to 15 µm, a CB3 1.4 to 6 µm."""
_CB3_CYCLE_S = 0.008
"""Observed: cycle of a CB3. An e-Series with the same cycle is treated as one, too."""
_WITNESS_DELAY_S = 0.01
"""Assumed: filter of actual_TCP_force; its noise is white up to 25 to 60 Hz."""


def robot_facts(client: ClientProfile, emulated: RtdeProfile) -> RobotFacts:
    """Return the facts with these settings; the servo is that of the emulator's model."""
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
    old = client.cycle_s >= _CB3_CYCLE_S
    witness = WitnessFacts(_ORDINARY_CB3_N if old else _ORDINARY_N, _WITNESS_DELAY_S)
    return RobotFacts(
        "Universal Robots, RTDE",
        Pacing.STREAMED,
        cycle_s=client.cycle_s,
        servo=servo,
        position_noise_m=_NOISE_CB3_M if old else _NOISE_M,
        late=_LATE,
        errors=(STALE,),  # TCP loses no packet: one that is missing was never sent
        witness=witness,
    )
