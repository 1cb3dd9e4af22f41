"""Tests of removal: a tool that slides under pressure lowers the surface below it."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from emulators.arm.waypoints import Waypoint
from emulators.surface.contact import Contact, SurfaceProfile
from emulators.surface.face import Face
from emulators.surface.materials import MaterialKind, MaterialProfile
from emulators.surface.removal import RADIUS_LIMIT_CELLS, RemovalProfile
from emulators.tool import ToolProfile
from tests.paper_cell import PaperCell, PaperCellProfile, s3_jr3_cell

TOP = 0.59
T0 = 777.125
RATE = 8000
DOWN = (0.0, 1.0, 0.0, 0.0)
UM = 1e-6
SOLID = MaterialProfile(MaterialKind.STANDARD_LINEAR_SOLID)


def wear_profile(um_per_n_cm2_m: float = 1.0, **others: Any) -> SurfaceProfile:
    removal = RemovalProfile(um_per_n_cm2_m, **others)
    return SurfaceProfile(damping_ns_m=0.0, friction=0.0, removal=removal)


def stroke(
    contact: Contact, begin: float, distance: float, speed: float = 0.02, at: float = T0
) -> np.ndarray:
    """Return the forces of a stroke along the path (base y), 2 mm deep, at 8 kHz."""
    times = at + np.arange(1, round(distance / abs(speed) * RATE) + 1) / RATE
    along = begin + speed * (times - at)
    positions = np.column_stack((np.full_like(along, 0.9), along, np.full_like(along, TOP - 0.002)))
    velocities = np.tile([0.0, speed, 0.0], (len(times), 1))
    return contact.force(positions, velocities, times)


def test_no_removal_and_no_memory_by_default() -> None:
    contact = Contact(SurfaceProfile())
    stroke(contact, 0.0, 0.01)
    assert contact.removed is None
    assert contact.remembered_until is None


def test_volume_follows_preston() -> None:
    contact = Contact(wear_profile(2.0))
    forces = stroke(contact, -0.03, 0.06)
    removed = contact.removed
    assert removed is not None
    # 2 µm for a N/cm² and a metre: 10 N over 60 mm, whatever the area
    volume = 2.0 * UM * 10.0 * 1e-4 * 0.06
    assert removed.depths.sum() * removed.spacing**2 == pytest.approx(volume, rel=1e-3)
    assert forces[:, 2] == pytest.approx(10.0, rel=1e-3)


def test_disc_removes_across_its_width() -> None:
    contact = Contact(wear_profile(1.0, point_radius_mm=5.0))
    stroke(contact, -0.03, 0.06)
    removed = contact.removed
    assert removed is not None
    rows, columns = removed.depths.shape
    pressure = 10.0 / (math.pi * 0.5**2)
    middle = removed.depths[rows // 2, columns // 2]
    assert middle == pytest.approx(1.0 * UM * pressure * 0.01, rel=0.05)
    track = np.flatnonzero(removed.depths[rows // 2] > 0.01 * middle)
    assert len(track) * removed.spacing == pytest.approx(0.01, abs=0.0021)


def test_face_removes_according_to_area() -> None:
    face = Face(0.005, 3)
    contact = Contact(wear_profile(1.0), face=face)
    times = T0 + np.arange(1, 12_001) / RATE
    along = -0.015 + 0.02 * (times - T0)
    centres = np.column_stack((np.full_like(along, 0.9), along, np.full_like(along, TOP - 0.002)))
    velocities = np.tile([0.0, 0.02, 0.0], (len(times), 1))
    quaternion = ((slice(0, len(times)), DOWN),)
    spread = face.spread(centres, velocities, quaternion, lambda q: np.diag([1.0, -1.0, -1.0]))
    forces = contact.force(spread.positions, spread.velocities, np.repeat(times, face.count))
    assert face.gather(forces, spread.arms).force[:, 2] == pytest.approx(10.0, rel=2e-3)
    removed = contact.removed
    assert removed is not None
    assert removed.depths.sum() * removed.spacing**2 == pytest.approx(1e-10 * 10.0 * 0.03, rel=2e-3)
    rows, columns = removed.depths.shape
    middle = removed.depths[rows // 2, columns // 2 - 1 : columns // 2 + 2].mean()
    assert middle == pytest.approx(1.0 * UM * 10.0 / (math.pi * 0.25) * 0.01, rel=0.08)


def test_next_pass_reaches_deeper() -> None:
    contact = Contact(wear_profile(1000.0))
    first = stroke(contact, -0.03, 0.06)[2400, 2]
    removed = contact.removed
    assert removed is not None
    rows, columns = removed.depths.shape
    gone = removed.depths[rows // 2, columns // 2]
    place = np.array([[0.9, 0.0, TOP - 0.002]])
    depth, normal = contact.depth_and_normal(place)
    assert gone > 50.0 * UM
    assert depth[0] == pytest.approx(0.002 - gone)
    assert normal[0].tolist() == [0.0, 0.0, 1.0]
    second = stroke(contact, 0.03, 0.06, -0.02, T0 + 10.0)[12_000, 2]
    assert second == pytest.approx(5000.0 * (0.002 - gone), rel=0.05)
    assert second < first


def test_stationary_or_lifted_tool_removes_nothing() -> None:
    contact = Contact(wear_profile(1000.0))
    times = T0 + np.arange(1, 4001) / RATE
    rest = np.tile([0.9, 0.0, TOP - 0.002], (len(times), 1))
    contact.force(rest, np.zeros_like(rest), times)
    above = rest + np.array([0.0, 0.0, 0.01])
    contact.force(above, np.tile([0.0, 0.1, 0.0], (len(times), 1)), times + 1.0)
    down = np.tile([0.0, 0.0, -0.1], (len(times), 1))
    contact.force(rest, down, times + 2.0)
    assert contact.removed is not None
    assert not contact.removed.depths.any()


def test_gap_between_samples_removes_nothing() -> None:
    contact = Contact(wear_profile(1000.0))
    place, velocity = np.array([[0.9, 0.0, TOP - 0.002]]), np.array([[0.0, 0.1, 0.0]])
    for at in (T0, T0 + 0.2, T0 + 10.0):
        contact.force(place, velocity, np.array([at]))
    assert contact.removed is not None
    assert not contact.removed.depths.any()
    contact.force(place, velocity, np.array([T0 + 10.05]))
    assert contact.removed.depths.any()


def test_nothing_is_removed_outside_map() -> None:
    contact = Contact(wear_profile(1000.0, length_mm=20.0, width_mm=10.0))
    stroke(contact, 0.02, 0.02)
    assert contact.removed is not None
    assert not contact.removed.depths.any()
    stroke(contact, 0.0, 0.02, at=T0 + 5.0)
    assert contact.removed.depths[-1].any()
    assert contact.depth_and_normal(np.array([[0.9, 0.0101, TOP - 0.001]]))[0] == pytest.approx([0.001])


def test_map_has_its_position() -> None:
    profile = SurfaceProfile(
        path_deg=0.0, origin_x_mm=800.0, origin_y_mm=50.0, removal=RemovalProfile(1.0, 2.0, 40.0, 20.0)
    )
    contact = Contact(profile)
    times = T0 + np.arange(1, 401) / RATE
    places = np.tile([0.81, 0.056, TOP - 0.002], (400, 1))  # 10 mm along, 6 mm to the left
    contact.force(places, np.tile([0.02, 0.0, 0.0], (400, 1)), times)
    removed = contact.removed
    assert removed is not None
    assert removed.depths.shape == (21, 11)
    assert removed.origin == pytest.approx((0.78, 0.04))
    assert removed.direction == pytest.approx((1.0, 0.0))
    row, column = (np.average(nodes, weights=removed.depths) for nodes in np.indices(removed.depths.shape))
    assert 0.78 + 0.002 * row == pytest.approx(0.81)
    assert 0.04 + 0.002 * column == pytest.approx(0.056)


def course(contact: Contact, cuts: list[int]) -> tuple[np.ndarray, np.ndarray]:
    """Return forces and map of an irregular stroke whose samples are divided into blocks."""
    chance = np.random.default_rng(4)
    times = 100.0 + np.arange(1, 1201) / RATE
    velocities = np.tile([0.01, 0.05, 0.0], (1200, 1)) + chance.normal(0.0, 0.01, (1200, 3))
    positions = np.cumsum(velocities, axis=0) / RATE + [0.9, 0.0, TOP - 0.002]
    parts = zip(*(np.split(part, cuts) for part in (positions, velocities, times)), strict=True)
    forces = np.concatenate([contact.force(*part) for part in parts if len(part[2])])
    assert contact.removed is not None
    return forces, contact.removed.depths


@settings(max_examples=15, deadline=None)
@given(st.lists(st.integers(1, 1199), max_size=8))
@pytest.mark.parametrize("material", [MaterialProfile(), SOLID], ids=lambda m: m.kind)
def test_forces_and_map_are_independent_of_blocks(material: MaterialProfile, cuts: list[int]) -> None:
    profile = SurfaceProfile(material=material, removal=RemovalProfile(1e5))
    forces, depths = course(Contact(profile), [])
    again, map_again = course(Contact(profile), sorted(set(cuts)))
    np.testing.assert_array_equal(again, forces)
    np.testing.assert_array_equal(map_again, depths)
    assert depths.max() > 10.0 * UM


@pytest.mark.parametrize("back", [1, 79, 80, 81, 600, 1150])
def test_rewind_restores_exact_state(back: int) -> None:
    contact = Contact(wear_profile(1e5))
    course(contact, list(range(60, 1200, 60)))
    time = 100.0 + (1200 - back) / RATE
    contact.rewind(time)
    displayed = contact.remembered_until
    assert displayed is not None
    done = max(round((max(displayed, 0.0) - 100.0) * RATE), 0)
    assert 1200 - back - 60 <= done < 1200 - back + 1
    fresh = Contact(wear_profile(1e5))
    course_until(fresh, done)
    assert contact.removed is not None
    assert fresh.removed is not None
    np.testing.assert_array_equal(contact.removed.depths, fresh.removed.depths)


def course_until(contact: Contact, count: int) -> None:
    chance = np.random.default_rng(4)
    times = 100.0 + np.arange(1, 1201) / RATE
    velocities = np.tile([0.01, 0.05, 0.0], (1200, 1)) + chance.normal(0.0, 0.01, (1200, 3))
    positions = np.cumsum(velocities, axis=0) / RATE + [0.9, 0.0, TOP - 0.002]
    if count:
        contact.force(positions[:count], velocities[:count], times[:count])


def test_queries_aside_change_nothing() -> None:
    contact, untouched = Contact(wear_profile(1e5)), Contact(wear_profile(1e5))
    for each in (contact, untouched):
        stroke(each, -0.02, 0.01)
    twin = contact.aside()
    stroke(twin, -0.01, 0.03, at=T0 + 1.0)
    assert twin.removed is not None
    assert contact.removed is not None
    assert untouched.removed is not None
    assert twin.removed.depths.sum() > contact.removed.depths.sum()
    np.testing.assert_array_equal(contact.removed.depths, untouched.removed.depths)
    assert contact.remembered_until == untouched.remembered_until
    twin.rewind(0.0)
    np.testing.assert_array_equal(contact.removed.depths, untouched.removed.depths)


def test_kept_history_is_bounded() -> None:
    contact = Contact(wear_profile(1e5))
    for k in range(200):
        stroke(contact, -0.01 + 0.0002 * k, 0.0002, at=T0 + k * 0.01)
    contact.rewind(0.0)
    displayed = contact.remembered_until
    assert displayed is not None
    assert T0 + 1.3 < displayed < T0 + 1.4  # 64 blocks of 10 ms


def test_wearing_surface_requires_times() -> None:
    place = np.array([[0.9, 0.0, TOP - 0.002]])
    with pytest.raises(ValueError, match="times"):
        Contact(wear_profile()).force(place, np.zeros_like(place))


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        ({"um_per_n_cm2_m": -1.0}, "um_per_n_cm2_m must be at least 0"),
        ({"um_per_n_cm2_m": math.nan}, "um_per_n_cm2_m must be a number"),
        ({"cell_mm": 0.0}, "cell_mm must be more than 0"),
        ({"cell_mm": 0.1}, "more than 1048576 cells"),
        ({"cell_mm": 5e-324}, "more than 1048576 cells"),
        ({"length_mm": math.inf}, "more than 1048576 cells"),
    ],
)
def test_invalid_removal_is_refused(bad: dict[str, float], message: str) -> None:
    with pytest.raises(ValueError, match=message) as caught:
        RemovalProfile(**bad)
    assert "\n" not in str(caught.value)


def test_map_too_fine_for_tool_is_refused() -> None:
    limit = RADIUS_LIMIT_CELLS
    Contact(wear_profile(1.0, cell_mm=1.0, point_radius_mm=limit))
    with pytest.raises(
        ValueError, match=r"surface\.removal\.cell_mm of 1 is too fine .* allowed: at least 2\.08"
    ):
        Contact(wear_profile(1.0, cell_mm=1.0, point_radius_mm=50.0))


def moving_cell(profile: SurfaceProfile, radius_mm: float) -> PaperCell:
    tool = ToolProfile(mass_kg=0.0, face_radius_mm=radius_mm)
    cell = s3_jr3_cell(PaperCellProfile(tool=tool, surface=profile), T0, 1)
    cell.robot.motion.enqueue(Waypoint((0.9, -0.05, 0.588), DOWN, 1000.0), T0)
    cell.robot.motion.enqueue(Waypoint((0.9, 0.0, 0.588), DOWN, 0.05), T0 + 0.5)
    return cell


@pytest.mark.parametrize("radius_mm", [0.0, 8.0])
def test_wear_is_independent_of_reads(radius_mm: float) -> None:
    profile, times = wear_profile(1e4), T0 + np.arange(1, 12_001) / RATE
    cell = moving_cell(profile, radius_mm)
    complete = cell.wrench(times)
    other = moving_cell(profile, radius_mm)
    parts = []
    for part in np.split(times, [1, 100, 4000, 4001, 9999]):
        parts.append(other.wrench(part))
        other.true_state(float(part[-1]))
        other.contact_forces(part[-1:] + 0.01)
    np.testing.assert_array_equal(np.concatenate(parts), complete)
    assert cell.removed is not None
    assert other.removed is not None
    np.testing.assert_array_equal(other.removed.depths, cell.removed.depths)
    assert cell.removed.depths.max() > 10.0 * UM
    # A cell that is not read meanwhile catches up.
    late = moving_cell(profile, radius_mm)
    np.testing.assert_array_equal(late.wrench(times[:1]), complete[:1])
    np.testing.assert_allclose(late.wrench(times[-1:]), complete[-1:], rtol=1e-12)


def test_fault_during_wear_acts_as_if_predicted() -> None:
    profile, times = wear_profile(1e4), T0 + np.arange(1, 12_001) / RATE
    surprised, knowing = moving_cell(profile, 0.0), moving_cell(profile, 0.0)
    surprised.wrench(times[:8000])
    surprised.inject("surface", "step", T0 + 0.95, mm=-1.0)
    knowing.wrench(times[:7000])
    knowing.inject("surface", "step", T0 + 0.95, mm=-1.0)
    for cell in (surprised, knowing):
        cell.wrench(times[7600:])
    assert surprised.removed is not None
    assert knowing.removed is not None
    np.testing.assert_array_equal(surprised.removed.depths, knowing.removed.depths)


def test_cell_without_wear_has_no_map() -> None:
    assert moving_cell(SurfaceProfile(), 0.0).removed is None
