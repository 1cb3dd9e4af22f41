"""Stiffness and mode of each emulated arm in its start pose, against the sources and the page on surfaces."""

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from emulators.arm.compliance import ArmProfile, is_rigid, joint_compliance, mode_of
from emulators.arm.mode import Mode
from emulators.devices.egm import EgmController, EgmProfile
from emulators.devices.rsi import RsiController, RsiProfile
from emulators.devices.rtde import RtdeProfile, make_robot
from emulators.devices.s3 import S3Profiles
from emulators.devices.s3 import make_robot as make_s3
from emulators.seams import ArticulatedRobot, Floats, StartPose
from protocol.geometry import Pose

PAGE = Path(__file__).parents[2] / "docs/reference/surfaces.md"
DOWN = (0.0, 1.0, 0.0, 0.0)
FAR, NEAR = StartPose((0.9, -0.1, 0.6), DOWN, 0.2), StartPose((0.45, -0.1, 0.3), DOWN, 0.2)


def ur(model: str) -> Callable[[StartPose], ArticulatedRobot]:
    return lambda start: make_robot(RtdeProfile(model=model))(start, 0.0, 1)  # type: ignore[arg-type,return-value]


ROBOTS: dict[str, tuple[Callable[[StartPose], ArticulatedRobot], StartPose, float]] = {
    "s3": (lambda start: make_s3(S3Profiles())(start, 0.0, 1), FAR, 85.5),
    "egm": (lambda start: EgmController(EgmProfile(), start, 0.0, 1), FAR, 85.5),
    "rsi": (lambda start: RsiController(RsiProfile(), start, 0.0), FAR, 85.5),
    "ur10e": (ur("ur10e"), FAR, 29.1),
    "ur10": (ur("ur10"), FAR, 28.4),
    "ur5e": (ur("ur5e"), NEAR, 17.7),
    "ur5": (ur("ur5"), NEAR, 17.0),
}
"""Factory and start pose of each arm, and the mass of its moving links, kg: Universal Robots, Parameters for
calculations of kinematics and dynamics; the others as an IRB 2400 (Obal and Gierlak 2025).
"""
GEARED, COLLABORATIVE = (31.0, 714.0), (15.0, 112.0)
"""Range of the Cartesian stiffness, kN/m.

Collaborative arms for surgery have 31 to 56 (Scientific Reports 2024, doi 10.1038/s41598-024-61362-2, table 3), here
with a factor of 2. Industrial arms are stiffer than these, and softer than the 714 of the softest pose of one for
machining (1.4e-6 m/N; Wu and Kuhlenkoetter, Applied Sciences 2020, doi 10.3390/app10238332).
"""


def stiffness_kn_m(name: str) -> tuple[ArticulatedRobot, Floats]:
    make, start, _ = ROBOTS[name]
    robot = make(start)
    joints = robot.joints_holding(Pose(start.position, start.quaternion), 0.0)  # type: ignore[attr-defined]
    return robot, 1e-3 / np.diag(joint_compliance(robot, joints, robot.joint_stiffness))[:3]


@pytest.mark.parametrize("name", ROBOTS)
def test_stiffness_in_start_pose_is_that_of_its_class(name: str) -> None:
    low, high = COLLABORATIVE if name.startswith("ur") else GEARED
    _, stiffness = stiffness_kn_m(name)
    assert low < stiffness.min() < stiffness.max() < high


@pytest.mark.parametrize("name", ROBOTS)
def test_mode_moves_a_part_of_the_mass_of_the_arm(name: str) -> None:
    robot, stiffness = stiffness_kn_m(name)
    mass = stiffness * 1e3 / Mode(*robot.mode).stiffness
    assert 2.0 < mass.min() < mass.max() < ROBOTS[name][2]


@pytest.mark.parametrize("name", ROBOTS)
def test_page_lists_stiffness_and_mode_of_arm(name: str) -> None:
    robot, stiffness = stiffness_kn_m(name)
    row = re.search(rf"^\| `{name}`.*$", PAGE.read_text(encoding="utf-8"), re.MULTILINE)
    assert row is not None
    _, joints, cartesian, mode, *_ = (cell.strip() for cell in row[0].strip("|").split("|"))
    assert joints == ", ".join(f"{value / 1e3:g}" for value in robot.joint_stiffness)
    assert cartesian == ", ".join(f"{value:.0f}" for value in stiffness)
    assert mode == "{:g} Hz, {:.2f}".format(*robot.mode)


def test_settings_of_mode_take_precedence_over_model() -> None:
    robot = ROBOTS["ur5e"][0](NEAR)
    assert mode_of(ArmProfile(), robot) == robot.mode
    assert mode_of(ArmProfile(frequency_hz=30.0), robot) == (30.0, robot.mode[1])
    assert mode_of(ArmProfile(damping_ratio=0.2), robot) == (robot.mode[0], 0.2)
    assert mode_of(ArmProfile(), object()) == (15.0, 0.03)


def test_arm_with_joint_model_is_compliant_by_default() -> None:
    robot = ROBOTS["ur5e"][0](NEAR)
    assert not is_rigid(ArmProfile(), robot)
    assert is_rigid(ArmProfile(compliance="rigid"), robot)
    assert is_rigid(ArmProfile(), object())
    assert not is_rigid(ArmProfile(compliance="cartesian"), object())
