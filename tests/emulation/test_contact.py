"""Tests of the forces of a surface on the tool tip."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from emulators.surface.contact import Contact, SurfaceKind, SurfaceProfile
from emulators.surface.shapes import CircularArc, Plane, Sinusoidal

TOP = 0.59
BY_SETTINGS = [kind for kind in SurfaceKind if kind is not SurfaceKind.HEIGHT_MAP]
"""Kinds of surface that need no file."""


def force(profile: SurfaceProfile, position: tuple[float, ...], velocity: tuple[float, ...]) -> np.ndarray:
    return Contact(profile).force(np.array([position]), np.array([velocity]))[0]


def test_spring_pushes_out_and_never_pulls() -> None:
    profile = SurfaceProfile(damping_ns_m=0.0)
    assert force(profile, (0.9, 0.0, TOP - 0.002), (0.0, 0.0, 0.0)) == pytest.approx([0.0, 0.0, 10.0])
    assert not force(profile, (0.9, 0.0, TOP + 1e-6), (0.0, 0.0, -1.0)).any()


def test_damping_resists_approach_and_never_pulls() -> None:
    profile = SurfaceProfile(damping_ns_m=50.0)
    inside = (0.9, 0.0, TOP - 0.002)
    assert force(profile, inside, (0.0, 0.0, -0.1)) == pytest.approx([0.0, 0.0, 15.0])
    assert force(profile, inside, (0.0, 0.0, 0.1)) == pytest.approx([0.0, 0.0, 5.0])
    assert not force(profile, inside, (0.0, 0.0, 0.3)).any()
    assert not force(profile, (0.9, 0.0, TOP + 0.001), (0.0, 0.0, -1.0)).any()


def test_friction_opposes_sliding_in_proportion_to_force() -> None:
    profile = SurfaceProfile(friction=0.3, friction_smoothing_mm_s=1e-6)
    pushed = force(profile, (0.9, 0.0, TOP - 0.002), (0.03, 0.04, 0.0))
    assert pushed == pytest.approx([-1.8, -2.4, 10.0])
    slow = SurfaceProfile(friction=0.3, friction_smoothing_mm_s=1.0)
    assert force(slow, (0.9, 0.0, TOP - 0.002), (0.0, 0.001, 0.0)) == pytest.approx(
        [0.0, -3.0 / math.sqrt(2.0), 10.0]
    )


@given(
    arrays(float, (5, 3), elements=st.floats(-0.02, 0.02)),
    arrays(float, (5, 3), elements=st.floats(-0.5, 0.5)),
    st.sampled_from(BY_SETTINGS),
)
def test_contact_never_pulls_and_friction_never_drives(
    offsets: np.ndarray, velocities: np.ndarray, kind: SurfaceKind
) -> None:
    contact = Contact(SurfaceProfile(kind=kind, friction=0.4))
    positions = np.array([0.9, 0.0, TOP]) + offsets
    depth, normals = contact.depth_and_normal(positions)
    forces = contact.force(positions, velocities)
    pressing = np.einsum("ij,ij->i", forces, normals)
    tangential = forces - pressing[:, None] * normals
    assert (pressing >= -1e-12).all()
    assert (np.abs(forces[depth <= 0.0]) == 0.0).all()
    assert (np.einsum("ij,ij->i", tangential, velocities) <= 1e-12).all()
    assert (np.linalg.norm(tangential, axis=1) <= 0.4 * pressing + 1e-12).all()
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, rtol=1e-12)


def test_normal_of_slope_leans_back_from_rise() -> None:
    profile = SurfaceProfile(kind=SurfaceKind.SLOPED, slope_deg=30.0, damping_ns_m=0.0, friction=0.0)
    # 10 cm along the path (base y) the surface is 10 cm · tan 30° higher; 2 mm below it straight down.
    height = TOP + 0.1 * math.tan(math.radians(30.0))
    pressing = 5000.0 * 0.002 * math.cos(math.radians(30.0))
    expected = [0.0, -pressing * 0.5, pressing * math.cos(math.radians(30.0))]
    assert force(profile, (0.9, 0.1, height - 0.002), (0.0, 0.0, 0.0)) == pytest.approx(expected)


def test_path_may_have_any_direction() -> None:
    profile = SurfaceProfile(
        kind=SurfaceKind.SLOPED, slope_deg=30.0, path_deg=0.0, damping_ns_m=0.0, origin_x_mm=800.0
    )
    height = TOP + 0.1 * math.tan(math.radians(30.0))
    pushed = force(profile, (0.9, 0.4, height - 0.002), (0.0, 0.0, 0.0))
    assert pushed[0] < 0.0
    assert pushed[1] == pytest.approx(0.0, abs=1e-12)


def test_depth_at_arc_axis_is_radius() -> None:
    along, height = np.array([0.03, 0.0, 0.2]), np.array([-0.01, 0.001, -0.1])
    depth, (normal_along, _, normal_up) = CircularArc(0.0, 0.1).depth_and_normal(along, along, height)
    assert depth == pytest.approx([0.1 - math.hypot(0.03, 0.09), -0.001, 0.1 - 0.2])
    assert normal_along[0] / normal_up[0] == pytest.approx(0.03 / 0.09)


def test_arc_has_normal_on_its_axis() -> None:
    nothing = np.array([0.0])
    depth, (*_, up) = CircularArc(0.0, 0.1).depth_and_normal(nothing, nothing, np.array([-0.1]))
    assert (depth[0], up[0]) == (0.1, 1.0)


def test_wave_depth_matches_distance_to_curve() -> None:
    wave = Sinusoidal(0.0, 0.005, 0.1)
    curve_s = np.linspace(-0.05, 0.05, 200_001)
    curve_h = 0.005 * np.sin(2.0 * math.pi * curve_s / 0.1)
    for along in (-0.02, 0.0, 0.011, 0.025):
        height = 0.005 * math.sin(2.0 * math.pi * along / 0.1) - 0.0005
        depth, _ = wave.depth_and_normal(np.array([along]), np.zeros(1), np.array([height]))
        nearest = np.hypot(curve_s - along, curve_h - height).min()
        assert depth[0] == pytest.approx(nearest, rel=0.02)


@pytest.mark.parametrize("kind", BY_SETTINGS)
def test_normal_is_steepest_descent_of_depth(kind: SurfaceKind) -> None:
    contact = Contact(SurfaceProfile(kind=kind, path_deg=30.0))
    for along in (-0.04, 0.013, 0.031):
        place = np.array([0.9 + along * math.cos(math.pi / 6), along * math.sin(math.pi / 6), TOP])
        for _ in range(30):  # down or up to the surface
            place[2] += contact.depth_and_normal(place[None])[0][0]
        steps = 1e-7 * np.eye(3)
        ahead, behind = (contact.depth_and_normal(place + sign * steps)[0] for sign in (1.0, -1.0))
        normal = contact.depth_and_normal(place[None])[1][0]
        np.testing.assert_allclose((behind - ahead) / 2e-7, normal, rtol=0, atol=1e-6)


def test_zero_slope_is_flat() -> None:
    depth, (along, _, up) = Plane(0.5, 0.0).depth_and_normal(np.array([0.3]), np.zeros(1), np.array([0.499]))
    assert (depth[0], along[0], up[0]) == (pytest.approx(0.001), 0.0, 1.0)


def test_depth_below_slope_matches_shape() -> None:
    profile = SurfaceProfile(kind=SurfaceKind.SLOPED, slope_deg=20.0, path_deg=30.0, origin_y_mm=50.0)
    places = np.array([[0.9, 0.05, 0.59], [1.1, -0.3, 0.7], [0.4, 0.2, 0.5]])
    depth, normals = Contact(profile).depth_and_normal(places)
    along = (places - [0.9, 0.05, 0.0]) @ [math.cos(math.pi / 6), 0.5, 0.0]
    expected, (normal_along, _, normal_up) = profile.shape().depth_and_normal(along, along, places[:, 2])
    np.testing.assert_allclose(depth, expected, rtol=0, atol=1e-15)
    np.testing.assert_allclose(normals[:, 2], normal_up, rtol=1e-15)
    np.testing.assert_allclose(normals[:, 1], normal_along * 0.5, rtol=1e-15)


@pytest.mark.parametrize(
    "bad",
    [
        {"stiffness_n_m": -1.0},
        {"damping_ns_m": -1.0},
        {"friction": -0.1},
        {"period_mm": 0.0},
        {"radius_mm": 0.0},
        {"slope_deg": 90.0},
        {"stiffness_n_m": math.nan},
    ],
)
def test_invalid_surface_is_refused(bad: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=next(iter(bad))):
        SurfaceProfile(**bad)
