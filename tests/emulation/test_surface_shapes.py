"""Tests of surfaces curved in two directions, and of heights from a file."""

import math
import os
from pathlib import Path

import numpy as np
import pytest

from emulators.surface.contact import Contact, SurfaceKind, SurfaceProfile
from emulators.surface.height_map import HEIGHTS_LIMIT, read_height_map
from emulators.surface.shapes import HeightMap, SinusoidalBoth, Sphere

TOP = 0.59


def test_sphere_falls_away_in_every_direction() -> None:
    ball = Sphere(0.0, 0.1)
    along, across, height = np.array([0.0, 0.03, 0.0]), np.array([0.0, 0.0, -0.03]), np.array([-0.01] * 3)
    depth, (n_along, n_across, n_up) = ball.depth_and_normal(along, across, height)
    aside = 0.1 - math.hypot(0.03, 0.09)
    assert depth == pytest.approx([0.01, aside, aside])
    assert n_along / n_up == pytest.approx([0.0, 0.03 / 0.09, 0.0])
    assert n_across / n_up == pytest.approx([0.0, 0.0, -0.03 / 0.09])


def test_sphere_has_normal_in_its_centre() -> None:
    nothing = np.zeros(1)
    depth, (*_, up) = Sphere(0.0, 0.1).depth_and_normal(nothing, nothing, np.array([-0.1]))
    assert (depth[0], up[0]) == (0.1, 1.0)


def test_waves_in_both_directions_add_up() -> None:
    waves = SinusoidalBoth(0.0, 0.004, 0.1, 0.05)
    along, across = np.array([0.025, 0.0, 0.025]), np.array([0.0, 0.0125, 0.0125])
    depth, normal = waves.depth_and_normal(along, across, np.array([0.004, 0.004, 0.008]))
    assert depth == pytest.approx([0.0] * 3, abs=1e-15)
    rise, rise_across = 0.004 * 2.0 * math.pi / 0.1, 0.004 * 2.0 * math.pi / 0.05
    assert -normal[0] / normal[2] == pytest.approx([0.0, rise, 0.0], abs=1e-12)
    assert -normal[1] / normal[2] == pytest.approx([rise_across, 0.0, 0.0], abs=1e-12)


def test_across_is_left_of_path_in_any_direction() -> None:
    contact = Contact(SurfaceProfile(kind=SurfaceKind.SPHERE, radius_mm=100.0, path_deg=30.0))
    for x, y in ((0.03, 0.0), (-0.01, 0.02), (0.0, -0.04)):
        _, normal = contact.depth_and_normal(np.array([[0.9 + x, y, TOP]]))
        assert normal[0] == pytest.approx(np.array([x, y, 0.1]) / math.hypot(x, y, 0.1))


def written(folder: Path, text: str) -> str:
    file = folder / "heights.txt"
    file.write_text(text)
    return str(file)


def test_heights_are_read_from_file(tmp_path: Path) -> None:
    name = written(tmp_path, "# mm\n0, 1.5\t2\n\n-1 0 1e1 # a row\n")
    np.testing.assert_array_equal(read_height_map(name), [[0.0, 0.0015, 0.002], [-0.001, 0.0, 0.01]])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1 2\n3\n", "line 2: 1 heights, but 2 in the first row"),
        ("1 2\n3 nan\n", "line 2: 'nan' is not a height"),
        ("1 2\n3 inf\n", "'inf' is not a height"),
        ("1 two\n", "'two' is not a height"),
        ("1e9\n", "'1e9' is not a height"),
        ("# nothing\n", "no heights"),
        ("0 " * (HEIGHTS_LIMIT + 1), f"more than {HEIGHTS_LIMIT} heights"),
        ("0" * (1 << 22) + "\n", "longer than"),
    ],
    ids=["ragged", "nan", "inf", "word", "far", "empty", "many", "long"],
)
def test_file_without_grid_is_refused(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(ValueError, match="height_map_file") as caught:
        read_height_map(written(tmp_path, text))
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_unreadable_file_is_refused(tmp_path: Path) -> None:
    binary = tmp_path / "binary"
    binary.write_bytes(b"\xff\xfe\x00")
    os.mkfifo(tmp_path / "pipe")
    result = (
        ("missing.txt", "No such file"),
        ("", "Is a directory"),
        ("binary", "is not a UTF-8 text file"),
        ("pipe", "a pipe or a device"),
        ("/dev/zero", "a pipe or a device"),
    )
    for name, message in result:
        with pytest.raises(ValueError, match=message) as caught:
            read_height_map(str(tmp_path / name))
        assert "\n" not in str(caught.value)
    with pytest.raises(ValueError, match="cannot read 'a"):
        read_height_map("a\0b")
    with pytest.raises(ValueError, match="height_map_file is empty"):
        SurfaceProfile(kind=SurfaceKind.HEIGHT_MAP)


def test_map_passes_through_its_heights(tmp_path: Path) -> None:
    name = written(tmp_path, "0 0 0\n0 2 4\n0 0 0\n")
    profile = SurfaceProfile(kind=SurfaceKind.HEIGHT_MAP, height_map_file=name, height_map_spacing_mm=10.0)
    contact = Contact(profile)
    # The path is base y, so across, to its left, is base -x.
    places = [[0.9, 0.0, TOP + 0.002], [0.89, 0.0, TOP + 0.004], [0.91, 0.01, TOP]]
    assert contact.depth_and_normal(np.array(places))[0] == pytest.approx([0.0] * 3, abs=1e-12)


def test_map_approximates_smooth_surface() -> None:
    spacing, radius = 0.005, 0.3
    row, column = np.meshgrid(np.arange(-10, 11) * spacing, np.arange(-8, 9) * spacing, indexing="ij")
    heights = np.sqrt(radius**2 - row**2 - column**2) - radius
    rng = np.random.default_rng(1)
    along, across = rng.uniform(-0.04, 0.04, 200), rng.uniform(-0.03, 0.03, 200)
    height = np.full(200, -0.002)
    depth, normal = HeightMap(0.0, heights, spacing).depth_and_normal(along, across, height)
    expected, ball = Sphere(0.0, radius).depth_and_normal(along, across, height)
    np.testing.assert_allclose(depth, expected, rtol=0.0, atol=3e-5)
    np.testing.assert_allclose(normal, ball, rtol=0.0, atol=2e-3)


def test_normal_of_map_is_continuous() -> None:
    heights = np.random.default_rng(2).uniform(-0.001, 0.001, (6, 5))
    shape = HeightMap(0.0, heights, 0.01)
    along = np.linspace(-0.06, 0.06, 48_001)
    for across in (-0.031, 0.0, 0.01, 0.023):
        depth, normal = shape.depth_and_normal(along, np.full_like(along, across), np.zeros_like(along))
        assert np.abs(np.diff(normal)).max() < 5e-4  # a step is a 4000th of the spacing
        assert np.abs(np.diff(depth)).max() < 2e-6
    level = shape.depth_and_normal(np.array([9.0, -9.0]), np.zeros(2), np.zeros(2))
    np.testing.assert_allclose(level[1][0], 0.0, atol=1e-15)


def test_single_height_is_level() -> None:
    depth, (*_, up) = HeightMap(0.5, np.zeros((1, 1)), 0.01).depth_and_normal(
        np.array([0.3, 0.0]), np.zeros(2), np.array([0.499, 0.501])
    )
    assert depth == pytest.approx([0.001, -0.001])
    assert up == pytest.approx([1.0, 1.0])
