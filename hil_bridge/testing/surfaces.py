"""Tests that every surface must pass, for the author's test module.

    import pytest
    from hil_bridge.testing import SurfaceCase
    from hil_bridge.testing.surfaces import *
    from my_package.room import SURFACE

    @pytest.fixture
    def surface():
        return SurfaceCase(SURFACE, above_m=(0.9, -0.1, 0.7), inside_m=(0.9, -0.1, 0.588))

The tests use only the interface `emulators.seams.Surface`. They touch the surface along the line from `above_m` to
`inside_m`.
"""

from typing import Any

import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from emulators.seams import Floats, ShapedSurface
from hil_bridge.testing.cases import SurfaceCase, declared
from hil_bridge.testing.naming import Finding

__all__ = [
    "test_above_it_nothing_is_felt",
    "test_any_numbers_are_answered_with_numbers",
    "test_deeper_is_never_softer",
    "test_every_fault_of_the_surface_has_a_handler",
    "test_friction_acts_against_the_sliding",
    "test_it_never_pulls",
    "test_normals_are_those_of_the_force",
    "test_pieces_of_a_path_are_answered_as_the_whole",
    "test_questions_aside_change_nothing",
    "test_shown_again_it_answers_the_same",
]

_RATE_HZ = 8000.0
"""Lowest sample rate for a surface with memory, Hz."""
_BEGIN_S = 100.0


def _make_surface(case: SurfaceCase) -> Any:
    given = case.kind.settings() if case.settings is None else case.settings
    return case.kind.make(given)(lambda since: None)


def _line(case: SurfaceCase, samples: int) -> tuple[Floats, Floats, Floats]:
    """Return positions, velocities and times of a slow path from the position above to the position inside."""
    share = np.linspace(0.0, 1.0, samples)[:, np.newaxis]
    above, inside = np.array(case.above_m), np.array(case.inside_m)
    positions = above + share * (inside - above)
    times = _BEGIN_S + np.arange(samples) / _RATE_HZ
    return positions, np.zeros_like(positions), times


def _outward(case: SurfaceCase) -> Floats:
    direction: Floats = np.array(case.above_m) - np.array(case.inside_m)
    return direction / np.linalg.norm(direction)


def _forces(surface: Any, positions: Floats, velocities: Floats, times: Floats) -> Floats:
    force = np.asarray(surface.force(positions, velocities, times))
    if force.shape != positions.shape:
        raise Finding(f"{len(times)} positions give forces of shape {force.shape}, not {positions.shape}")
    if not np.isfinite(force).all():
        raise Finding("a force is not a number")
    return force


def test_above_it_nothing_is_felt(surface: SurfaceCase) -> None:
    positions, velocities, times = _line(surface, 3)
    positions[:] = surface.above_m
    if np.abs(_forces(_make_surface(surface), positions, velocities, times)).max() > 0.0:
        raise Finding(f"there is a force above the surface, at {surface.above_m}")


def test_it_never_pulls(surface: SurfaceCase) -> None:
    """The surface never pulls, whether the tool approaches, stays or leaves, slowly or fast. It pushes back while
    the tool presses.
    """
    positions, still, times = _line(surface, 400)
    outward = _outward(surface)
    for speed in (0.0, -0.1, 0.1, 1.0, 5.0):
        force = _forces(_make_surface(surface), positions, still + speed * outward, times) @ outward
        if force.min() < -1e-9:
            raise Finding(
                f"the surface pulls with {-force.min():.3g} N while the tool leaves it at {speed:g} m/s"
            )
    if force_at_end(surface) <= 0.0:
        raise Finding(
            f"there is no force inside the surface, at {surface.inside_m}; or the sign of the force is wrong"
        )


def force_at_end(case: SurfaceCase) -> float:
    """Return the outward force on a stationary tool at the inner position, N."""
    positions, velocities, times = _line(case, 400)
    return float((_forces(_make_surface(case), positions, velocities, times) @ _outward(case))[-1])


def test_deeper_is_never_softer(surface: SurfaceCase) -> None:
    positions, velocities, times = _line(surface, 800)
    force = _forces(_make_surface(surface), positions, velocities, times) @ _outward(surface)
    if np.diff(force).min() < -1e-6 * max(1.0, float(force.max())):
        raise Finding("the force decreases with depth")


def test_any_numbers_are_answered_with_numbers(surface: SurfaceCase) -> None:
    """Forces are finite at positions that are far away or very deep, and at high velocities."""
    made = _make_surface(surface)
    positions, velocities, times = _line(surface, 4)
    positions[0], positions[1], velocities[2] = (1e3, -1e3, 1e3), (0.0, 0.0, 0.0), (50.0, -50.0, -50.0)
    _forces(made, positions, velocities, times)


