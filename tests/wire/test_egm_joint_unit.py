"""Joints of a guided robot that match its pose in the other unit only."""

import math

import pytest

from emulators.devices.egm.profile import EgmArmProfile
from protocol.devices.egm import JointCheck, JointUnit, Place, PoseMm
from protocol.kinematics import Arm
from tests.wire.egm_conversation import Conversation, robot_report


def joint_place(unit: float, tool_mm: float = 150.0) -> Place:
    """Feedback of the emulated arm at some joints, in degrees times `unit`, and the matching pose."""
    arm = Arm(EgmArmProfile(), tool_mm * 1e-3)
    joints = (0.2, 0.1, 0.3, -0.2, 1.1, 0.4)
    position, quaternion = arm.pose(joints)
    x, y, z = (part * 1e3 for part in position)
    degrees = tuple(math.degrees(joint) * unit for joint in joints)
    return Place(degrees, PoseMm((x, y, z), quaternion), (), 1_700_000_000_000_000)


@pytest.mark.parametrize("tool_mm", [0.0, 150.0])
@pytest.mark.parametrize(("sent", "read"), [("radians", "degrees"), ("degrees", "radians")])
def test_client_refuses_joints_that_match_the_other_unit(
    sent: JointUnit, read: JointUnit, tool_mm: float
) -> None:
    place = joint_place(math.radians(1.0) if sent == "radians" else 1.0, tool_mm)
    robot = Conversation(joints=JointCheck(Arm(EgmArmProfile(), 0.0), read))
    robot.receive(robot_report(1, feedback=place, planned=place))
    (report,) = robot.reports
    assert report.fault == f"its joints, read in {read}, contradict its own pose; they match it in {sent}"
    assert report.remedy == f'set robot.egm.joints_in to "{sent}"'
    right = Conversation(joints=JointCheck(Arm(EgmArmProfile(), 0.0), sent))
    right.receive(robot_report(1, feedback=place, planned=place))
    assert right.reports[0].fault == ""


def test_joints_of_an_unknown_arm_or_tool_are_not_refused() -> None:
    place = joint_place(math.radians(1.0))
    other = EgmArmProfile(upper_arm_mm=1075.0, forearm_mm=1392.0)
    robot = Conversation(joints=JointCheck(Arm(other, 0.0), "degrees"))
    robot.receive(robot_report(1, feedback=place, planned=place))
    few = place._replace(joints_deg=(0.0,) * 4)
    robot.receive(robot_report(2, feedback=few, planned=few))
    nan = place._replace(joints_deg=(math.nan,) * 6)
    robot.receive(robot_report(3, feedback=nan, planned=nan))
    assert [report.fault for report in robot.reports] == ["", "", ""]
