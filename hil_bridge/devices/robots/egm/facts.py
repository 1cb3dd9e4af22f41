"""Facts of a robot with Externally Guided Motion, for recording, report and view."""

from emulators.devices.egm import EgmProfile
from hil_bridge.devices.facts import Pacing, RobotFacts, ServoFacts, WitnessFacts
from hil_bridge.devices.robots.egm.settings import EgmSettings
from protocol.marks import Mark, settings

ORDINARY_N = 12.0
"""Difference of the robot's force estimate from the force sensor in normal operation, N. Assumed: as for a robot
with a built-in sensor at the wrist; ABB has not published a value.
"""
WITNESS_DELAY_S = 0.01
"""Time constant of the filter of the robot's force estimate, s. Assumed: as for the built-in sensor at the wrist."""


def robot_facts(client: EgmSettings, assumed: EgmProfile) -> RobotFacts:
    """Return the robot's facts for the client's settings. The servo is assumed to equal the servo of the emulated
    robot.
    """
    return RobotFacts(
        model="ABB, Externally Guided Motion",
        pacing=Pacing.STREAMED,
        cycle_s=client.sample_ms * 1e-3,
        servo=_servo_facts(assumed, 0.0 if client.feed_forward else _trail_s(assumed)),
        late="the controller continues with the last pose and speed, takes a late message a cycle later, and stops "
        "after CommTimeout without one",
        witness=None if client.force_axes == "none" else WitnessFacts(ORDINARY_N, WITNESS_DELAY_S),
    )


def _trail_s(profile: EgmProfile) -> float:
    """Return the time constant of the set point without feed-forward, s: 1 / gain. With a gain of 0, the set point
    never arrives.
    """
    gain = profile.k * profile.pos_corr_gain
    return 1.0 / gain if gain else 0.0


def _servo_facts(profile: EgmProfile, trail_s: float) -> ServoFacts:
    arm = profile.arm
    marks = {
        one.name: str(one.info.mark) if one.value == one.default else str(Mark.CHOSEN)
        for one in (*settings(profile), *settings(arm))
    }
    cycles = profile.ref_delay_cycles + arm.servo_delay_cycles
    return ServoFacts(
        interpolation_s=profile.cycle_ms * 1e-3,
        transport_delay_s=cycles * profile.cycle_ms * 1e-3,
        natural_frequency_rad_s=arm.natural_frequency_rad_s,
        damping_ratio=arm.damping_ratio,
        trail_s=trail_s,
        marks={
            "interpolation_s": marks["cycle_ms"],
            "transport_delay_s": marks["ref_delay_cycles"],
            "natural_frequency_rad_s": marks["natural_frequency_rad_s"],
            "damping_ratio": marks["damping_ratio"],
            **({"trail_s": marks["k"]} if trail_s else {}),
        },
    )
