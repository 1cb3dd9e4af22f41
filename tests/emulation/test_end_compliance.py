"""Compliance of sensor and tool in series with the arm, against closed forms."""

import math
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from emulators.arm.compliance import ArmProfile, Load, bearing_of
from emulators.arm.end_compliance import end_compliance
from emulators.arm.waypoints import Waypoint
from emulators.cell import Cell, Parts
from emulators.devices.jr3 import SensorProfile, make_gateway
from emulators.devices.s3 import EMPTY_SITE, make_robot
from emulators.seams import Floats
from emulators.surface.contact import SurfaceProfile
from emulators.tool import ToolProfile, rotation_matrix
from hil_bridge.runs.compose import make_cell
from hil_bridge.runs.setup import Setup
from hil_bridge.settings.configuration import read_config
from protocol.geometry import Quaternion, normalise
from protocol.marks import SettingError
from tests.paper_cell import RIGID_ARM, PaperCellProfile

T0 = 777.125
DOWN = (0.0, 1.0, 0.0, 0.0)
ARM, ALONG, ACROSS, SURFACE = 30e3, 20e3, 10e3, 50e3
LENGTH, GRAVITY = 0.2, 9.80665
CARTESIAN = ArmProfile(compliance="cartesian", stiffness_n_m=(ARM, ARM, ARM, 0.0, 0.0, 0.0))
SOFT_TOOL = ToolProfile(length_mm=LENGTH * 1e3, mass_kg=0.0, stiffness_n_m=(ALONG, ACROSS))
SOFT_SENSOR = SensorProfile(stiffness_n_m=(40e3, 50e3, 60e3), stiffness_nm_rad=(2e3, 3e3, 4e3))


def series(*stiffness: float) -> float:
    return 1.0 / sum(1.0 / k for k in stiffness)


def pressing_cell(arm: ArmProfile, tool: ToolProfile, height: float = 0.589) -> Cell[Any, Any]:
    """Return a cell of S3 and JR3 that moves to a height, m; the surface is at 0.59 m."""
    profile = PaperCellProfile(
        arm=arm, tool=tool, surface=SurfaceProfile(stiffness_n_m=SURFACE), sensor=SOFT_SENSOR
    )
    sensor = make_gateway(profile.sensor, profile.gateway)
    parts = Parts(make_robot(profile, EMPTY_SITE), sensor, sensor_stiffness=profile)
    cell = Cell(profile, T0, 5, parts)
    cell.robot.motion.enqueue(Waypoint((0.9, 0.0, height), DOWN, 1000.0), T0)
    return cell


def base_compliance(quaternion: Quaternion, tool: ToolProfile) -> Floats:
    """Return the total compliance (6, 6) for a tool with this orientation."""
    path = SimpleNamespace(
        trajectory=lambda times: (np.zeros((1, 3)), np.zeros((1, 3))),
        orientations=lambda times: [(slice(0, 1), quaternion)],
    )
    robot = cast(Any, SimpleNamespace(path=path))
    load = Load(1.0, (0.0, 0.0, -0.1))
    return bearing_of(CARTESIAN, robot, load, end_compliance(tool, SOFT_SENSOR))(T0).compliance


def test_end_compliance_has_textbook_lever_terms() -> None:
    sensor, tool = end_compliance(SOFT_TOOL, SOFT_SENSOR)
    along_x, about_y = (sensor @ np.eye(6)[axis] for axis in (0, 4))
    # a force along x at the tip turns the sensor about y
    assert along_x == pytest.approx([1 / 40e3 + LENGTH**2 / 3e3, 0, 0, 0, LENGTH / 3e3, 0])
    assert about_y == pytest.approx([LENGTH / 3e3, 0, 0, 0, 1 / 3e3, 0])
    assert sensor[1, 1] == pytest.approx(1 / 50e3 + LENGTH**2 / 2e3)
    assert sensor[1, 3] == pytest.approx(-LENGTH / 2e3)
    assert (sensor[2, 2], sensor[5, 5]) == pytest.approx((1 / 60e3, 1 / 4e3))
    np.testing.assert_array_equal(tool, np.diag([1 / ACROSS, 1 / ACROSS, 1 / ALONG, 0, 0, 0]))


