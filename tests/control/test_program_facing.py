"""The estimate of the surface's normal, on synthetic surfaces whose normal is known."""

import itertools
import math
from collections.abc import Callable

import numpy as np
import pytest
from msgspec.structs import replace
from scipy.spatial.transform import Rotation

from hil_bridge.control import Measurement, Sample
from hil_bridge.control.course.contact_sample import ContactSample
from hil_bridge.control.course.facing import Facing, FacingState, Look, inward, lateral_of
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
    """A cap whose top lies at the origin."""

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
            way = k * speed * DT
            depth, p, q = surface(x + way * heading[0], y + way * heading[1])
            force = np.array(pressed((p, q), heading, friction)) + noise * random.standard_normal(3)
            look = Look(DT, travel + way, depth, tuple(force), heading)
            state = facing.after(state, look, 1.0)
            errors.append((travel + way, off(state, (p, q))))
        travel += length
    return state, np.array(errors)


def off(state: FacingState, slopes: tuple[float, float]) -> float:
    """Angle between the estimated and the true normal, °."""
    cosine = sum(a * b for a, b in zip(inward(state.fall), inward(slopes), strict=True))
    return math.degrees(math.acos(min(cosine, 1.0)))


# --- by force and motion


@pytest.mark.parametrize("slopes", [(0.0, 0.0), (0.2, 0.0), (-0.15, 0.0), (0.0, 0.25), (0.1, -0.2)])
@pytest.mark.parametrize("friction", [0.0, 0.2, 0.5])
def test_the_normal_of_a_plane_is_found_within_1_degree(slopes, friction):
    state, errors = slide(plane(*slopes), [(0.0, 0.0), (0.03, 0.0)], friction=friction)
    assert errors[errors[:, 0] > 0.02, 1].max() < 1.0
    assert math.degrees(state.sigma) < 0.5
    assert math.tan(state.friction_angle) == pytest.approx(friction, abs=0.02)


def test_the_normal_of_a_plane_is_found_on_any_heading():
    for turn in np.linspace(0.0, math.tau, 9):
        end = 0.03 * math.cos(turn), 0.03 * math.sin(turn)
        _, errors = slide(plane(0.15, -0.1), [(0.0, 0.0), end])
        assert errors[errors[:, 0] > 0.02, 1].max() < 1.0


def test_noise_of_the_sensor_leaves_the_normal_within_1_degree():
    state, errors = slide(plane(0.1, 0.1), [(0.0, 0.0), (0.04, 0.0)], noise=0.3)
    assert errors[errors[:, 0] > 0.02, 1].max() < 1.0
    assert 0.05 < math.degrees(state.sigma) < 1.5


def test_the_normal_follows_a_sphere_around_its_corners():
    corners = [(-0.03, 0.0), (0.03, 0.0), (0.03, 0.015), (-0.03, 0.015)]
    _, errors = slide(sphere(0.3), corners)
    settled = errors[errors[:, 0] > 0.02, 1]
    assert settled.max() < 1.0
    assert math.sqrt(np.mean(settled**2)) < 0.5


def test_behind_a_corner_the_force_is_not_read_for_a_moment():
    state, _ = slide(plane(0.1, 0.0), [(0.0, 0.0), (0.03, 0.0)])
    turned = FACING.after(state, Look(DT, 0.03, 0.003, (FORCE, 9.0, 9.0), (0.0, 1.0)), 1.0)
    assert turned.blind > 0.0
    for _ in range(10):
        turned = FACING.after(turned, Look(DT, 0.03, 0.003, (FORCE, 9.0, 9.0), (0.0, 1.0)), 1.0)
    assert turned.fall == state.fall


def test_a_gentle_bend_is_the_same_stretch():
    state, _ = slide(plane(0.1, 0.0), [(0.0, 0.0), (0.03, 0.0)])
    heading = math.cos(math.radians(10.0)), math.sin(math.radians(10.0))
    bent = FACING.after(state, Look(DT, 0.03, 0.003, (FORCE, 1.0, 0.0), heading), 1.0)
    assert (bent.blind, bent.points) == (state.blind, state.points)


