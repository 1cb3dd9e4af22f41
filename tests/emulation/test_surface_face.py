"""Tests of a tool with a face: a disc of contact points that produces moments when it is tilted."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from emulators.arm.waypoints import Waypoint
from emulators.surface.contact import SurfaceKind, SurfaceProfile
from emulators.surface.face import Face, ring_points, turn_rates
from emulators.surface.materials import MaterialKind, MaterialProfile
from emulators.tool import ToolProfile
from tests.paper_cell import PaperCell, PaperCellProfile, s3_jr3_cell

T0 = 777.125
DOWN = (0.0, 1.0, 0.0, 0.0)
AT_ONCE = 1000.0
RADIUS = 0.02
LENGTH = 0.2


def cell_with(surface: SurfaceProfile, radius_mm: float = 1000.0 * RADIUS, rings: int = 3) -> PaperCell:
    tool = ToolProfile(mass_kg=0.0, face_radius_mm=radius_mm, face_rings=rings)
    return s3_jr3_cell(PaperCellProfile(tool=tool, surface=surface), T0, 1)


def tilted(degrees: float) -> tuple[float, float, float, float]:
    """Return the orientation of a tool pointing down, turned about base x."""
    half = math.radians(degrees) / 2.0
    return (math.sin(half), math.cos(half), 0.0, 0.0)


def wrench_at(cell: PaperCell, position: tuple[float, float, float], quaternion=DOWN) -> np.ndarray:
    """Return the wrench about the tool centre point once the tool is stationary there."""
    cell.robot.motion.enqueue(Waypoint(position, quaternion, AT_ONCE), T0)
    wrench = cell.wrench(np.array([T0 + 6.0]))[0]
    wrench[3:] -= np.cross([0.0, 0.0, LENGTH], wrench[:3])
    return wrench


@pytest.mark.parametrize("rings", [1, 2, 3])
def test_points_of_face_represent_equal_areas(rings: int) -> None:
    points = ring_points(0.02, rings)
    assert points.shape == (3, 1 + 3 * rings * (rings + 1)) == (3, Face(0.02, rings).count)
    assert points.mean(axis=1) == pytest.approx([0.0] * 3, abs=1e-15)
    x, y, z = points
    # of a disc: a quarter of the squared radius each way, and nothing crosswise
    assert (x * x).mean() == pytest.approx(0.02**2 / 4.0, rel=0.03)
    assert (y * y).mean() == pytest.approx((x * x).mean(), rel=1e-9)
    assert (x * y).mean() == pytest.approx(0.0, abs=1e-15)
    assert not z.any()
    assert np.hypot(x, y).max() < 0.02


@pytest.mark.parametrize(("stiffness", "depth"), [(5000.0, 0.002), (50_000.0, 0.002)])
def test_tilting_stiffness_is_quarter_of_k_r_squared(stiffness: float, depth: float) -> None:
    degrees = 2.0
    surface = SurfaceProfile(stiffness_n_m=stiffness)
    straight = wrench_at(cell_with(surface), (0.9, 0.0, 0.59 - depth))
    skew = wrench_at(cell_with(surface), (0.9, 0.0, 0.59 - depth), tilted(degrees))
    # The arm rests within half a resolution step; with it both rest at the same height.
    assert -straight[2] == pytest.approx(stiffness * depth, abs=stiffness * 7e-5)
    assert straight[3:] == pytest.approx([0.0] * 3, abs=1e-9)
    moment = stiffness * RADIUS**2 / 4.0 * math.radians(degrees)
    assert np.linalg.norm(skew[3:]) == pytest.approx(moment, rel=0.02)
    assert skew[3] == pytest.approx(math.copysign(moment, skew[3]), rel=0.02)


def test_moment_turns_tool_flat() -> None:
    degrees = 2.0
    cell = cell_with(SurfaceProfile())
    skew = wrench_at(cell, (0.9, 0.0, 0.588), tilted(degrees))
    (_, quaternion), *_ = cell.robot.path.orientations(np.array([T0 + 6.0]))
    # A small turn about tool x by the moment's sign must lessen the tilt.
    w, x, y, z = quaternion
    turn = math.copysign(math.radians(1.0), skew[3]) / 2.0
    turned = (w - x * turn, x + w * turn, y + z * turn, z - y * turn)

    def tilt(q: tuple[float, ...]) -> float:
        _, x, y, _ = np.array(q) / np.linalg.norm(q)
        return math.acos(min(1.0, -(1.0 - 2.0 * (x * x + y * y))))

    assert tilt(turned) < tilt(quaternion)


def test_only_points_below_surface_push() -> None:
    surface = SurfaceProfile(stiffness_n_m=50_000.0)
    wrench = wrench_at(cell_with(surface), (0.9, 0.0, 0.5898), tilted(5.0))
    # The lower half of a disc at 5° reaches deeper than the middle: more force than of a point, far off the axis.
    assert -wrench[2] > 50_000.0 * 0.0003
    arm = np.linalg.norm(wrench[3:]) / -wrench[2]
    assert 0.3 * RADIUS < arm < RADIUS


def test_face_on_sphere_has_less_force_than_point() -> None:
    ball = SurfaceProfile(kind=SurfaceKind.SPHERE, radius_mm=300.0)
    point = wrench_at(cell_with(ball, 0.0), (0.9, 0.0, 0.588))
    disc = wrench_at(cell_with(ball), (0.9, 0.0, 0.588))
    # A ball falls away by r²/2R: over the disc by r²/4R in the mean.
    assert point[2] - disc[2] == pytest.approx(-5000.0 * RADIUS**2 / (4.0 * 0.3), rel=0.05)
    assert disc[3:] == pytest.approx([0.0] * 3, abs=1e-4)


def test_tiny_face_acts_like_point() -> None:
    surface = SurfaceProfile(kind=SurfaceKind.SINUSOIDAL, friction=0.5)
    times = T0 + np.arange(0.0, 3.0, 0.001)

    def wrenches(radius_mm: float) -> np.ndarray:
        cell = cell_with(surface, radius_mm)
        cell.robot.motion.enqueue(Waypoint((0.9, -0.1, 0.588), DOWN, AT_ONCE), T0)
        cell.robot.motion.enqueue(Waypoint((0.9, 0.1, 0.588), tilted(4.0), 0.05), T0 + 0.5)
        return cell.wrench(times)

    np.testing.assert_allclose(wrenches(1e-6), wrenches(0.0), rtol=0.0, atol=1e-6)


def test_wrench_of_face_is_independent_of_blocks() -> None:
    times = T0 + np.arange(0.0, 2.0, 0.001)

    def moved() -> PaperCell:
        cell = cell_with(SurfaceProfile(kind=SurfaceKind.SPHERE))
        cell.robot.motion.enqueue(Waypoint((0.9, -0.05, 0.584), DOWN, AT_ONCE), T0)
        cell.robot.motion.enqueue(Waypoint((0.9, 0.1, 0.584), tilted(10.0), 0.05), T0 + 0.5)
        return cell

    complete, forces = moved().wrench(times), moved().contact_forces(times)
    cut = moved()
    parts = np.split(times, [1, 9, 700, 777, 1300])
    # The product of matrices alone may differ in its last bit with the number of samples.
    np.testing.assert_allclose(
        np.concatenate([cut.wrench(part) for part in parts]), complete, rtol=0, atol=1e-14
    )
    np.testing.assert_array_equal(np.concatenate([cut.contact_forces(part) for part in parts]), forces)
    assert np.ptp(complete[:, 3]) > 0.02


def test_true_force_is_sum_over_face() -> None:
    cell = cell_with(SurfaceProfile(friction=0.0))
    wrench = wrench_at(cell, (0.9, 0.0, 0.588), tilted(3.0))
    truth = cell.true_state(T0 + 6.0)
    assert np.linalg.norm(truth.contact_force) == pytest.approx(np.linalg.norm(wrench[:3]))
    assert truth.contact_force == pytest.approx((0.0, 0.0, truth.contact_force[2]))
    np.testing.assert_array_equal(cell.contact_forces(np.array([T0 + 6.0]))[0], truth.contact_force)


def test_face_on_material_with_memory_is_refused() -> None:
    solid = SurfaceProfile(material=MaterialProfile(MaterialKind.STANDARD_LINEAR_SOLID))
    with pytest.raises(ValueError, match="face_radius_mm must be 0 on a material with memory"):
        cell_with(solid)


def about(axis: tuple[float, float, float], angle: float) -> tuple[float, float, float, float]:
    x, y, z = (math.sin(angle / 2.0) * part for part in axis)
    return (math.cos(angle / 2.0), x, y, z)


def product(p: tuple[float, ...], q: tuple[float, ...]) -> tuple[float, float, float, float]:
    a, b, c, d = p
    w, x, y, z = q
    return (
        a * w - b * x - c * y - d * z,
        a * x + b * w + c * z - d * y,
        a * y - b * z + c * w + d * x,
        a * z + b * y - c * x + d * w,
    )


unit = st.floats(-1.0, -1e-3) | st.floats(1e-3, 1.0)


@given(
    st.tuples(unit, unit, unit),
    st.tuples(unit, unit, unit, unit),
    st.floats(-3.0, 3.0),
    st.sampled_from((1, -1)),
)
def test_turn_rates_are_in_base_frame(
    axis: tuple[float, ...], start: tuple[float, ...], angle: float, sign: int
) -> None:
    x, y, z = np.array(axis) / np.linalg.norm(axis)
    w, a, b, c = np.array(start) / np.linalg.norm(start)
    before = (w, a, b, c)
    now = product(about((x, y, z), angle), before)
    flipped = (sign * now[0], sign * now[1], sign * now[2], sign * now[3])
    result = turn_rates([(slice(0, 2), flipped)], [(slice(0, 2), before)], 0.5)
    if result is None:
        assert abs(angle) < 1e-9
    else:
        expected = np.array([[x, y, z]] * 2).T * angle / 0.5
        np.testing.assert_allclose(result, expected, atol=1e-6)


def test_turning_tool_has_torsional_friction() -> None:
    surface = SurfaceProfile(friction=0.3, friction_smoothing_mm_s=1e-3)
    cell = cell_with(surface)
    cell.robot.motion.enqueue(Waypoint((0.9, 0.0, 0.588), DOWN, AT_ONCE), T0)
    # 40° about base z: with tool z down, a negative turn about tool z
    cell.robot.motion.enqueue(
        Waypoint((0.9, 0.0, 0.588), product(about((0.0, 0.0, 1.0), math.radians(40.0)), DOWN), AT_ONCE),
        T0 + 2.0,
    )
    times = T0 + np.array([1.5, 2.3, 6.0])
    fx, fy, fz, mx, my, mz = cell.wrench(times).T
    assert (fx, fy, mx, my) == pytest.approx((0.0,) * 4, abs=1e-3)
    # Of a disc that presses evenly, two thirds of its radius are the arm of its friction.
    assert mz == pytest.approx([0.0, 0.3 * -fz[1] * 2.0 / 3.0 * RADIUS, 0.0], rel=0.02, abs=1e-9)


def test_surface_fault_counts_samples_not_points() -> None:
    def struck(radius_mm: float) -> int:
        cell = cell_with(SurfaceProfile(), radius_mm)
        cell.robot.motion.enqueue(Waypoint((0.9, 0.0, 0.588), DOWN, AT_ONCE), T0)
        fault = cell.inject("surface", "step", T0 + 3.0, mm=1.0)
        cell.wrench(T0 + 4.0 + np.arange(500) / 8000.0)
        return fault.struck

    assert struck(20.0) == struck(0.0) == 500
