"""Tests of the surface's materials: hysteresis, relaxation, stiffness along the path, edges."""

import copy
import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError

from emulators.arm.waypoints import Waypoint
from emulators.surface.contact import Contact, SurfaceKind, SurfaceProfile
from emulators.surface.materials import MaterialKind, MaterialProfile
from emulators.tool import ToolProfile
from tests.paper_cell import PaperCell, PaperCellProfile, s3_jr3_cell

TOP = 0.59
RATE = 8000
HUNT = MaterialProfile(MaterialKind.HUNT_CROSSLEY)
SLS = MaterialProfile(MaterialKind.STANDARD_LINEAR_SOLID)
DOWN = (0.0, 1.0, 0.0, 0.0)
ALL = pytest.mark.parametrize("material", [MaterialProfile(), HUNT, SLS], ids=lambda m: m.kind)


def surface(material: MaterialProfile, friction: float = 0.0, **others: Any) -> SurfaceProfile:
    return SurfaceProfile(material=material, friction=friction, **others)


def press(contact: Contact, depths: np.ndarray, begin: int = 0, along: float = 0.0) -> np.ndarray:
    """Return the upward forces for a sequence of depths sampled at 8 kHz."""
    depths = np.asarray(depths, dtype=float)
    positions = np.column_stack((np.full_like(depths, 0.9), np.full_like(depths, along), TOP - depths))
    velocities = np.zeros_like(positions)
    if len(depths) > 1:
        velocities[:, 2] = -np.gradient(depths) * RATE
    times = 100.0 + (begin + np.arange(len(depths))) / RATE
    return contact.force(positions, velocities, times)[:, 2]


def work(depths: np.ndarray, forces: np.ndarray) -> float:
    return float(np.sum(np.diff(depths) * (forces[1:] + forces[:-1]) / 2.0))


def bump(peak: float, seconds: float) -> np.ndarray:
    phase = np.linspace(0.0, 2.0 * math.pi, int(seconds * RATE))
    return peak * (1.0 - np.cos(phase)) / 2.0


