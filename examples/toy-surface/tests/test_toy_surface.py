"""Suite for surfaces, and tests that the plate acts as a spring and that the loop closes over it."""

import numpy as np
import pytest
from toy_surface.surface import SURFACE, Spring, SpringProfile

import hil_bridge
from hil_bridge.testing import SurfaceCase
from hil_bridge.testing.surfaces import *  # noqa: F403

NEAR = {"start_position_mm": [900.0, -100.0, 593.0]}  # just above the surface


@pytest.fixture
def surface() -> SurfaceCase:
    return SurfaceCase(SURFACE, above_m=(0.9, -0.1, 0.7), inside_m=(0.9, -0.1, 0.588))


def test_the_plate_is_a_spring_that_never_pulls() -> None:
    spring = Spring(SpringProfile(height_mm=590.0, stiffness_n_mm=5.0), lambda since: None)
    places = np.array([[0.9, 0.0, 0.588], [0.9, 0.0, 0.6]])
    force = spring.force(places, np.zeros((2, 3)), np.array([0.0, 1.0]))
    np.testing.assert_allclose(force, [[0.0, 0.0, 10.0], [0.0, 0.0, 0.0]], atol=1e-9)


def test_the_loop_closes_over_the_plate() -> None:
    result = hil_bridge.simulate(
        {
            "robot": {"emulated": "egm"},
            "run": {"duration_s": 1.0},
            "cell": {**NEAR, "surface_kind": "toyspring"},
        }
    )
    assert result.outcome == "completed", result.text
    assert abs(result.figures.force_mean_steady_n - 10.0) < 0.5
