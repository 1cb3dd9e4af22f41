"""Kinematics of a chain of six joints whose wrist is not spherical."""

import math

import numpy as np
import pytest

from emulators.arm.chain import ArmShape, Chain, Link, straight_tool, tool_on
from protocol.geometry import Pose, Vector, angle_between, rotation_vector, turn_between

UP, LEFT, DOWN = (0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (0.0, 0.0, -1.0)
SHAPE = ArmShape(
    (
        Link((0.0, 0.0, 300.0), UP),
        Link((0.0, 0.0, 0.0), LEFT),
        Link((50.0, 0.0, 280.0), LEFT),
        Link((80.0, 0.0, 0.0), DOWN),
        Link((0.0, 0.0, -340.0), LEFT),
        Link((75.0, 0.0, 0.0), DOWN),
    ),
    (0.0, 0.0, -100.0),
    (0.0, 1.0, 0.0, 0.0),
    (-360.0, -120.0, -220.0, -360.0, -95.0, -360.0),
    (360.0, 120.0, 10.0, 360.0, 180.0, 360.0),
)
ARM = Chain(SHAPE, straight_tool(0.2))
JOINTS = (12.0, -15.0, -40.0, 8.0, 30.0, -20.0)


def test_pose_at_zero_is_the_sum_of_the_offsets() -> None:
    pose = ARM.pose((0.0,) * 6)
    assert pose.position == pytest.approx((0.205, 0.0, -0.06))
    assert pose.quaternion == pytest.approx((0.0, 1.0, 0.0, 0.0))


def test_jacobian_is_the_derivative_of_the_pose() -> None:
    pose, jacobian = ARM.frames(JOINTS)
    step = 1e-4
    for axis in range(6):
        moved = [q + math.degrees(step) * (k == axis) for k, q in enumerate(JOINTS)]
        after = ARM.pose((moved[0], moved[1], moved[2], moved[3], moved[4], moved[5]))
        turn = rotation_vector(turn_between(pose.quaternion, after.quaternion))
        motion = [*(np.array(after.position) - pose.position), *turn]
        assert motion == pytest.approx(jacobian[:, axis] * step, abs=1e-7)


def test_nearest_returns_the_joints_of_a_pose() -> None:
    near = ARM.nearest(ARM.pose(JOINTS), (10.0, -10.0, -45.0, 0.0, 35.0, -10.0))
    assert near == pytest.approx(JOINTS, abs=1e-6)


def test_holding_prefers_the_posture_nearest_to_zero() -> None:
    pose = ARM.pose(JOINTS)
    other = ARM.holding(pose, [(12.0, -15.0, -40.0, 188.0, -30.0, 160.0)])
    assert other is not None, "the wrist is flipped"
    assert angle_between(ARM.pose(other).quaternion, pose.quaternion) < 1e-8
    assert ARM.holding(pose, [other, JOINTS]) == pytest.approx(JOINTS, abs=1e-6)


@pytest.mark.parametrize("place", [(1.5, 0.0, 0.3), (0.1, 0.0, -0.5)])
def test_pose_without_joints_in_their_ranges_is_refused(place: Vector) -> None:
    assert ARM.nearest(Pose(place, (0.0, 1.0, 0.0, 0.0)), JOINTS) is None


def test_tool_follows_from_a_reported_pose() -> None:
    tool = tool_on(ARM.flange(JOINTS), ARM.pose(JOINTS))
    assert tool.position == pytest.approx((0.0, 0.0, 0.2))
    assert ARM.tip_of(ARM.flange_of(ARM.pose(JOINTS))).position == pytest.approx(ARM.pose(JOINTS).position)
