"""Contact of a compliant arm with a plane, against the general solution and the law of the surface."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from emulators.arm.compliance import ArmProfile
from emulators.arm.mode import Mode, responses
from emulators.arm.plane_contact import PlaneContact
from emulators.arm.waypoints import Waypoint
from emulators.surface.contact import Contact, SurfaceKind, SurfaceProfile
from emulators.surface.plane_law import PlaneLaw
from tests.paper_cell import PaperCell, PaperCellProfile, s3_jr3_cell

T0 = 777.125
DOWN = (0.0, 1.0, 0.0, 0.0)
MODE, STEP = Mode(15.0, 0.03), 1e-3


def sliding_cell(surface: SurfaceProfile, depth: float) -> PaperCell:
    """Return a cell whose tool moves down onto the surface and then slides along it."""
    cell = s3_jr3_cell(PaperCellProfile(arm=ArmProfile(compliance="joints"), surface=surface), T0, seed=5)
    cell.robot.motion.enqueue(Waypoint((0.9, 0.0, 0.59 - depth), DOWN, 1000.0), T0)
    cell.robot.motion.enqueue(Waypoint((0.9, 0.01, 0.59 - depth), DOWN, 20.0), T0 + 1.0)
    return cell


@pytest.mark.parametrize("slope", [0.0, 25.0])
@pytest.mark.parametrize("stiffness", [5e3, 20e3, 100e3])
@pytest.mark.parametrize("friction", [0.0, 0.2, 0.8])
def test_force_is_that_of_the_general_solution(
    slope: float, stiffness: float, friction: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    surface = SurfaceProfile(
        kind=SurfaceKind.SLOPED if slope else SurfaceKind.FLAT,
        slope_deg=slope,
        stiffness_n_m=stiffness,
        friction=friction,
    )
    times = T0 + np.arange(0.0, 4.0, STEP)
    force = sliding_cell(surface, 0.002).contact_forces(times)
    monkeypatch.setattr(Contact, "plane", None)
    expected = sliding_cell(surface, 0.002).contact_forces(times)
    assert expected[:, 2].max() > 5.0
    np.testing.assert_allclose(force, expected, atol=0.02, rtol=1e-3)


@settings(max_examples=200, deadline=None)
@given(
    stiffness=st.floats(1e3, 300e3),
    damping=st.floats(0.0, 500.0),
    friction=st.floats(0.0, 2.0),
    tilt=st.floats(-1.0, 1.0),
    depth=st.floats(1e-5, 3e-3),
    speed=st.floats(-0.2, 0.2),
)
def test_force_obeys_the_law_of_the_surface(
    stiffness: float, damping: float, friction: float, tilt: float, depth: float, speed: float
) -> None:
    law = PlaneLaw(0.0, (math.sin(tilt), 0.0, math.cos(tilt)), stiffness, damping, friction, 1e-3)
    mixed = np.array([[1.0, 0.3, -0.2], [0.3, 0.7, 0.1], [-0.2, 0.1, 0.5]]) * MODE.stiffness / 40e3
    grid = responses(MODE, STEP)
    normal, count = np.array(law.normal), 64
    velocity = np.array([speed, 0.5 * speed, 0.1 * speed])
    positions = -depth * normal + np.outer(np.arange(count + 1) * STEP, velocity)
    start = np.concatenate((np.zeros(9), velocity, positions[0]))
    motion = PlaneContact(law, grid, mixed, np.zeros(3)).motion(start, positions[1:])
    forces, positions = motion[:, 6:9], positions[1:]
    offset, drift = grid.forced[:, :count, 1 : count + 1] @ (forces @ mixed.T)
    np.testing.assert_allclose(motion[:, :3], offset, atol=1e-9)
    np.testing.assert_allclose(motion[:, 3:6], drift, atol=1e-6)
    depths = -(positions + offset) @ normal
    leaving = (velocity + drift) @ normal
    sliding = velocity + drift - leaving[:, None] * normal
    pressing = np.maximum(np.where(depths > 0.0, stiffness * depths - damping * leaving, 0.0), 0.0)
    ratio = friction * pressing / np.sqrt((sliding**2).sum(axis=1) + 1e-6)
    expected = pressing[:, None] * normal - ratio[:, None] * sliding
    left = depths < 1e-9  # a tool that its damper would push out remains at the surface
    np.testing.assert_allclose(forces[~left], expected[~left], atol=5e-3, rtol=1e-3)
    assert (forces @ normal >= -1e-9).all()
    assert (depths[forces @ normal > 0.0] > -1e-9).all(), "the damper pushed the tool out"
    assert ((forces * sliding).sum(axis=1)[~left] <= 1e-6).all()
