"""Tests of a wall and a step across the path."""

import math

import numpy as np
import pytest

from emulators.arm.waypoints import Waypoint
from emulators.surface.contact import Contact, SurfaceKind, SurfaceProfile
from emulators.surface.materials import MaterialKind, MaterialProfile
from emulators.tool import ToolProfile
from tests.paper_cell import PaperCellProfile, s3_jr3_cell

TOP = 0.59
T0 = 777.125
DOWN = (0.0, 1.0, 0.0, 0.0)


def push(profile: SurfaceProfile, along_mm: float, up_mm: float, speed: float = 0.0) -> np.ndarray:
    """Return the force at a height above the surface before the wall, while moving along the path (base y)."""
    place, velocity = np.array([[0.9, along_mm / 1e3, TOP + up_mm / 1e3]]), np.array([[0.0, speed, 0.0]])
    return Contact(profile).force(place, velocity)[0]


WALL = SurfaceProfile(wall_at_mm=20.0, damping_ns_m=0.0, friction=0.0)
STEP = SurfaceProfile(wall_at_mm=20.0, wall_height_mm=2.0, damping_ns_m=0.0, friction=0.0)


def test_surface_before_wall_is_unchanged() -> None:
    without = SurfaceProfile(damping_ns_m=0.0, friction=0.0)
    for along in (-50.0, 0.0, 19.99):
        assert (push(WALL, along, -2.0) == push(without, along, -2.0)).all()


def test_wall_and_surface_below_both_push() -> None:
    assert push(WALL, 20.4, -2.0) == pytest.approx([0.0, -50_000.0 * 0.0004, 10.0])
    assert push(WALL, 20.4, 30.0) == pytest.approx([0.0, -20.0, 0.0])
    assert push(WALL, 20.4, 1001.0) == pytest.approx([0.0, 0.0, 0.0])


def test_surface_beyond_step_is_raised() -> None:
    assert push(STEP, 30.0, 0.0) == pytest.approx([0.0, 0.0, 10.0])
    assert push(STEP, 30.0, 2.1) == pytest.approx([0.0] * 3)


def test_shorter_direction_out_decides() -> None:
    assert push(STEP, 20.5, 1.0) == pytest.approx([0.0, -25.0, 0.0])  # 0.5 mm aside, 1 mm to the top
    assert push(STEP, 21.5, 1.0) == pytest.approx([0.0, 0.0, 5.0])


def test_upright_face_has_friction_and_never_pulls() -> None:
    rough = SurfaceProfile(wall_at_mm=20.0, friction=0.3, friction_smoothing_mm_s=1e-6)
    place = np.array([[0.9, 0.0204, TOP + 0.03]])
    force = Contact(rough).force(place, np.array([[0.03, 0.0, -0.04]]))[0]
    assert force == pytest.approx([-0.3 * 20.0 * 0.6, -20.0, 0.3 * 20.0 * 0.8])
    assert not Contact(rough).force(place, np.array([[0.0, -100.0, 0.0]]))[0].any()


@pytest.mark.parametrize("kind", [kind for kind in SurfaceKind if kind is not SurfaceKind.HEIGHT_MAP])
def test_every_shape_may_have_a_wall(kind: SurfaceKind) -> None:
    profile = SurfaceProfile(kind=kind, wall_at_mm=20.0, damping_ns_m=0.0, friction=0.0)
    assert push(profile, 20.2, 20.0) == pytest.approx([0.0, -10.0, 0.0])
    assert not push(profile, 19.9, 20.0).any()


def test_no_wall_beyond_end_of_surface() -> None:
    ended = SurfaceProfile(wall_at_mm=20.0, end_mm=10.0)
    assert not push(ended, 20.2, 20.0).any()


def test_wall_on_material_with_memory() -> None:
    solid = MaterialProfile(MaterialKind.STANDARD_LINEAR_SOLID)
    contact = Contact(SurfaceProfile(wall_at_mm=20.0, material=solid, friction=0.0, damping_ns_m=0.0))
    places = np.array([[0.9, along, TOP - 0.001] for along in (0.0, 0.0199, 0.0202)])
    forces = contact.force(places, np.zeros((3, 3)), T0 + np.arange(3) / 8000.0)
    assert (forces[:, 2] > 4.9).all()
    assert forces[:, 1] == pytest.approx([0.0, 0.0, -10.0])


def test_wall_pushes_each_point_of_face() -> None:
    radius = 0.01
    tool = ToolProfile(mass_kg=0.0, face_radius_mm=1000.0 * radius)
    surface = SurfaceProfile(wall_at_mm=20.0, friction=0.0)
    cell = s3_jr3_cell(PaperCellProfile(tool=tool, surface=surface), T0, 1)
    cell.robot.motion.enqueue(Waypoint((0.9, 0.0, 0.6), DOWN, 1000.0), T0)
    cell.robot.motion.enqueue(Waypoint((0.9, 0.015, 0.6), DOWN, 1000.0), T0 + 2.0)
    at = np.array([T0 + 1.0, T0 + 5.0])
    fx, fy, fz, mx, _, mz = cell.wrench(at).T
    assert (fx[0], fy[0], fz[0]) == pytest.approx((0.0, 0.0, 0.0))
    # Tool y points along -y of the base, so the wall pushes towards +y of the tool, in the plane of its face.
    assert fy[1] > 1.0
    assert (fx[1], fz[1]) == pytest.approx((0.0, 0.0), abs=1e-9)
    # The points do not stand in mirrored rows, so the push is a little beside the middle.
    assert abs(mz[1]) < 0.03 * fy[1] * radius
    assert mx[1] == pytest.approx(-0.2 * fy[1])
    # The middle of the tool is 5 mm before the wall.
    assert cell.true_state(T0 + 5.0).position[1] == pytest.approx(0.015, abs=1e-4)


def test_wall_force_is_stiffness_times_depth() -> None:
    surface = SurfaceProfile(wall_at_mm=0.0, friction=0.0, damping_ns_m=0.0)
    cell = s3_jr3_cell(PaperCellProfile(tool=ToolProfile(mass_kg=0.0), surface=surface), T0, 1)
    cell.robot.motion.enqueue(Waypoint((0.9, -0.01, 0.6), DOWN, 1000.0), T0)
    cell.robot.motion.enqueue(Waypoint((0.9, 0.01, 0.6), DOWN, 0.01), T0 + 1.0)
    times = T0 + np.arange(1.0, 2.5, 0.001)
    truths = cell.true_states(times.tolist())
    for truth in truths:
        into = max(truth.position[1], 0.0)
        assert truth.contact_force == pytest.approx((0.0, -50_000.0 * into, 0.0), abs=1e-6)
    assert truths[-1].position[1] > 0.003
    assert not math.isclose(truths[-1].contact_force[1], 0.0)
