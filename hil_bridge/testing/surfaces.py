"""Tests that every surface has to pass, for the test module of its author.

    import pytest
    from hil_bridge.testing import SurfaceCase
    from hil_bridge.testing.surfaces import *
    from my_package.room import SURFACE

    @pytest.fixture
    def surface():
        return SurfaceCase(SURFACE, above_m=(0.9, -0.1, 0.7), inside_m=(0.9, -0.1, 0.588))

They know it by `emulators.seams.Surface`, and touch it along the line from one place to the other.
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
"""A surface with memory is shown at least so many samples a second."""
_BEGIN_S = 100.0


def _made(case: SurfaceCase) -> Any:
    given = case.kind.settings() if case.settings is None else case.settings
    return case.kind.make(given)(lambda since: None)


def _line(case: SurfaceCase, samples: int) -> tuple[Floats, Floats, Floats]:
    """Positions, velocities and times of a slow way from above to inside."""
    share = np.linspace(0.0, 1.0, samples)[:, np.newaxis]
    above, inside = np.array(case.above_m), np.array(case.inside_m)
    positions = above + share * (inside - above)
    times = _BEGIN_S + np.arange(samples) / _RATE_HZ
    return positions, np.zeros_like(positions), times


def _outward(case: SurfaceCase) -> Floats:
    way: Floats = np.array(case.above_m) - np.array(case.inside_m)
    return way / np.linalg.norm(way)


def _answered(surface: Any, positions: Floats, velocities: Floats, times: Floats) -> Floats:
    force = np.asarray(surface.force(positions, velocities, times))
    if force.shape != positions.shape:
        raise Finding(
            f"{len(times)} places are answered with forces of shape {force.shape}, not {positions.shape}"
        )
    if not np.isfinite(force).all():
        raise Finding("a force is not a number")
    return force


def test_above_it_nothing_is_felt(surface: SurfaceCase) -> None:
    positions, velocities, times = _line(surface, 3)
    positions[:] = surface.above_m
    if np.abs(_answered(_made(surface), positions, velocities, times)).max() > 0.0:
        raise Finding(f"a force is felt above the surface, at {surface.above_m}")


def test_it_never_pulls(surface: SurfaceCase) -> None:
    """Whether the tool comes, stands or leaves, slow or fast; and pressed on it, it pushes back."""
    positions, still, times = _line(surface, 400)
    outward = _outward(surface)
    for speed in (0.0, -0.1, 0.1, 1.0, 5.0):
        force = _answered(_made(surface), positions, still + speed * outward, times) @ outward
        if force.min() < -1e-9:
            raise Finding(
                f"the surface pulls with {-force.min():.3g} N while the tool leaves it at {speed:g} m/s"
            )
    if force_at_end(surface) <= 0.0:
        raise Finding(
            f"nothing is felt inside the surface, at {surface.inside_m}; or the sign of the force is wrong"
        )


def force_at_end(case: SurfaceCase) -> float:
    """Outward force at the inner place once the tool stands there, N."""
    positions, velocities, times = _line(case, 400)
    return float((_answered(_made(case), positions, velocities, times) @ _outward(case))[-1])


def test_deeper_is_never_softer(surface: SurfaceCase) -> None:
    positions, velocities, times = _line(surface, 800)
    force = _answered(_made(surface), positions, velocities, times) @ _outward(surface)
    if np.diff(force).min() < -1e-6 * max(1.0, float(force.max())):
        raise Finding("pressed deeper, the surface pushes back less")


def test_any_numbers_are_answered_with_numbers(surface: SurfaceCase) -> None:
    """Far away, very deep, very fast."""
    made = _made(surface)
    positions, velocities, times = _line(surface, 4)
    positions[0], positions[1], velocities[2] = (1e3, -1e3, 1e3), (0.0, 0.0, 0.0), (50.0, -50.0, -50.0)
    _answered(made, positions, velocities, times)


def test_pieces_of_a_path_are_answered_as_the_whole(surface: SurfaceCase) -> None:
    """The answer depends on the way of the tool, not on how many places are asked for at once."""
    positions, velocities, times = _line(surface, 300)
    whole = _answered(_made(surface), positions, velocities, times)

    @settings(
        max_examples=20,
        deadline=None,
        derandomize=True,
        database=None,
        suppress_health_check=list(HealthCheck),
    )
    @given(st.lists(st.integers(1, 299), min_size=1, max_size=8, unique=True).map(sorted))
    def check(cuts: list[int]) -> None:
        made = _made(surface)
        pieces = [
            _answered(made, positions[a:b], velocities[a:b], times[a:b])
            for a, b in zip([0, *cuts], [*cuts, 300], strict=True)
        ]
        if np.abs(np.vstack(pieces) - whole).max() > 1e-6 * max(1.0, np.abs(whole).max()):
            raise Finding(
                f"a path that is asked for in pieces, cut at {cuts}, is answered otherwise than in one"
            )

    check()


def test_questions_aside_change_nothing(surface: SurfaceCase) -> None:
    positions, velocities, times = _line(surface, 300)
    whole = _answered(_made(surface), positions, velocities, times)
    made = _made(surface)
    first = _answered(made, positions[:150], velocities[:150], times[:150])
    aside = made.aside()
    _answered(aside, positions[::-1].copy(), velocities + 0.5, times + 1.0)
    second = _answered(made, positions[150:], velocities[150:], times[150:])
    if np.abs(np.vstack((first, second)) - whole).max() > 1e-6 * max(1.0, np.abs(whole).max()):
        raise Finding("questions to a copy of the surface (`aside`) have changed the surface itself")


def test_shown_again_it_answers_the_same(surface: SurfaceCase) -> None:
    """It goes back (`rewind`), and is shown the same samples again."""
    positions, velocities, times = _line(surface, 300)
    made = _made(surface)
    for begin in range(0, 300, 50):
        part = slice(begin, begin + 50)
        first = _answered(made, positions[part], velocities[part], times[part])
        made.rewind(float(times[begin]))
        again = _answered(made, positions[part], velocities[part], times[part])
        if np.abs(first - again).max() > 1e-6 * max(1.0, np.abs(first).max()):
            raise Finding("samples that are shown again after `rewind` are answered otherwise")


def test_friction_acts_against_the_sliding(surface: SurfaceCase) -> None:
    declared(surface.friction, "friction (SurfaceCase.friction)")
    made, outward = _made(surface), _outward(surface)
    if isinstance(made, ShapedSurface):
        outward = np.asarray(made.normals(np.array([surface.inside_m]), np.array([_BEGIN_S])))[0]
    aside = np.cross(outward, (1.0, 0.0, 0.0) if abs(outward[0]) < 0.9 else (0.0, 1.0, 0.0))
    aside /= np.linalg.norm(aside)
    for sign in (1.0, -1.0):
        positions, still, times = _line(surface, 400)
        force = _answered(_made(surface), positions, still + sign * 0.1 * aside, times)[-1]
        along, normal = float(force @ aside) * sign, float(force @ outward)
        if along > 1e-9:
            raise Finding(
                "friction pushes the tool on in the direction in which it slides; its sign is wrong"
            )
        if -along > 1.01 * surface.friction * normal + 1e-9:
            raise Finding(
                f"friction is {-along / normal:.3g} of the normal force, declared are {surface.friction:g}"
            )


def test_normals_are_those_of_the_force(surface: SurfaceCase) -> None:
    made = _made(surface)
    declared(isinstance(made, ShapedSurface), "a surface with normals (ShapedSurface)")
    positions, velocities, times = _line(surface, 400)
    normals = np.asarray(made.normals(positions, times))
    known = ~np.isnan(normals).any(axis=1)
    if np.abs(np.linalg.norm(normals[known], axis=1) - 1.0).max(initial=0.0) > 1e-6:
        raise Finding("a normal is not of length 1")
    force = _answered(made, positions, velocities, times)
    felt = known & (np.linalg.norm(force, axis=1) > 0.1)
    directions = force[felt] / np.linalg.norm(force[felt], axis=1)[:, np.newaxis]
    if felt.any() and float((directions * normals[felt]).sum(axis=1).min()) < 0.99:
        raise Finding("the force on a tool that does not slide is not along the outward normal")


def test_every_fault_of_the_surface_has_a_handler(surface: SurfaceCase) -> None:
    told, handled = set(surface.kind.faults), set(_made(surface).handlers)
    if told != handled:
        raise Finding(
            f"faults that are told and not handled, or handled and not told: {sorted(told ^ handled)}"
        )