# --- what it does not know


def test_a_tool_that_stands_learns_nothing_and_stays_uncertain():
    state = FacingState(fall=(0.1, 0.05))
    for k in range(200):
        state = FACING.after(state, Look(DT, 0.0, 0.0, (FORCE, 3.0, -2.0), (0.0, 0.0)), 1.0)
        assert state.fall == pytest.approx((0.1, 0.05)), k
    assert math.degrees(state.sigma) > FACING.uncertain_deg


def test_before_there_is_a_path_the_direction_along_it_is_uncertain():
    state, _ = slide(plane(0.2, 0.0), [(0.0, 0.0), (0.002, 0.0)])
    assert math.degrees(state.sigma) > FACING.uncertain_deg
    assert state.friction_angle is None


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_a_reading_that_is_no_number_changes_nothing(bad):
    state, _ = slide(plane(0.1, 0.0), [(0.0, 0.0), (0.03, 0.0)])
    for look in (
        Look(DT, 0.03, 0.003, (bad, 0.0, 0.0), (1.0, 0.0)),
        Look(DT, 0.03, bad, (FORCE, 0.0, 0.0), (1.0, 0.0)),
        Look(DT, 0.03, 0.003, (FORCE, 0.0, 0.0), (1.0, 0.0), skew=(bad, 0.0)),
        Look(DT, 0.03, 0.003, (-1.0, 0.0, 0.0), (1.0, 0.0)),
    ):
        assert FACING.after(state, look, 1.0) == state


def test_no_normal_beyond_the_steepest_is_believed():
    state = FacingState()
    for k in range(3000):
        look = Look(DT, k * 1e-4, 0.0, (1.0, 0.0, -50.0), (1.0, 0.0))
        state = FACING.after(state, look, 1.0)
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
def test_an_estimate_that_makes_no_sense_is_refused(settings):
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
    assert depths.min() > 0.0, "the whole face must touch"
    forces = -(weights / weights.sum() * STIFFNESS * depths)[:, None] * down
    return (*forces.sum(axis=0), *np.cross(arms, forces).sum(axis=0))


def felt_of(quaternion: Quaternion, wrench: tuple[float, ...]) -> ContactSample:
    sample = Sample(0.0, (0.9, 0.0, 0.6), FORCE, FORCE, 0.0, 1, wrench=wrench, quaternion=quaternion)
    return ContactSample(sample, Measurement(0.0, FORCE, 0.0, 0.0), (0.0, 0.0), (FORCE, 0.0, 0.0), wrench)


def unknown_pose(felt: ContactSample) -> ContactSample:
    """The same where the orientation is not known."""
    return replace(felt, sample=replace(felt.sample, quaternion=()))


@pytest.mark.parametrize("tip", [(0.0, 0.0), (1.0, 0.0), (0.0, -1.0), (-0.7, 0.7)])
@pytest.mark.parametrize("centre", [(0.0, 0.0, 0.0), (0.01, -0.02, 0.12)])
def test_the_moments_at_a_face_tell_how_it_stands_to_a_flat_surface(tip, centre):
    quaternion = tool_at(*tip)
    face, felt = Face(centre, RADIUS), felt_of(quaternion, disc_wrench(quaternion, centre))
    axis, skew = measure_skew(FRAME, face, felt, PER_ANGLE)
    assert skew is not None
    # to be perpendicular, the axis must tip back by all that it is tipped
    assert (axis[1] + skew[0], axis[2] + skew[1]) == pytest.approx((0.0, 0.0), abs=math.radians(0.01))
    state = FacingState()
    for _ in range(200):
        look = Look(DT, 0.0, 0.0, (FORCE, 0.0, 0.0), (0.0, 0.0), axis, skew)
        state = FACING.after(state, look, PER_ANGLE)
    assert off(state, (0.0, 0.0)) < 0.05
    assert math.degrees(state.sigma) < FACING.uncertain_deg


