"""Estimate of the surface's normal, on synthetic surfaces with known normals."""

import itertools
import math
from collections.abc import Callable

import numpy as np
import pytest
from msgspec.structs import replace
from scipy.spatial.transform import Rotation

from hil_bridge.control import Measurement, Sample
from hil_bridge.control.course.contact_sample import ContactSample
from hil_bridge.control.course.facing import Facing, FacingSample, FacingState, inward, lateral_of
from hil_bridge.control.course.state import Course
from hil_bridge.control.geometry.work_frame import Face, WorkFrame
from hil_bridge.control.program.contact_force import measure_skew, subtract_zero
from protocol.geometry import Quaternion, normalise, rotate

DT = 0.012
FORCE = 10.0
FACING = Facing()
FRAME = WorkFrame(approach=(0.0, 0.0, -1.0), x=(1.0, 0.0, 0.0), y=(0.0, 1.0, 0.0))


def plane(p: float, q: float) -> Callable[[float, float], tuple[float, float, float]]:
    """Depth of a surface at x, y, m, and its slopes."""
    return lambda x, y: (p * x + q * y, p, q)


def sphere(radius: float) -> Callable[[float, float], tuple[float, float, float]]:
    """Spherical cap with its top at the origin."""

    def surface(x: float, y: float) -> tuple[float, float, float]:
        height = math.sqrt(radius**2 - x * x - y * y)
        return radius - height, x / height, y / height

    return surface


def pressed(slopes: tuple[float, float], heading: tuple[float, float], friction: float) -> tuple[float, ...]:
    """Force of a tool that presses along the inward normal and slides along the heading; along a, t, b."""
    (p, q), (h, k) = slopes, heading
    normal = np.array([1.0, -p, -q]) / math.hypot(1.0, p, q)
    sliding = np.array([p * h + q * k, h, k])
    return tuple(FORCE * (normal + friction * sliding / np.linalg.norm(sliding)))


def slide(surface, corners, speed=0.005, friction=0.2, noise=0.0, state=None, facing=FACING):
    """The estimate along straight pieces between corners, m: the state and the error in ° of each sample."""
    random = np.random.default_rng(5)
    state, travel, errors = state or FacingState(), 0.0, []
    for (x, y), (u, v) in itertools.pairwise(corners):
        length = math.hypot(u - x, v - y)
        heading = (u - x) / length, (v - y) / length
        for k in range(round(length / speed / DT)):
            distance = k * speed * DT
            depth, p, q = surface(x + distance * heading[0], y + distance * heading[1])
            force = np.array(pressed((p, q), heading, friction)) + noise * random.standard_normal(3)
            sample = FacingSample(DT, travel + distance, depth, tuple(force), heading)
            state = facing.after(state, sample, 1.0)
            errors.append((travel + distance, off(state, (p, q))))
        travel += length
    return state, np.array(errors)


def off(state: FacingState, slopes: tuple[float, float]) -> float:
    """Angle between the estimated and the true normal, °."""
    cosine = sum(a * b for a, b in zip(inward(state.fall), inward(slopes), strict=True))
    return math.degrees(math.acos(min(cosine, 1.0)))


# --- by force and motion


@pytest.mark.parametrize("slopes", [(0.0, 0.0), (0.2, 0.0), (-0.15, 0.0), (0.0, 0.25), (0.1, -0.2)])
@pytest.mark.parametrize("friction", [0.0, 0.2, 0.5])
def test_facing_plane_normal_is_within_1_degree(slopes, friction):
    state, errors = slide(plane(*slopes), [(0.0, 0.0), (0.03, 0.0)], friction=friction)
    assert errors[errors[:, 0] > 0.02, 1].max() < 1.0
    assert math.degrees(state.sigma) < 0.5
    assert math.tan(state.friction_angle) == pytest.approx(friction, abs=0.02)


