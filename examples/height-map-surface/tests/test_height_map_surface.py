"""Tests of heights read from files, of contact compared with analytic shapes, and of the loop over both."""

from pathlib import Path

import numpy as np
import pytest
from height_map_surface.__main__ import AMPLITUDE_MM, PERIOD_MM, RADIUS_MM, write_all, write_dome, write_waves
from height_map_surface.heights import from_image, from_stl
from height_map_surface.surface import SURFACE, HeightMapProfile
from PIL import Image

import hil_bridge
from emulators.surface.contact import Contact, SurfaceKind, SurfaceProfile
from hil_bridge.testing import SurfaceCase
from hil_bridge.testing.surfaces import *  # noqa: F403

PLACES = np.random.default_rng(7).uniform((0.89, -0.09, 0.585), (0.91, 0.09, 0.592), (400, 3))
SPEEDS = np.random.default_rng(8).uniform(-0.02, 0.02, (400, 3))


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("files")
    write_all(folder)
    write_dome(folder / "ascii.stl", ascii_text=True)
    return folder


@pytest.fixture
def surface(files: Path) -> SurfaceCase:
    settings = HeightMapProfile(stl_file=str(files / "dome.stl"))
    return SurfaceCase(
        SURFACE, above_m=(0.9, 0.0, 0.7), inside_m=(0.9, 0.0, 0.588), friction=0.2, settings=settings
    )


def compared(ours: SurfaceProfile, formula: SurfaceProfile) -> float:
    """Return the largest difference of two surfaces' forces, N."""
    both = [Contact(profile).force(PLACES, SPEEDS) for profile in (ours, formula)]
    assert abs(both[1]).max() > 20.0
    return float(abs(both[0] - both[1]).max())


def test_waves_of_an_image_push_as_waves_of_a_formula(files: Path) -> None:
    ours = HeightMapProfile(image_file=str(files / "waves.png"), white_mm=2.0 * AMPLITUDE_MM)
    formula = SurfaceProfile(
        SurfaceKind.SINUSOIDAL, height_mm=590.0 + AMPLITUDE_MM, amplitude_mm=AMPLITUDE_MM, period_mm=PERIOD_MM
    )
    assert compared(ours, formula) < 0.05


def test_a_dome_of_an_stl_file_pushes_as_a_ball(files: Path) -> None:
    ours = HeightMapProfile(stl_file=str(files / "dome.stl"), spacing_mm=2.0, friction=0.2)
    assert (
        compared(ours, SurfaceProfile(SurfaceKind.SPHERE, radius_mm=RADIUS_MM)) < 0.35
    )  # flat triangles of 4 mm


def test_binary_and_ascii_give_the_same_heights(files: Path) -> None:
    binary, text = (from_stl(str(files / name), (), 2.0) for name in ("dome.stl", "ascii.stl"))
    np.testing.assert_allclose(binary, text, atol=1e-8)
    section = from_stl(str(files / "dome.stl"), (-20.0, -10.0, 20.0, 10.0), 2.0)
    assert section.shape == (21, 11)
    np.testing.assert_array_equal(section, binary[50:71, 15:26])


def test_an_image_lies_as_it_is_said_to(tmp_path: Path) -> None:
    pixels = np.array([[0, 255], [51, 102]], dtype=np.uint8)  # top row first
    Image.fromarray(pixels).save(tmp_path / "small.png")
    heights = from_image(str(tmp_path / "small.png"), 10.0)
    np.testing.assert_allclose(heights, [[0.002, 0.0], [0.004, 0.01]], atol=1e-12)


@pytest.mark.parametrize("name", ["waves.toml", "dome.toml"])
def test_the_loop_closes_on_it(files: Path, name: str) -> None:
    result = hil_bridge.simulate(files / name, seed=7)
    assert result.outcome == "completed", result.text
    assert abs(result.figures.force_mean_steady_n - 10.0) < 0.5
    assert np.isfinite(result.arrays.truths.normal).all()


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({}, "set one of image_file and stl_file"),
        ({"image_file": "nothing.png"}, "nothing.png cannot be read: .*No such file"),
        ({"image_file": "dome.stl"}, "dome.stl cannot be read as a PNG"),
        ({"image_file": "colours.png"}, "mode RGB; save it as greyscale"),
        ({"stl_file": "waves.png"}, "waves.png (cannot be read as an STL file|contains no triangles)"),
        ({"stl_file": "dome.stl", "spacing_mm": 0.01}, "choose one of 2 by 2 to 262144"),
        ({"stl_file": "dome.stl", "section_mm": [0, 0, -1, 1]}, "section_mm must be x0 y0 x1 y1"),
        ({"image_file": "waves.png", "kind": "sphere"}, "kind must be left out"),
    ],
)
def test_a_wrong_file_or_setting_is_one_line(files: Path, settings: dict, words: str) -> None:
    write_waves(files / "waves.png")
    Image.new("RGB", (4, 4)).save(files / "colours.png")
    named = {key: str(files / value) if key.endswith("_file") else value for key, value in settings.items()}
    with pytest.raises(hil_bridge.ConfigError, match=words) as reported:
        hil_bridge.simulate({"cell": {"surface_kind": "height-map", "height_map": named}})
    assert "\n" not in str(reported.value)