def test_the_zero_of_a_program_is_added_along_each_axis_of_the_frame():
    """Against scipy: a turned tool, and a frame of which no axis is one of the base."""
    axes = Rotation.from_rotvec((0.3, -0.8, 0.5)).as_matrix()
    frame = WorkFrame(*(tuple(row) for row in axes.tolist()))
    quaternion = normalise((0.2, 0.7, -0.5, 0.4))
    zero = (1.0, 2.0, -4.0, 0.1, -0.2, 0.3)
    force, wrench = (10.0, 0.5, -0.25), (3.0, -1.0, 7.0, 0.5, 0.6, 0.7)
    sample, lost = felt_of(quaternion, wrench).sample, Course(zero=zero)
    w, x, y, z = quaternion
    added = axes @ Rotation.from_quat((x, y, z, w)).apply(zero[:3])
    for known, state in ((sample, lost), (replace(sample, quaternion=()), replace(lost, home=quaternion))):
        counted, rest = subtract_zero(state, frame, known, force)
        assert counted == pytest.approx(np.array(force) + added, abs=1e-12)
        assert rest == pytest.approx(np.array(wrench) - np.array(zero), abs=1e-12)
    for unknown in (replace(sample, quaternion=()), replace(sample, wrench=())):
        assert subtract_zero(lost, frame, unknown, force) == (force, unknown.wrench)


def test_a_face_is_judged_in_the_work_frame_whatever_its_axes():
    """A frame that is turned with tool and moments tells the same axis and skew."""
    quaternion = tool_at(0.7, -1.2)
    felt = felt_of(quaternion, disc_wrench(quaternion))
    face = Face(radius=RADIUS)
    axis, skew = measure_skew(FRAME, face, felt, PER_ANGLE)
    turn = Rotation.from_rotvec((0.3, -0.8, 0.5))
    w, x, y, z = quaternion
    x, y, z, w = (turn * Rotation.from_quat((x, y, z, w))).as_quat()
    turned = WorkFrame(*(tuple(turn.apply(way)) for way in (FRAME.approach, FRAME.x, FRAME.y)))
    assert measure_skew(turned, face, felt_of((w, x, y, z), felt.wrench), PER_ANGLE) == (
        pytest.approx(axis),
        pytest.approx(skew),
    )


def test_a_tool_without_a_face_is_told_no_skew():
    quaternion = tool_at(2.0, 0.0)
    felt = felt_of(quaternion, (0.0,) * 6)
    assert measure_skew(FRAME, Face(), felt, 0.0) == ((1.0, 0.0, 0.0), None)
    assert measure_skew(FRAME, Face(radius=RADIUS), replace(felt, wrench=()), PER_ANGLE)[1] is None
    assert measure_skew(FRAME, Face(radius=RADIUS), unknown_pose(felt), PER_ANGLE)[1] is None


def test_no_moment_is_taken_for_more_than_10_degrees():
    state = FacingState()
    for _ in range(500):
        look = Look(DT, 0.0, 0.0, (FORCE, 0.0, 0.0), (0.0, 0.0), (1.0, 0.0, 0.0), (2.0, 0.0))
        state = FACING.after(state, look, PER_ANGLE)
    assert math.degrees(math.atan(state.fall[0])) == pytest.approx(-10.0, abs=0.1)


# --- the force along the surface


@pytest.mark.parametrize("slopes", [(0.0, 0.0), (0.3, -0.2)])
@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_the_lateral_force_is_that_of_friction(slopes, friction):
    assert lateral_of(pressed(slopes, (0.6, 0.8), friction), slopes) == pytest.approx(
        FORCE * friction, abs=1e-9
    )
