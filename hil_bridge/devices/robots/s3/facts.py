"""Facts of an S3 with a computer link, for recording, report and view."""

from emulators.arm.loops import ServoProfile
from hil_bridge.devices.facts import Pacing, RobotFacts, ServoFacts, Traffic
from hil_bridge.devices.robots.s3.hops import robot_hops
from protocol.devices.s3.adlp import ROUTINE, Count, LinkProfile, NoticeKind
from protocol.devices.s3.arap import STEPS_PER_METRE
from protocol.devices.s3.timing import line_floor
from protocol.marks import Mark, settings

UNDISTURBED = frozenset(
    {
        *ROUTINE,
        NoticeKind.NOISE,
        Count.BLOCKS_SENT,
        Count.BLOCKS_RECEIVED,
        Count.MESSAGES_SENT,
        Count.MESSAGES_RECEIVED,
    }
)
"""Link counters that increase in every exchange, and the counter of noise bytes."""
ERRORS = ("block repeated", "bid repeated", "time-out", "bad block", "bad checksum", "gap in block")
"""Link counters whose sum the view displays as link errors."""
_TRAFFIC = (
    Traffic("bids", NoticeKind.BID_SENT, NoticeKind.BID_RECEIVED),
    Traffic("blocks", Count.BLOCKS_SENT, Count.BLOCKS_RECEIVED),
)


def robot_facts(profile: LinkProfile, servo: ServoProfile | None = None) -> RobotFacts:
    """Return the robot's facts for the line settings of its URL and for the configured servo, if known."""
    order_step_m = 1.0 / STEPS_PER_METRE
    return RobotFacts(
        model="ABB S3, computer link",
        pacing=Pacing.ASKED,
        position_step_m=order_step_m if servo is None else servo.resolution_mm * 1e-3,
        order_step_m=order_step_m,
        line_floor_s=line_floor(profile),
        byte_time_s=profile.character_time,
        servo=None if servo is None else _servo_facts(servo),
        hops=robot_hops(profile),
        routine=tuple(sorted(UNDISTURBED)),
        errors=ERRORS,
        traffic=_TRAFFIC,
    )


def _servo_facts(servo: ServoProfile) -> ServoFacts:
    marks = {
        one.name: str(one.info.mark) if one.value == one.default else str(Mark.CHOSEN)
        for one in settings(servo)
    }
    return ServoFacts(
        servo.interpolation_ms * 1e-3,
        servo.transport_delay_ms * 1e-3,
        servo.natural_frequency_rad_s,
        servo.damping_ratio,
        servo.dead_band_steps,
        {
            "interpolation_s": marks["interpolation_ms"],
            "transport_delay_s": marks["transport_delay_ms"],
            "natural_frequency_rad_s": marks["natural_frequency_rad_s"],
            "damping_ratio": marks["damping_ratio"],
            "dead_band_steps": marks["dead_band_steps"],
        },
    )