def test_facing_plane_normal_on_any_heading():
    for turn in np.linspace(0.0, math.tau, 9):
        end = 0.03 * math.cos(turn), 0.03 * math.sin(turn)
        _, errors = slide(plane(0.15, -0.1), [(0.0, 0.0), end])
        assert errors[errors[:, 0] > 0.02, 1].max() < 1.0


def test_facing_normal_with_noise_is_within_1_degree():
    state, errors = slide(plane(0.1, 0.1), [(0.0, 0.0), (0.04, 0.0)], noise=0.3)
    assert errors[errors[:, 0] > 0.02, 1].max() < 1.0
    assert 0.05 < math.degrees(state.sigma) < 1.5


def test_facing_normal_follows_sphere_through_corners():
    corners = [(-0.03, 0.0), (0.03, 0.0), (0.03, 0.015), (-0.03, 0.015)]
    _, errors = slide(sphere(0.3), corners)
    steady = errors[errors[:, 0] > 0.02, 1]
    assert steady.max() < 1.0
    assert math.sqrt(np.mean(steady**2)) < 0.5


def test_facing_ignores_force_after_corner():
    state, _ = slide(plane(0.1, 0.0), [(0.0, 0.0), (0.03, 0.0)])
    turned = FACING.after(state, FacingSample(DT, 0.03, 0.003, (FORCE, 9.0, 9.0), (0.0, 1.0)), 1.0)
    assert turned.blind > 0.0
    for _ in range(10):
        turned = FACING.after(turned, FacingSample(DT, 0.03, 0.003, (FORCE, 9.0, 9.0), (0.0, 1.0)), 1.0)
    assert turned.fall == state.fall


def test_facing_gentle_bend_keeps_points():
    state, _ = slide(plane(0.1, 0.0), [(0.0, 0.0), (0.03, 0.0)])
    heading = math.cos(math.radians(10.0)), math.sin(math.radians(10.0))
    bent = FACING.after(state, FacingSample(DT, 0.03, 0.003, (FORCE, 1.0, 0.0), heading), 1.0)
    assert (bent.blind, bent.points) == (state.blind, state.points)


# --- missing information


def test_facing_stationary_tool_stays_uncertain():
    state = FacingState(fall=(0.1, 0.05))
    for k in range(200):
        state = FACING.after(state, FacingSample(DT, 0.0, 0.0, (FORCE, 3.0, -2.0), (0.0, 0.0)), 1.0)
        assert state.fall == pytest.approx((0.1, 0.05)), k
    assert math.degrees(state.sigma) > FACING.uncertain_deg


def test_facing_without_path_is_uncertain():
    state, _ = slide(plane(0.2, 0.0), [(0.0, 0.0), (0.002, 0.0)])
    assert math.degrees(state.sigma) > FACING.uncertain_deg
    assert state.friction_angle is None


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_facing_nan_reading_changes_nothing(bad):
    state, _ = slide(plane(0.1, 0.0), [(0.0, 0.0), (0.03, 0.0)])
    for sample in (
        FacingSample(DT, 0.03, 0.003, (bad, 0.0, 0.0), (1.0, 0.0)),
        FacingSample(DT, 0.03, bad, (FORCE, 0.0, 0.0), (1.0, 0.0)),
        FacingSample(DT, 0.03, 0.003, (FORCE, 0.0, 0.0), (1.0, 0.0), skew=(bad, 0.0)),
        FacingSample(DT, 0.03, 0.003, (-1.0, 0.0, 0.0), (1.0, 0.0)),
    ):
        assert FACING.after(state, sample, 1.0) == state


def test_facing_normal_is_limited_to_steepest():
    state = FacingState()
    for k in range(3000):
        sample = FacingSample(DT, k * 1e-4, 0.0, (1.0, 0.0, -50.0), (1.0, 0.0))
        state = FACING.after(state, sample, 1.0)
    _, _, b = inward(state.fall)
    assert abs(math.degrees(math.asin(b))) <= FACING.steepest_deg + 1e-6


