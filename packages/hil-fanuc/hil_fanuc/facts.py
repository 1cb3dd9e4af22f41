"""Facts of a FANUC robot, for a run."""

from hil_bridge.devices.facts import Pacing, RobotFacts, ServoFacts, WitnessFacts
from hil_fanuc.profile import FanucProfile
from hil_fanuc.settings import FanucSettings
from protocol.marks import Mark, settings

_ORDINARY_N = 12.0
"""Difference of the robot's force from a force sensor in normal operation, N. Assumed: as for other sensors."""
_WITNESS_DELAY_S = 0.01
"""Time constant of the filter of the reported force, s. Assumed."""
DECISION_S = 0.096
"""Default period of a run, s. Chosen: the arm follows set points 84 ms later at least. With decisions in each cycle,
the force on a surface of 50 kN/m oscillates.
"""
LIMITER_TRAIL_S = 0.04
"""Delay of the client's set points behind those of a run, s. Derived: the square root of 10 mm/s by the 7 m/s³ that the
limits of a CRX allow its tool; see `path_limiter`.
"""


def robot_facts(client: FanucSettings, assumed: FanucProfile) -> RobotFacts:
    """Return the facts for these settings. The servo is assumed to equal that of the emulated controller."""
    marks = {
        item.name: str(item.info.mark if item.value == item.default else Mark.CHOSEN)
        for item in settings(assumed)
    }
    has_force = client.sensor != "none"
    return RobotFacts(
        f"FANUC {client.model.upper()}, Stream Motion",
        Pacing.STREAMED,
        cycle_s=client.cycle_s,
        decision_s=DECISION_S,
        late="it goes on at the last speed, and stops after about 0.1 s without a set point",
        servo=ServoFacts(
            client.cycle_s,
            assumed.transport_delay_ms / 1e3,
            assumed.natural_frequency_rad_s,
            assumed.damping_ratio,
            trail_s=LIMITER_TRAIL_S,
            marks={
                "interpolation_s": marks["cycle_ms"],
                "transport_delay_s": marks["transport_delay_ms"],
                "natural_frequency_rad_s": marks["natural_frequency_rad_s"],
                "damping_ratio": marks["damping_ratio"],
                "trail_s": str(Mark.DERIVED),
            },
        ),
        witness=WitnessFacts(_ORDINARY_N, _WITNESS_DELAY_S) if has_force else None,
    )
