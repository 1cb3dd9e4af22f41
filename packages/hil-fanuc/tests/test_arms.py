"""Kinematics of the arms."""

import math

import pytest
from hil_fanuc.arms import MODELS, FanucArm, from_pendant, to_pendant

from emulators.arm.chain import straight_tool, tool_on
from protocol.geometry import Pose, angle_between, angles_of, from_angles

OBSERVED_JOINTS = (92.678, 2.595, -1.380, -45.464, -27.230, -11.037)
OBSERVED_PLATE = (20.166, 703.511, 504.091, -115.210, -26.319, 35.132)
OBSERVED_TIP = (-43.921, 852.017, 437.279)
"""One report of a CRX-10iA/L, and the position of the tip of its tool of 175 mm over RMI: airo-ugent/airo-fanuc,
docs/controller-notes.md, 1.10.
"""


def test_crx_reports_its_face_plate_in_the_world_frame() -> None:
    pose = FanucArm("crx-10ia/l", straight_tool(0.175)).face_plate(OBSERVED_JOINTS)
    r, p, w = angles_of(pose.quaternion)
    position = [1e3 * part for part in pose.position]
    # the joints are rounded to 0.001°, which is 10 µm at 0.7 m
    assert position == pytest.approx(OBSERVED_PLATE[:3], abs=0.015)
    assert (w, p, r) == pytest.approx(OBSERVED_PLATE[3:], abs=0.002)


def test_tool_extends_along_z_of_the_face_plate() -> None:
    arm = FanucArm("crx-10ia/l", straight_tool(0.175), 0.0)
    assert [1e3 * part for part in arm.pose(OBSERVED_JOINTS).position] == pytest.approx(
        OBSERVED_TIP, abs=0.015
    )


def test_tool_is_learnt_from_joints_and_pose() -> None:
    x, y, z = (part / 1e3 for part in OBSERVED_TIP)
    w, p, r = OBSERVED_PLATE[3:]
    plate = FanucArm("crx-10ia/l", straight_tool(0.0)).face_plate(OBSERVED_JOINTS)
    tool = tool_on(plate, Pose((x, y, z), from_angles(r, p, w)))
    assert tool.position == pytest.approx((0.0, 0.0, 0.175), abs=2e-5)


def test_pendant_measures_j3_against_the_horizontal() -> None:
    """Two poses of airo-ugent/airo-fanuc, 1.5."""
    assert to_pendant((0.0, 11.6950, 7.7610, 0.0, 0.0, 0.0))[2] == pytest.approx(-3.9340)
    assert to_pendant((0.0, 36.6920, 7.7570, 0.0, 0.0, 0.0))[2] == pytest.approx(-28.9350)
    assert from_pendant(to_pendant(OBSERVED_JOINTS)) == pytest.approx(OBSERVED_JOINTS)


def test_forearm_keeps_its_slope_if_pendant_j3_is_constant() -> None:
    arm = FanucArm("m-10ia", straight_tool(0.0))
    slopes = [arm.pose(from_pendant((0.0, lean, -10.0, 0.0, 0.0, 0.0))).quaternion for lean in (0.0, 40.0)]
    assert angle_between(*slopes) == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("quaternion", [(0.0, 1.0, 0.0, 0.0), (0.1, 0.975, 0.15, 0.129)])
def test_inverse_kinematics_returns_the_pose(model: str, quaternion: tuple[float, ...]) -> None:
    norm = math.hypot(*quaternion)
    w, x, y, z = (part / norm for part in quaternion)
    pose = Pose((0.9, -0.1, 0.6), (w, x, y, z))
    arm = FanucArm(model, straight_tool(0.2))
    joints = arm.at_rest(pose)
    assert joints is not None
    assert math.dist(arm.pose(joints).position, pose.position) < 1e-8
    assert angle_between(arm.pose(joints).quaternion, pose.quaternion) < 1e-8
    near = arm.nearest(Pose((0.902, -0.1, 0.599), pose.quaternion), joints)
    assert near is not None
    assert max(abs(a - b) for a, b in zip(near, joints, strict=True)) < 1.0


@pytest.mark.parametrize("position", [(2.5, 0.0, 0.5), (0.0, 0.0, 0.25)])
def test_pose_out_of_reach_has_no_joints(position: tuple[float, float, float]) -> None:
    assert FanucArm("crx-10ia/l", straight_tool(0.0)).at_rest(Pose(position, (0.0, 1.0, 0.0, 0.0))) is None


def test_torques_are_those_of_a_lever() -> None:
    arm = FanucArm("crx-10ia/l", straight_tool(0.0))
    joints = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    x, _, z = arm.pose(joints).position
    torques = arm.torques(joints, (0.0, 0.0, -10.0))
    assert torques[0] == pytest.approx(0.0, abs=1e-12)
    assert torques[1] == pytest.approx(10.0 * x)
    assert torques[2] == pytest.approx(-10.0 * x)
    assert z == pytest.approx(0.245 + 0.71)