@pytest.mark.parametrize(
    "settings",
    [
        {"window_mm": 0.0},
        {"learning_share": 1.5},
        {"smoothing_share": -0.1},
        {"steepest_deg": 90.0},
        {"uncertain_deg": math.nan},
        {"moment_noise_nm": 0.0},
    ],
)
def test_facing_invalid_parameters_are_refused(settings):
    with pytest.raises(ValueError, match=next(iter(settings))):
        Facing(**settings)


# --- by the moments at a flat face

RADIUS, STIFFNESS = 0.015, 20_000.0
PER_ANGLE = STIFFNESS * RADIUS**2 / 4.0


def tool_at(about_x: float, about_y: float) -> Quaternion:
    """Orientation of a tool that points down, tipped by these angles, °, about base x and y."""
    half_x, half_y = math.radians(about_x) / 2.0, math.radians(about_y) / 2.0
    turn = np.array([1.0, math.tan(half_x), math.tan(half_y), 0.0])
    w, x, y, z = turn / np.linalg.norm(turn)
    return normalise((-x, w, z, -y))  # the turn after half a turn about x


def disc_wrench(quaternion: Quaternion, centre: tuple[float, ...] = (0.0, 0.0, 0.0)) -> tuple[float, ...]:
    """Wrench on the tool of a flat surface below its disc, tool frame, summed over many points of the disc."""
    rings, points, spokes = 60, 6, 60
    radii = (np.arange(rings * points) + 0.5) / (rings * points) * RADIUS
    angles = np.arange(spokes) * math.tau / spokes
    weights = np.repeat(radii, spokes)
    x = np.outer(radii, np.cos(angles)).ravel()
    y = np.outer(radii, np.sin(angles)).ravel()
    arms = np.stack([x + centre[0], y + centre[1], np.full_like(x, centre[2])], axis=1)
    down = np.array(
        [-rotate(quaternion, axis)[2] for axis in np.eye(3).tolist()]
    )  # base −z in the tool frame
    depths = FORCE / STIFFNESS + (arms - np.array(centre)) @ down
    assert depths.min() > 0.0, "the complete face must touch"
    forces = -(weights / weights.sum() * STIFFNESS * depths)[:, None] * down
    return (*forces.sum(axis=0), *np.cross(arms, forces).sum(axis=0))


def contact_of(quaternion: Quaternion, wrench: tuple[float, ...]) -> ContactSample:
    sample = Sample(0.0, (0.9, 0.0, 0.6), FORCE, FORCE, 0.0, 1, wrench=wrench, quaternion=quaternion)
    return ContactSample(sample, Measurement(0.0, FORCE, 0.0, 0.0), (0.0, 0.0), (FORCE, 0.0, 0.0), wrench)


def unknown_pose(contact: ContactSample) -> ContactSample:
    """Return the sample without a known orientation."""
    return replace(contact, sample=replace(contact.sample, quaternion=()))


@pytest.mark.parametrize("tip", [(0.0, 0.0), (1.0, 0.0), (0.0, -1.0), (-0.7, 0.7)])
@pytest.mark.parametrize("centre", [(0.0, 0.0, 0.0), (0.01, -0.02, 0.12)])
def test_facing_moments_give_skew_of_face(tip, centre):
    quaternion = tool_at(*tip)
    face, contact = Face(centre, RADIUS), contact_of(quaternion, disc_wrench(quaternion, centre))
    axis, skew = measure_skew(FRAME, face, contact, PER_ANGLE)
    assert skew is not None
    # to be perpendicular, the axis must tip back by all that it is tipped
    assert (axis[1] + skew[0], axis[2] + skew[1]) == pytest.approx((0.0, 0.0), abs=math.radians(0.01))
    state = FacingState()
    for _ in range(200):
        sample = FacingSample(DT, 0.0, 0.0, (FORCE, 0.0, 0.0), (0.0, 0.0), axis, skew)
        state = FACING.after(state, sample, PER_ANGLE)
    assert off(state, (0.0, 0.0)) < 0.05
    assert math.degrees(state.sigma) < FACING.uncertain_deg


