"""Tests of hostile calls of force mode, freedrive and contact: the arm stays within its limits, or stops."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from emulators.devices.rtde import RtdeProfile
from emulators.devices.rtde.kinematics import RANGE
from tests.emulation.test_urscript_motion import Bench

NUMBERS = st.sampled_from(
    ["0", "1", "-1", "1e-9", "1e9", "-1e300", "1e308*10", "(0/0)", "3.2", "True", '"x"', "[]", "None"]
)
SIX = st.lists(NUMBERS, min_size=6, max_size=6).map(lambda parts: f"[{', '.join(parts)}]")
POSES = st.lists(NUMBERS, min_size=6, max_size=6).map(lambda parts: f"p[{', '.join(parts)}]")
CALLS = st.one_of(
    st.builds("force_mode({}, {}, {}, {}, {})".format, POSES, SIX, SIX, NUMBERS, SIX),
    st.builds("force_mode_set_damping({})".format, NUMBERS),
    st.builds("force_mode_set_gain_scaling({})".format, NUMBERS),
    st.builds("freedrive_mode({}, {})".format, SIX, POSES),
    st.builds("tool_contact({}, {})".format, SIX, NUMBERS),
    st.builds("get_actual_joint_positions_history({})".format, NUMBERS),
    st.builds("speedl({}, 1, 0.01)".format, SIX),
    st.sampled_from(["zero_ftsensor()", "end_force_mode()", "end_freedrive_mode()", "sleep(0.01)"]),
)


@pytest.mark.full
@settings(max_examples=150, deadline=4000)
@given(st.lists(CALLS, max_size=6), st.sampled_from([0.0, 30.0, -1e6, 1e300]))
def test_arbitrary_force_calls_keep_arm_within_limits(calls: list[str], force: float) -> None:
    bench = Bench(RtdeProfile(script_steps=2000, start_delay_ms=2.0))
    bench.robot.feel(lambda at: (force, 0.0, -force))
    bench.send("def mine():\n  " + "\n  ".join([*calls, "sleep(0.05)"]) + "\nend\n")
    controller = bench.controller
    for _ in range(60):
        bench.run(controller.period)
        joints, speeds = controller.arm.joints, controller.arm.motion
        assert all(map(math.isfinite, (*joints, *speeds)))
        assert max(map(abs, joints)) <= RANGE + controller.profile.max_joint_speed_rad_s * controller.period


LARGE = st.lists(st.sampled_from([0, 1, -1, 10, -1000, 1e6, -1e9, 1e300]), min_size=6, max_size=6).map(str)


@settings(max_examples=60, deadline=4000)
@given(LARGE, LARGE, LARGE, st.sampled_from([1, 2, 3]))
def test_arbitrary_forces_keep_joint_speed_limits(axes: str, wrench: str, limits: str, kind: int) -> None:
    """Not even for the one cycle that the guard needs to detect a motion."""
    bench = Bench(RtdeProfile(start_delay_ms=2.0))
    bench.send(
        f"def mine():\n  force_mode(p[0,0,0,0,0,0], {axes}, {wrench}, {kind}, {limits})\n  sleep(9)\nend\n"
    )
    arm, period = bench.controller.arm, bench.controller.period
    for _ in range(60):
        before = arm.joints
        bench.run(period)
        leap = max(abs(b - a) for a, b in zip(before, arm.joints, strict=True))
        assert leap <= bench.controller.profile.max_joint_speed_rad_s * period * (1.0 + 1e-9)
