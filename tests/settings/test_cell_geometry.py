"""Geometry of an emulated cell for its picture: the axes of each arm, and the work piece."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from emulators.seams import ArticulatedRobot
from emulators.surface.contact import Contact
from hil_bridge.api import load
from hil_bridge.settings import cell_geometry
from hil_bridge.settings.cell_geometry import Arm, Piece, arm_of, piece_of
from protocol.geometry import rotate, turn_about

ROBOTS = ("s3", "egm", "rtde", "rsi")
POSTURE = (0.3, -0.5, 0.7, 0.2, -0.9, 0.4)
"""Joint angles, rad, at which no two axes are parallel."""
START = (0.9, -0.1, 0.59)


def tip_at(arm: Arm, joints: Sequence[float]) -> tuple[float, float, float]:
    """Return the tool centre point at these joint angles, rad, as `cell_parts.js` computes it."""
    place = arm.tip
    for number in reversed(range(6)):
        axis = arm.axes[number]
        angle = joints[number] - (joints[axis.less - 1] if axis.less else 0.0)
        lever = [a - b for a, b in zip(place, axis.point, strict=True)]
        x, y, z = rotate(turn_about(axis.direction, angle), lever)
        place = (axis.point[0] + x, axis.point[1] + y, axis.point[2] + z)
    return place


def piece_for(surface: Mapping[str, Any], places: Sequence[Sequence[float]] = (START,)) -> Piece | None:
    return piece_of(load({"cell": {"surface": surface}}), places)


@pytest.mark.parametrize("kind", ROBOTS)
def test_arm_axes_reproduce_forward_kinematics(kind: str) -> None:
    config = load({"robot": {"emulated": kind}})
    arm, robot = arm_of(config), cell_geometry._robot(config)
    assert arm is not None
    assert isinstance(robot, ArticulatedRobot)
    assert tip_at(arm, POSTURE) == pytest.approx(robot.tool_pose_at(POSTURE).position, abs=1e-7)


def test_axis_3_of_s3_is_measured_against_base() -> None:
    arm = arm_of(load({}))
    assert arm is not None
    assert [axis.less for axis in arm.axes] == [0, 0, 2, 0, 0, 0]


def test_real_robot_has_no_arm_and_no_piece() -> None:
    config = load({"robot": {"url": "s3+serial:///dev/ttyS9"}})
    assert arm_of(config) is None
    assert piece_of(config, [START]) is None


@pytest.mark.parametrize(
    "surface",
    [
        {},
        {"kind": "sloped", "slope_deg": 12.0},
        {"kind": "sinusoidal"},
        {"kind": "sinusoidal_both"},
        {"kind": "circular_arc", "radius_mm": 120.0},
        {"kind": "sphere", "path_deg": 20.0, "radius_mm": 200.0},
    ],
    ids=lambda surface: surface.get("kind", "flat"),
)
def test_piece_heights_lie_on_surface(surface: Mapping[str, Any]) -> None:
    piece = piece_for(surface)
    assert piece is not None
    (u, v), points = piece.along, []
    for i, row in enumerate(piece.heights):
        for k, height in enumerate(row):
            along, across = i * piece.spacing[0], k * piece.spacing[1]
            if height is not None:
                x, y = piece.corner
                points.append((x + along * u - across * v, y + along * v + across * u, height))
    contact = Contact(load({"cell": {"surface": surface}}).cell.surface)
    depths, _ = contact.depth_and_normal(np.array(points))
    assert len(points) > 100
    assert np.abs(depths).max() < 2e-6


def test_piece_has_no_heights_next_to_sphere() -> None:
    piece = piece_for({"kind": "sphere", "radius_mm": 20.0}, [(0.9, 0.0, 0.59)])
    assert piece is not None
    heights = [height for row in piece.heights for height in row]
    assert None in heights
    assert max(height for height in heights if height is not None) == pytest.approx(0.59, abs=1e-3)


def test_piece_ends_with_surface_and_rises_at_wall() -> None:
    piece = piece_for({"end_mm": -80.0, "wall_at_mm": -95.0, "wall_height_mm": 5.0})
    assert piece is not None
    length = (len(piece.heights) - 1) * piece.spacing[0]
    assert piece.corner[1] + length == pytest.approx(-0.08)
    assert {height for row in piece.heights for height in row} == {0.59, 0.595}


def test_unreadable_height_map_gives_no_piece(tmp_path: Path) -> None:
    assert piece_for({"kind": "height_map", "height_map_file": str(tmp_path / "none.txt")}) is None
    assert piece_for({}, []) is None
    assert piece_for({"end_mm": -500.0}) is None


def test_failing_robot_has_no_arm(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(config: object) -> object:
        raise RuntimeError("a plug-in")

    monkeypatch.setattr(cell_geometry, "_robot", fail)
    assert arm_of(load({})) is None