@ALL
def test_press_and_release_dissipates_energy(material):
    depths = bump(0.003, 0.4)
    forces = press(Contact(surface(material)), depths)
    lost = work(depths, forces)
    stored = work(depths[: len(depths) // 2], forces[: len(depths) // 2])
    assert 0.001 * stored < lost < stored
    assert (forces >= 0.0).all()


@given(
    st.sampled_from([MaterialProfile(), HUNT, SLS, MaterialProfile(SLS.kind, relaxation_time_ms=5.0)]),
    st.lists(st.floats(-0.002, 0.004), min_size=1, max_size=6),
    st.floats(0.02, 0.1),
)
def test_closed_motion_never_gains_energy_or_pulls(material, turns, seconds):
    # From the air through any turning points and back into the air.
    corners = [-0.001, *turns, -0.001]
    each = max(int(seconds * RATE), 2)
    depths = np.concatenate([a + (b - a) * np.arange(each) / each for a, b in pairwise(corners)])
    forces = press(Contact(surface(material, damping_ns_m=1.0)), depths)
    assert (forces >= 0.0).all()
    # Trapezoids err by a sample's work at each corner where the force jumps.
    slack = len(corners) * np.abs(np.diff(depths)).max() * max(forces.max(), 1e-3)
    assert work(depths, forces) >= -slack


def test_standard_linear_solid_relaxes_to_spring():
    contact = Contact(surface(MaterialProfile(SLS.kind, maxwell_share=0.5, relaxation_time_ms=200.0)))
    press(contact, [-0.001])
    forces = press(contact, np.full(2 * RATE, 0.002), begin=1)
    times = np.arange(2 * RATE) / RATE
    # The jump takes one sample; from then on k·d·(1 + share·exp(−t/τ)), times the loss in that sample.
    over = forces / 10.0 - 1.0
    assert over[0] == pytest.approx(0.5, rel=1e-3)
    np.testing.assert_allclose(over, over[0] * np.exp(-times / 0.2), rtol=1e-9)
    assert forces[-1] == pytest.approx(10.0, rel=1e-4)


def test_ramp_matches_textbook_at_every_step_size():
    material = MaterialProfile(SLS.kind, maxwell_share=2.0, relaxation_time_ms=50.0)
    speed, tau = 0.01, 0.05
    for step in (1, 40, 400):
        contact = Contact(surface(material))
        times = np.arange(0, 2001, step) / RATE
        positions = np.column_stack((np.full_like(times, 0.9), 0 * times, TOP - speed * times))
        velocities = np.tile([0.0, 0.0, -speed], (len(times), 1))
        forces = contact.force(positions, velocities, 100.0 + times)[:, 2]
        expected = 5000.0 * speed * (times + 2.0 * tau * (1.0 - np.exp(-times / tau)))
        np.testing.assert_allclose(forces, expected, rtol=1e-9, atol=1e-12)


def test_dent_has_no_force_until_recovered():
    material = MaterialProfile(SLS.kind, maxwell_share=1.0, relaxation_time_ms=100.0)
    contact = Contact(surface(material))
    press(contact, np.full(RATE, 0.002))
    # Out at once: the spring of the element, relaxed at 2 mm, holds the dent at half of that.
    assert press(contact, [-0.001], begin=RATE) == pytest.approx(0.0)
    again = copy.copy(contact)
    assert press(again, [0.0009], begin=RATE + 1)[0] == 0.0
    assert press(again, [0.0011], begin=RATE + 2)[0] > 0.0
    # After a time constant of its way back, τ·(1 + share), the dent is 1/e of its depth before.
    press(contact, np.full(1600, -0.001), begin=RATE + 1)
    assert press(copy.copy(contact), [0.001 * math.exp(-1.0) * 0.99], begin=RATE + 1601)[0] == 0.0
    assert press(copy.copy(contact), [0.001 * math.exp(-1.0) * 1.01], begin=RATE + 1601)[0] > 0.0


@given(st.lists(st.integers(1, 399), max_size=8), st.integers(0, 2**32))
def test_forces_are_independent_of_blocks(cuts, seed):
    depths = np.cumsum(np.random.default_rng(seed).normal(0.0, 1e-4, 400)) + 2e-4
    complete = pressed_at(Contact(surface(SLS)), depths, [])
    np.testing.assert_array_equal(pressed_at(Contact(surface(SLS)), depths, sorted(set(cuts))), complete)


def pressed_at(contact: Contact, depths: np.ndarray, cuts: list[int]) -> np.ndarray:
    positions = np.column_stack((np.full_like(depths, 0.9), np.zeros_like(depths), TOP - depths))
    times = 100.0 + np.arange(len(depths)) / RATE
    return np.concatenate(
        [
            contact.force(p, np.zeros_like(p), t)
            for p, t in zip(np.split(positions, cuts), np.split(times, cuts), strict=True)
        ]
    )[:, 2]


@pytest.mark.parametrize("exponent", [1.0, 1.5, 2.2])
def test_hunt_crossley_force_is_power_of_depth(exponent):
    contact = Contact(surface(MaterialProfile(HUNT.kind, exponent=exponent, reference_depth_mm=2.0)))
    single, double = (press(contact, [depth])[0] for depth in (0.001, 0.002))
    assert double == pytest.approx(10.0)
    assert math.log2(double / single) == pytest.approx(exponent)


def test_hunt_crossley_damping_never_pulls():
    contact = Contact(surface(MaterialProfile(HUNT.kind, dissipation_s_m=2.0)))
    place = np.array([[0.9, 0.0, TOP - 0.002]] * 3)
    speeds = np.array([[0.0, 0.0, -0.1], [0.0, 0.0, 0.1], [0.0, 0.0, 0.6]])
    assert contact.force(place, speeds)[:, 2] == pytest.approx([12.0, 8.0, 0.0])


@ALL
def test_stiffness_follows_profile_along_path(material):
    profile = surface(material, stiffness_profile=((10.0, 1.0), (20.0, 3.0), (30.0, 0.0)))
    for along_mm, factor in ((0.0, 1.0), (10.0, 1.0), (15.0, 2.0), (20.0, 3.0), (25.0, 1.5), (31.0, 0.0)):
        assert press(Contact(profile), [0.002], along=along_mm / 1000.0)[0] == pytest.approx(10.0 * factor)


@ALL
def test_no_force_beyond_edges(material):
    profile = surface(material, begin_mm=-10.0, end_mm=40.0, stiffness_profile=((0.0, 0.0), (1.0, 1.0)))
    for along_mm, there in ((-11.0, False), (-9.0, False), (2.0, True), (39.0, True), (41.0, False)):
        contact = Contact(profile)
        assert (press(contact, [0.002], along=along_mm / 1000.0)[0] > 0.0) == there
    half = Contact(surface(material, end_mm=0.0))
    assert [bool(press(half, [0.002], k, along)[0]) for k, along in enumerate((-9.0, 0.0, 1e-6))] == [
        True,
        True,
        False,
    ]


@pytest.mark.parametrize("kind", [kind for kind in SurfaceKind if kind is not SurfaceKind.HEIGHT_MAP])
def test_edges_apply_to_every_shape(kind):
    contact = Contact(SurfaceProfile(kind=kind, begin_mm=-5.0, end_mm=5.0))
    positions = np.array([[0.9, along, TOP - 0.02] for along in (-0.006, 0.0, 0.006)])
    pushed = contact.force(positions, np.zeros_like(positions))
    assert [bool(row.any()) for row in pushed] == [False, True, False]


def test_material_with_memory_requires_times():
    place = np.array([[0.9, 0.0, TOP - 0.002]])
    with pytest.raises(ValueError, match="times"):
        Contact(surface(SLS)).force(place, np.zeros_like(place))


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        ({"stiffness_profile": ((0.0, 1.0), (0.0, 2.0))}, "must ascend, but 0 mm follows 0 mm"),
        ({"stiffness_profile": ((0.0, -1.0),)}, "factors of at least 0"),
        ({"stiffness_profile": ((0.0, math.nan),)}, "stiffness_profile must be finite"),
        ({"stiffness_profile": ((0.0,),)}, "pairs"),
        ({"begin_mm": 5.0, "end_mm": 5.0}, r"end_mm must be greater than begin_mm \(5\), got 5"),
        ({"begin_mm": math.nan}, "begin_mm"),
    ],
)
def test_invalid_surface_is_refused(bad, message):
    with pytest.raises(ValueError, match=message):
        SurfaceProfile(**bad)


