"""Clamping of orders in any direction, compared with numpy."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from hil_bridge.control import Allow, Clamp, Limits, Request, Supervisor
from hil_bridge.control.course.verdict import SupervisorState
from hil_bridge.errors import Cause
from protocol.geometry import Vector
from tests.observed import observation

DT = 0.18
LIMITS = Limits(correction_mm_s=11.0, travel_mm_s=27.5, correction_total_mm=20.0)
DEEPEST, LONGEST = 11e-3 * DT, 27.5e-3 * DT


def place_of(array: NDArray[np.float64]) -> Vector:
    x, y, z = array.tolist()
    return x, y, z


def clamped(
    limits: Limits,
    state: SupervisorState,
    depth: float,
    position: NDArray[np.float64],
    direction: NDArray[np.float64],
) -> Allow | Clamp:
    requested = Request(depth, place_of(position), place_of(direction))
    _, verdict = Supervisor(limits).step(state, observation(5.0, sensor_at=99.99), requested)
    assert isinstance(verdict, Allow | Clamp)
    return verdict


@pytest.mark.parametrize("seed", range(40))
def test_clamp_limits_depth_and_travel_separately(seed: int) -> None:
    draw = np.random.default_rng(seed)
    direction = draw.normal(size=3)
    direction /= np.linalg.norm(direction)
    aside = np.cross(direction, draw.normal(size=3))
    aside *= draw.uniform(0.0, 3.0) * LONGEST / np.linalg.norm(aside)
    before, at = draw.uniform(-0.1, 0.1, 3), draw.uniform(-0.01, 0.01)
    deeper = draw.uniform(-3.0, 3.0) * DEEPEST
    state = SupervisorState(at, place_of(before))
    verdict = clamped(LIMITS, state, at + deeper, before + direction * deeper + aside, direction)
    deepening, length = min(deeper, DEEPEST), float(np.linalg.norm(aside))
    expected = before + direction * deepening + aside * min(1.0, LONGEST / length)
    assert verdict.depth == pytest.approx(at + deepening, abs=1e-12)
    assert verdict.position == pytest.approx(expected, abs=1e-9)
    causes = [Cause.DEEPER] * (deeper > DEEPEST) + [Cause.ACROSS] * (length > LONGEST + 1e-9)
    assert [hold.cause for hold in getattr(verdict, "holds", ())] == causes


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_clamp_border_does_not_hold_depth(axis: int, side: float) -> None:
    box = Limits(workspace_min_m=(-0.1, -0.1, -0.1), workspace_max_m=(0.1, 0.1, 0.1))
    outwards = np.eye(3)[axis] * side
    before = outwards * 0.0999
    direction = np.eye(3)[(axis + 1) % 3]
    state = SupervisorState(0.0, place_of(before))
    verdict = clamped(box, state, 1e-3, before + direction * 1e-3 + outwards * 1e-3, direction)
    assert isinstance(verdict, Clamp)
    assert verdict.is_for(Cause.WORKSPACE)
    assert verdict.depth == pytest.approx(1e-3)
    assert verdict.position == pytest.approx(before + direction * 1e-3, abs=1e-12)
    into = clamped(box, state, 1e-3, before + outwards * 1e-3, outwards)
    assert into.depth == pytest.approx(1e-4)
    assert into.position == pytest.approx(before + outwards * 1e-4, abs=1e-12)


def test_clamp_slanted_approach_ends_at_border() -> None:
    box = Limits(workspace_min_m=(-0.1, -0.1, -0.1), workspace_max_m=(0.1, 0.1, 0.1))
    direction = np.array((0.48, -0.6, 0.64))
    before = np.array((0.05, -0.0994, 0.02))
    state = SupervisorState(2e-3, place_of(before))
    verdict = clamped(box, state, 2e-3 + 1.5e-3, before + direction * 1.5e-3, direction)
    assert verdict.depth == pytest.approx(2e-3 + 1e-3)
    assert verdict.position == pytest.approx(before + direction * 1e-3, abs=1e-12)
    assert math.isclose(verdict.position[1], -0.1)