def test_subtract_zero_applies_along_each_axis():
    """Against scipy: a turned tool, and a frame of which no axis is one of the base."""
    axes = Rotation.from_rotvec((0.3, -0.8, 0.5)).as_matrix()
    frame = WorkFrame(*(tuple(row) for row in axes.tolist()))
    quaternion = normalise((0.2, 0.7, -0.5, 0.4))
    zero = (1.0, 2.0, -4.0, 0.1, -0.2, 0.3)
    force, wrench = (10.0, 0.5, -0.25), (3.0, -1.0, 7.0, 0.5, 0.6, 0.7)
    sample, lost = contact_of(quaternion, wrench).sample, Course(zero=zero)
    w, x, y, z = quaternion
    added = axes @ Rotation.from_quat((x, y, z, w)).apply(zero[:3])
    for known, state in ((sample, lost), (replace(sample, quaternion=()), replace(lost, home=quaternion))):
        counted, rest = subtract_zero(state, frame, known, force)
        assert counted == pytest.approx(np.array(force) + added, abs=1e-12)
        assert rest == pytest.approx(np.array(wrench) - np.array(zero), abs=1e-12)
    for unknown in (replace(sample, quaternion=()), replace(sample, wrench=())):
        assert subtract_zero(lost, frame, unknown, force) == (force, unknown.wrench)


def test_measure_skew_uses_work_frame():
    """A frame rotated together with the tool and the moments yields the same axis and skew."""
    quaternion = tool_at(0.7, -1.2)
    contact = contact_of(quaternion, disc_wrench(quaternion))
    face = Face(radius=RADIUS)
    axis, skew = measure_skew(FRAME, face, contact, PER_ANGLE)
    turn = Rotation.from_rotvec((0.3, -0.8, 0.5))
    w, x, y, z = quaternion
    x, y, z, w = (turn * Rotation.from_quat((x, y, z, w))).as_quat()
    turned = WorkFrame(*(tuple(turn.apply(direction)) for direction in (FRAME.approach, FRAME.x, FRAME.y)))
    assert measure_skew(turned, face, contact_of((w, x, y, z), contact.wrench), PER_ANGLE) == (
        pytest.approx(axis),
        pytest.approx(skew),
    )


def test_measure_skew_without_face_is_none():
    quaternion = tool_at(2.0, 0.0)
    contact = contact_of(quaternion, (0.0,) * 6)
    assert measure_skew(FRAME, Face(), contact, 0.0) == ((1.0, 0.0, 0.0), None)
    assert measure_skew(FRAME, Face(radius=RADIUS), replace(contact, wrench=()), PER_ANGLE)[1] is None
    assert measure_skew(FRAME, Face(radius=RADIUS), unknown_pose(contact), PER_ANGLE)[1] is None


def test_facing_skew_is_limited_to_10_degrees():
    state = FacingState()
    for _ in range(500):
        sample = FacingSample(DT, 0.0, 0.0, (FORCE, 0.0, 0.0), (0.0, 0.0), (1.0, 0.0, 0.0), (2.0, 0.0))
        state = FACING.after(state, sample, PER_ANGLE)
    assert math.degrees(math.atan(state.fall[0])) == pytest.approx(-10.0, abs=0.1)


# --- the force along the surface


@pytest.mark.parametrize("slopes", [(0.0, 0.0), (0.3, -0.2)])
@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_lateral_force_matches_friction(slopes, friction):
    assert lateral_of(pressed(slopes, (0.6, 0.8), friction), slopes) == pytest.approx(
        FORCE * friction, abs=1e-9
    )