@pytest.mark.parametrize(
    "bad",
    [
        {"exponent": 0.5},
        {"exponent": math.nan},
        {"reference_depth_mm": 0.0},
        {"dissipation_s_m": -1.0},
        {"maxwell_share": -0.1},
        {"relaxation_time_ms": 0.0},
    ],
)
def test_invalid_material_is_refused(bad):
    with pytest.raises(ValueError, match=next(iter(bad))):
        MaterialProfile(**bad)


def test_material_is_read_from_tables():
    adapter = TypeAdapter(PaperCellProfile)
    tables = {
        "surface": {
            "material": {"kind": "standard_linear_solid", "relaxation_time_ms": 100.0},
            "stiffness_profile": [[0, 1], [50, 4.0]],
            "end_mm": 120,
        }
    }
    profile = adapter.validate_python(tables).surface
    assert profile.material == MaterialProfile(SLS.kind, relaxation_time_ms=100.0)
    assert profile.stiffness_profile == ((0.0, 1.0), (50.0, 4.0))
    with pytest.raises(ValidationError, match="exponent must be at least 1"):
        adapter.validate_python({"surface": {"material": {"exponent": 0.1}}})


def lowered_cell(seed: int = 1) -> PaperCell:
    """Return a cell with a slow sponge whose tip is moved 2 mm deep at 1 s and up again at 2 s."""
    cell = s3_jr3_cell(PaperCellProfile(surface=surface(SLS), tool=ToolProfile(mass_kg=0.0)), 777.125, seed)
    cell.robot.motion.enqueue(Waypoint((0.9, 0.0, TOP + 0.001), DOWN, 1000.0), 777.125)
    cell.robot.motion.enqueue(Waypoint((0.9, 0.0, TOP - 0.002), DOWN, 0.05), 778.125)
    cell.robot.motion.enqueue(Waypoint((0.9, 0.0, TOP - 0.0005), DOWN, 0.05), 779.125)
    return cell


def sample_times(begin: float, end: float) -> np.ndarray:
    return np.arange(math.ceil(begin * RATE), math.floor(end * RATE)) / RATE


def test_reading_is_independent_of_earlier_reads():
    times = sample_times(777.2, 780.0)
    complete = lowered_cell().wrench(times)
    assert complete[:, 2].min() < -11.0
    cell = lowered_cell()
    pieces = []
    for part in np.array_split(times, 37):
        cell.true_state(float(part[0]) + 0.3)
        pieces.append(cell.wrench(part))
    np.testing.assert_array_equal(np.concatenate(pieces), complete)
    late = times[-4000:]
    np.testing.assert_allclose(lowered_cell().wrench(late), complete[-4000:], rtol=0, atol=1e-9)
    truth = lowered_cell().true_state(float(late[0]))
    assert -truth.contact_force[2] == pytest.approx(complete[-4000, 2], abs=1e-9)