def test_pieces_of_a_path_are_answered_as_the_whole(surface: SurfaceCase) -> None:
    """The force depends on the path of the tool, not on the number of positions in one call."""
    positions, velocities, times = _line(surface, 300)
    forces = _forces(_make_surface(surface), positions, velocities, times)

    @settings(
        max_examples=20,
        deadline=None,
        derandomize=True,
        database=None,
        suppress_health_check=list(HealthCheck),
    )
    @given(st.lists(st.integers(1, 299), min_size=1, max_size=8, unique=True).map(sorted))
    def check(cuts: list[int]) -> None:
        made = _make_surface(surface)
        pieces = [
            _forces(made, positions[a:b], velocities[a:b], times[a:b])
            for a, b in zip([0, *cuts], [*cuts, 300], strict=True)
        ]
        if np.abs(np.vstack(pieces) - forces).max() > 1e-6 * max(1.0, np.abs(forces).max()):
            raise Finding(f"a path queried in pieces, cut at {cuts}, gives other forces than in one")

    check()


def test_questions_aside_change_nothing(surface: SurfaceCase) -> None:
    positions, velocities, times = _line(surface, 300)
    forces = _forces(_make_surface(surface), positions, velocities, times)
    made = _make_surface(surface)
    first = _forces(made, positions[:150], velocities[:150], times[:150])
    aside = made.aside()
    _forces(aside, positions[::-1].copy(), velocities + 0.5, times + 1.0)
    second = _forces(made, positions[150:], velocities[150:], times[150:])
    if np.abs(np.vstack((first, second)) - forces).max() > 1e-6 * max(1.0, np.abs(forces).max()):
        raise Finding("queries to a copy of the surface (`aside`) changed the surface itself")


def test_shown_again_it_answers_the_same(surface: SurfaceCase) -> None:
    """After `rewind`, the same samples give the same forces."""
    positions, velocities, times = _line(surface, 300)
    made = _make_surface(surface)
    for begin in range(0, 300, 50):
        part = slice(begin, begin + 50)
        first = _forces(made, positions[part], velocities[part], times[part])
        made.rewind(float(times[begin]))
        again = _forces(made, positions[part], velocities[part], times[part])
        if np.abs(first - again).max() > 1e-6 * max(1.0, np.abs(first).max()):
            raise Finding("after `rewind`, the same samples give other forces")


def test_friction_acts_against_the_sliding(surface: SurfaceCase) -> None:
    declared(surface.friction, "friction (SurfaceCase.friction)")
    made, outward = _make_surface(surface), _outward(surface)
    if isinstance(made, ShapedSurface):
        outward = np.asarray(made.normals(np.array([surface.inside_m]), np.array([_BEGIN_S])))[0]
    aside = np.cross(outward, (1.0, 0.0, 0.0) if abs(outward[0]) < 0.9 else (0.0, 1.0, 0.0))
    aside /= np.linalg.norm(aside)
    for sign in (1.0, -1.0):
        positions, still, times = _line(surface, 400)
        force = _forces(_make_surface(surface), positions, still + sign * 0.1 * aside, times)[-1]
        along, normal = float(force @ aside) * sign, float(force @ outward)
        if along > 1e-9:
            raise Finding("friction acts in the direction of sliding; its sign is wrong")
        if -along > 1.01 * surface.friction * normal + 1e-9:
            raise Finding(
                f"friction is {-along / normal:.3g} of the normal force; declared: at most {surface.friction:g}"
            )


def test_normals_are_those_of_the_force(surface: SurfaceCase) -> None:
    made = _make_surface(surface)
    declared(isinstance(made, ShapedSurface), "a surface with normals (ShapedSurface)")
    positions, velocities, times = _line(surface, 400)
    normals = np.asarray(made.normals(positions, times))
    known = ~np.isnan(normals).any(axis=1)
    if np.abs(np.linalg.norm(normals[known], axis=1) - 1.0).max(initial=0.0) > 1e-6:
        raise Finding("a normal is not a unit vector")
    force = _forces(made, positions, velocities, times)
    in_contact = known & (np.linalg.norm(force, axis=1) > 0.1)
    directions = force[in_contact] / np.linalg.norm(force[in_contact], axis=1)[:, np.newaxis]
    if in_contact.any() and float((directions * normals[in_contact]).sum(axis=1).min()) < 0.99:
        raise Finding("the force on a non-sliding tool is not along the outward normal")


def test_every_fault_of_the_surface_has_a_handler(surface: SurfaceCase) -> None:
    listed, handled = set(surface.kind.faults), set(_make_surface(surface).handlers)
    if listed != handled:
        raise Finding(f"faults listed but not handled, or handled but not listed: {sorted(listed ^ handled)}")
