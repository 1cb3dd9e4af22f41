"""The task frame on a curved contour: where the surface's normal lies, from motion and force together.

Angles are about the axis across approach and travel, rad: θ > 0 where the surface falls away along the travel. Take the
tangent τ = t·cos θ + a·sin θ and the inward normal n = a·cos θ − t·sin θ, with a the approach and t the travel. A
surface that is pressed with N and rubbed with the friction angle φ pushes back by f_a = N·cos θ + N·tan φ·sin θ along a
and f_t = −N·sin θ + N·tan φ·cos θ along t, so that

    ψ = atan2(f_t, f_a) = φ − θ,    N = f_a·cos θ − f_t·sin θ.

The force tells the normal at once but for the friction; the path of the last millimetres tells it without friction
but late. Hence φ is learnt slowly from both, over the same window, and taken off what the force says now.
"""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from hil_bridge.control.checks import require_above_zero, require_shares_and_slope


class ContourState(Struct, frozen=True):
    """State of the estimate between samples."""

    points: tuple[tuple[float, float, float], ...] = ()
    """Travel in m, depth in m and ψ in rad of the newest samples in contact, oldest first."""
    friction_angle: float | None = None
    """φ, rad; None before there is a path to learn it from."""
    angle: float = 0.0
    """θ, rad."""
    waited: float = math.inf
    """Time since the newest of these samples, s."""


PACE_S = 0.09
"""Time between two samples of the estimate, s. Chosen: half a sample of the paper's chain, all of whose samples count.
In the 4 ms of a robot that streams the tool moves by less than the noise of its direction.
"""


@dataclass(frozen=True, slots=True)
class Contour:
    """Parameters of the estimate. All are chosen."""

    __pydantic_config__: ClassVar = {"extra": "forbid"}

    window_mm: float = 6.0
    """Travel over which the path is taken for straight."""
    learning_share: float = 0.1
    """Share of a new friction angle that is taken over each sample."""
    smoothing_share: float = 0.5
    """Share of a new normal that is taken over each sample."""
    steepest_deg: float = 60.0
    """Angle beyond which no normal is believed."""

    def __post_init__(self) -> None:
        require_above_zero(self, "window_mm", "learning_share", "smoothing_share", "steepest_deg")
        require_shares_and_slope(self)

    def after(
        self, state: ContourState, dt: float, place: tuple[float, float], force: tuple[float, float]
    ) -> ContourState:
        """State after `dt`, s, more. As `step`, which takes a sample each `PACE_S` alone. `place` is reported travel
        and depth, m, `force` the reaction along approach and travel, N.
        """
        waited = state.waited + dt
        if waited < PACE_S:
            return replace(state, waited=waited)
        return replace(self.step(state, *place, *force), waited=0.0)

    def step(
        self, state: ContourState, travel: float, depth: float, force: float, force_travel: float
    ) -> ContourState:
        """State after one sample in contact: reported travel and depth in m, reaction along approach and travel in N.

        A sample that is not finite, or does not press, is left out.
        """
        if not (all(map(math.isfinite, (travel, depth, force, force_travel))) and force > 0.0):
            return state
        psi = math.atan2(force_travel, force)
        oldest = travel - self.window_mm * 1e-3
        points = (*(point for point in state.points if oldest <= point[0] < travel), (travel, depth, psi))
        span = points[-1][0] - points[0][0]
        if len(points) < 3 or span < self.window_mm * 0.5e-3:
            return ContourState(points, state.friction_angle, state.angle)
        along, deep, directions = np.array(points).T
        slope = math.atan(float(np.polyfit(along - along[0], deep, 1)[0]))
        seen = slope + float(np.mean(directions))
        known = state.friction_angle
        friction = seen if known is None else known + self.learning_share * (seen - known)
        steepest = math.radians(self.steepest_deg)
        wanted = min(max(friction - psi, -steepest), steepest)
        return ContourState(points, friction, state.angle + self.smoothing_share * (wanted - state.angle))


def normal_force(angle: float, force: float, force_travel: float) -> float:
    """N, the part of the reaction along the normal, N; friction has none."""
    return force * math.cos(angle) - force_travel * math.sin(angle)