def test_rigid_sensor_and_tool_add_no_compliance() -> None:
    sensor, tool = end_compliance(ToolProfile(), None)
    assert not sensor.any()
    assert not tool.any()


def test_end_compliance_turns_with_the_tool() -> None:
    quaternion = normalise((0.3, 0.8, -0.4, 0.2))
    total = base_compliance(quaternion, SOFT_TOOL)
    end = end_compliance(SOFT_TOOL, SOFT_SENSOR)
    in_tool = end.sensor + end.tool
    for axis, direction in enumerate(rotation_matrix(quaternion).T):
        moved = total @ np.concatenate((direction, np.zeros(3)))
        assert direction @ moved[:3] == pytest.approx(in_tool[axis, axis] + 1.0 / ARM)
        assert moved[3:] == pytest.approx(rotation_matrix(quaternion) @ in_tool[3:, axis])
    np.testing.assert_allclose(total, total.T, atol=1e-18)
    assert np.linalg.eigvalsh(total)[0] > 0.0


@pytest.mark.parametrize(
    ("tool", "springs"),
    [(SOFT_TOOL, (ARM, 60e3, ALONG)), (ToolProfile(mass_kg=0.0), (ARM, 60e3))],
)
def test_press_at_rest_has_springs_in_series(tool: ToolProfile, springs: tuple[float, ...]) -> None:
    rigid = pressing_cell(RIGID_ARM, ToolProfile(mass_kg=0.0)).true_state(T0 + 8.0).contact_force[2]
    soft = pressing_cell(CARTESIAN, tool).true_state(T0 + 8.0).contact_force[2]
    assert soft == pytest.approx(rigid * series(SURFACE, *springs) / SURFACE, rel=1e-6)


def test_weight_acts_on_arm_and_sensor_only() -> None:
    tool = ToolProfile(mass_kg=2.0, stiffness_n_m=(ALONG, ACROSS))
    cell = pressing_cell(CARTESIAN, tool, 0.65)
    free = cell.robot.path.trajectory(np.array([T0 + 8.0]))[0][0, 2]
    sag = cell.true_state(T0 + 8.0).position[2] - free
    assert sag == pytest.approx(-2.0 * GRAVITY / series(ARM, 60e3), rel=1e-6)


def test_springs_of_sensor_and_tool_need_compliant_arm() -> None:
    cell = pressing_cell(RIGID_ARM, SOFT_TOOL)
    assert cell.path is cell.robot.path


@pytest.mark.parametrize(
    ("kind", "section"),
    [("jr3", ("jr3", "sensor")), ("netft", ("netft",)), ("ft300", ("ft300",)), ("ati-can", ("ati_can",))],
)
def test_cell_has_stiffness_of_configured_sensor(kind: str, section: tuple[str, ...]) -> None:
    settings: dict[str, Any] = {"stiffness_n_m": [1e5, 1e5, 1e4]}
    for name in reversed(section):
        settings = {name: settings}
    tool = {"mass_kg": 2.0, "centre_of_gravity_mm": [0.0, 0.0, 80.0]}
    stiff = {"compliance": "cartesian", "stiffness_n_m": [1e15, 1e15, 1e15, 0.0, 0.0, 0.0]}
    config = read_config({"sensor": {"emulated": kind}, "cell": {**settings, "tool": tool, "arm": stiff}})
    cell = make_cell(Setup(config), T0)
    start = config.cell.start_position_mm[2] * 1e-3
    assert cell.true_state(T0).position[2] == pytest.approx(start - 2.0 * GRAVITY / 1e4, rel=1e-9)


@pytest.mark.parametrize("stiffness", [(0.0, 1e4), (1e4, -1.0), (math.nan, 1e4)])
def test_stiffness_of_tool_must_be_positive(stiffness: tuple[float, float]) -> None:
    with pytest.raises(SettingError, match=r"stiffness_n_m must be"):
        ToolProfile(stiffness_n_m=stiffness)
