"""Facts of a Universal Robots controller, for a run."""

import math

from emulators.devices.rtde import RtdeProfile
from hil_bridge.devices.facts import RobotFacts, ServoFacts, WitnessFacts
from hil_bridge.devices.robots.seam import Pacing
from hil_bridge.devices.robots.streamed import STALE
from protocol.devices.rtde.profile import ClientProfile
from protocol.marks import Mark

_DELAY_CYCLES = 2.0
"""Delay from an input package to the arm, cycles. Derived from measurements: two to three cycles there and back."""
_LATE = "its program moves to the last target, brakes after hold_ms without a new one, and continues with the next"
"""Description of the program's reaction to a late target."""
_ORDINARY_N, _ORDINARY_CB3_N = 12.0, 25.0
"""Differences between the robot's force estimate and a force sensor in normal operation, N. Derived from recordings
of real arms. An e-Series: 4 N of zero drift after power-up, three times its noise of 0.34 N in motion, and 6 N for
3 kg accelerated by 2 m/s². A CB3 has no sensor: its manufacturer specifies ±10 N, ten lifts of 3 kg had a standard
deviation of 3.6 N, and the zero differs from pose to pose.
"""
_NOISE_M, _NOISE_CB3_M = 1e-5, 4e-6
"""Noise of the reported position, m. Observed on stationary arms: median of each axis of actual_TCP_pose, 5 to 15
µm for an e-Series, 1.4 to 6 µm for a CB3.
"""
_CB3_CYCLE_S = 0.008
"""Cycle time of a CB3, s. Observed. An e-Series with this cycle time is treated as a CB3."""
_WITNESS_DELAY_S = 0.01
"""Time constant of the filter of actual_TCP_force, s. Assumed: its noise is white up to 25 to 60 Hz."""


def robot_facts(client: ClientProfile, emulated: RtdeProfile) -> RobotFacts:
    """Return the robot's facts for these settings. The servo is the servo of the emulator's model."""
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
        errors=(STALE,),  # TCP loses no packets: a missing packet was never sent
        witness=witness,
    )
