"""Tests of the true normal of a surface, for recordings and comparisons."""

import math

import numpy as np
import pytest

from emulators.arm.waypoints import Waypoint
from emulators.surface.contact import Contact, SurfaceKind, SurfaceProfile
from emulators.tool import ToolProfile
from tests.paper_cell import PaperCell, PaperCellProfile, s3_jr3_cell

T0 = 777.125
DOWN = (0.0, 1.0, 0.0, 0.0)
TOP = 0.59


def cell_on(surface: SurfaceProfile) -> PaperCell:
    return s3_jr3_cell(PaperCellProfile(tool=ToolProfile(mass_kg=0.0), surface=surface), T0, 1)


def test_true_state_has_normal_below_tool() -> None:
    cell = cell_on(SurfaceProfile(kind=SurfaceKind.SPHERE, radius_mm=300.0))
    cell.robot.motion.enqueue(Waypoint((0.93, -0.06, 0.6), DOWN, 1000.0), T0)
    truth = cell.true_state(T0 + 5.0)
    assert truth.normal is not None
    x, y, z = truth.position
    away = np.array([x - 0.9, y, z - (TOP - 0.3)])
    assert truth.normal == pytest.approx(away / np.linalg.norm(away))
    assert truth.quaternion == DOWN


def test_no_normal_beyond_end_of_surface() -> None:
    cell = cell_on(SurfaceProfile(end_mm=-150.0))
    assert cell.true_state(T0).normal is None
    assert cell_on(SurfaceProfile(end_mm=-50.0)).true_state(T0).normal == (0.0, 0.0, 1.0)


def test_normal_follows_surface_moved_by_fault() -> None:
    cell = cell_on(SurfaceProfile(kind=SurfaceKind.SPHERE, radius_mm=20.0, origin_y_mm=-110.0))
    before = cell.true_state(T0).normal
    cell.inject("surface", "step", T0 + 0.1, mm=-5.0, ramp_ms=1.0)
    after = cell.true_state(T0 + 1.0).normal
    assert before == pytest.approx(np.array([0.0, 0.01, 0.03]) / math.hypot(0.01, 0.03), abs=1e-3)
    assert after == pytest.approx(np.array([0.0, 0.01, 0.035]) / math.hypot(0.01, 0.035), abs=1e-3)


def test_wall_raises_surface_without_changing_normal() -> None:
    contact = Contact(SurfaceProfile(kind=SurfaceKind.SLOPED, slope_deg=10.0, wall_at_mm=0.0))
    places = np.array([[0.9, y, TOP + z] for y, z in ((-0.01, 0.0), (0.01, 0.0), (0.01, 1.1))])
    slope = math.radians(10.0)
    expected = [[0.0, -math.sin(slope), math.cos(slope)]] * 3
    np.testing.assert_allclose(contact.normals(places, T0 + np.zeros(3)), expected, atol=1e-15)
