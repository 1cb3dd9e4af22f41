"""Facts of the robot, for a run."""

from hil_bridge.devices.facts import Pacing, RobotFacts, ServoFacts
from hil_bridge.devices.robots.streamed import STALE
from hil_xarm.profile import XarmProfile
from hil_xarm.settings import XarmSettings
from protocol.marks import Mark, settings


def robot_facts(client: XarmSettings, assumed: XarmProfile) -> RobotFacts:
    """Return the facts for these settings. The servo is assumed to equal that of the emulated control box."""
    marks = {
        item.name: str(item.info.mark if item.value == item.default else Mark.CHOSEN)
        for item in settings(assumed)
    }
    return RobotFacts(
        "UFACTORY xArm, servo mode",
        Pacing.STREAMED,
        cycle_s=client.cycle_s,
        late="it stands at the last pose, and goes on with the next",
        servo=ServoFacts(
            assumed.cycle_s,
            assumed.transport_delay_ms / 1e3,
            assumed.natural_frequency_rad_s,
            assumed.damping_ratio,
            marks={
                "interpolation_s": marks["control_ms"],
                "transport_delay_s": marks["transport_delay_ms"],
                "natural_frequency_rad_s": marks["natural_frequency_rad_s"],
                "damping_ratio": marks["damping_ratio"],
            },
        ),
        errors=(STALE,),  # TCP loses no reports
    )
