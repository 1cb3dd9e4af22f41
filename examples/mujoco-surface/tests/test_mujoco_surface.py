"""Tests of MuJoCo's contact against hil-bridge's own on a plane and a sphere, and of the loop over it."""

from pathlib import Path

import numpy as np
import pytest
from mujoco_surface.surface import SURFACE, MujocoProfile, MujocoSurface, make

import hil_bridge
from emulators.surface.contact import Contact, SurfaceKind, SurfaceProfile
from hil_bridge.testing import SurfaceCase
from hil_bridge.testing.surfaces import *  # noqa: F403

KINDS = {"plane": SurfaceKind.FLAT, "sphere": SurfaceKind.SPHERE}
NEAR = [900.0, -100.0, 593.0]
"""Start just above the surface, mm: a short approach."""
CELL = {"robot": {"emulated": "egm"}, "run": {"duration_s": 1.0}}


@pytest.fixture(params=KINDS)
def surface(request: pytest.FixtureRequest) -> SurfaceCase:
    settings = MujocoProfile(shape=request.param)
    return SurfaceCase(
        SURFACE, above_m=(0.9, 0.0, 0.7), inside_m=(0.9, 0.0, 0.588), friction=0.2, settings=settings
    )


def places(count: int = 300) -> np.ndarray:
    """Return positions of a tip from 2 mm above the surface to 12 mm below, m."""
    return np.random.default_rng(7).uniform((0.88, -0.02, 0.578), (0.92, 0.02, 0.592), (count, 3))


def both(shape: str, positions: np.ndarray, velocities: np.ndarray, **settings: float) -> list[np.ndarray]:
    """Return the forces of MuJoCo's surface and of ours, N."""
    ours = Contact(SurfaceProfile(KINDS[shape], **settings))
    theirs = MujocoSurface(MujocoProfile(shape=shape, **settings))
    times = np.arange(len(positions)) / 8000.0
    return [theirs.force(positions, velocities, times), ours.force(positions, velocities, times)]


@pytest.mark.parametrize("stiffness_n_m", [500.0, 5000.0, 50_000.0])
def test_an_indentation_of_a_plane_gives_the_force_of_a_linear_spring(stiffness_n_m: float) -> None:
    theirs, ours = both("plane", places(), np.zeros((300, 3)), stiffness_n_m=stiffness_n_m)
    assert ours[:, 2].max() > 0.01 * stiffness_n_m
    np.testing.assert_allclose(theirs, ours, rtol=1e-9, atol=1e-9)


def test_an_indentation_of_a_ball_gives_the_same_force_as_ours() -> None:
    """Within 0.1 % of the largest force: the tip is a sphere of 0.05 mm there, and a point here."""
    theirs, ours = both("sphere", places(), np.zeros((300, 3)))
    assert abs(theirs - ours).max() < 1e-3 * ours[:, 2].max()


@pytest.mark.parametrize("shape", KINDS)
def test_damping_and_friction_are_those_of_ours_while_the_tip_slides(shape: str) -> None:
    """Within 3 % for 20 to 50 mm/s, where ours has also reached Coulomb friction."""
    random = np.random.default_rng(8)
    angle, speed = random.uniform(0.0, 2.0 * np.pi, 300), random.uniform(0.02, 0.05, 300)
    velocities = np.stack((speed * np.cos(angle), speed * np.sin(angle), random.uniform(-0.01, 0.01, 300)), 1)
    theirs, ours = both(shape, places(), velocities, damping_ns_m=50.0)
    size = np.linalg.norm(ours, axis=1)
    pressed = size > 1.0
    assert pressed.sum() > 200
    assert (np.linalg.norm(theirs - ours, axis=1)[pressed] / size[pressed]).max() < 0.03


def test_a_tip_that_leaves_is_not_pulled() -> None:
    theirs, _ = both("plane", np.array([[0.9, 0.0, 0.5899]]), np.array([[0.0, 0.0, 1.0]]), damping_ns_m=50.0)
    np.testing.assert_array_equal(theirs, np.zeros((1, 3)))


def test_a_sample_has_one_force_whatever_was_asked_before() -> None:
    surface, other = make(MujocoProfile())(lambda since: None), make(MujocoProfile())(lambda since: None)
    positions, velocities, times = places(50), np.full((50, 3), 0.02), np.arange(50.0)
    forwards = surface.force(positions, velocities, times)
    backwards = other.force(positions[::-1], velocities, times)[::-1]
    np.testing.assert_array_equal(forwards, backwards)


def test_the_loop_closes_and_repeats_to_the_last_bit() -> None:
    cell = CELL | {
        "task": {"approach_depth_limit_mm": 25.0},
        "cell": {"surface_kind": "mujoco", "mujoco": {"shape": "sphere"}, "start_position_mm": NEAR},
    }
    first, second = (hil_bridge.simulate(cell, seed=7) for _ in range(2))
    assert first.outcome == "completed", first.text
    assert abs(first.figures.force_mean_steady_n - 10.0) < 0.5
    assert first.cycles == second.cycles
    np.testing.assert_array_equal(first.arrays.truths.force, second.arrays.truths.force)


SCENE = """<mujoco><worldbody>
<geom type="box" size="0.05 0.3 0.01" pos="0.9 0 0.58" euler="5 0 0"/>
{more}
</worldbody></mujoco>"""


def test_a_scene_of_mjcf_is_looked_for_beside_the_configuration(tmp_path: Path) -> None:
    (tmp_path / "scene.xml").write_text(SCENE.format(more=""), encoding="utf-8")
    site = tmp_path / "site.toml"
    site.write_text(
        '[robot]\nemulated = "egm"\n[run]\nduration_s = 1\n'
        '[cell]\nstart_position_mm = [900, -100, 593]\nsurface_kind = "mujoco"\n'
        '[cell.mujoco]\nscene_file = "scene.xml"\n',
        encoding="utf-8",
    )
    result = hil_bridge.simulate(site, seed=7)
    assert result.outcome == "completed", result.text
    assert abs(result.figures.force_mean_steady_n - 10.0) < 0.5


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (None, "the file cannot be read"),
        ("<mujoco><worldbody>", "MuJoCo cannot load the scene"),
        (SCENE.format(more='<body><freejoint/><geom size="0.1"/></body>'), "something in the scene can move"),
    ],
)
def test_a_wrong_scene_is_one_line(tmp_path: Path, text: str | None, words: str) -> None:
    scene = tmp_path / "scene.xml"
    if text is not None:
        scene.write_text(text, encoding="utf-8")
    with pytest.raises(hil_bridge.ConfigError, match=words) as reported:
        hil_bridge.simulate({"cell": {"surface_kind": "mujoco", "mujoco": {"scene_file": str(scene)}}})
    assert "\n" not in str(reported.value)
