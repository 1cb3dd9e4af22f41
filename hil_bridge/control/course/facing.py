"""Estimate of the surface's normal in both directions, with its uncertainty, from force, motion and moments.

Directions in the task frame: a into the surface, t along x, b along y. The surface falls away by `fall` = (p, q):
its inward unit normal is along a − p·t − q·b. A tool that presses with the force N and slides along the heading h
is subject to friction against h.

So the force gives the normal across h directly, and the normal along h together with the friction angle φ. If the
tool presses with N and the surface falls away by θ along h, the force gives

    ψ = atan2(f_h, f_a) = φ − θ.

φ is learnt from the last millimetres of the path, which give θ without friction, but with a delay. With a flat
tool, the moments at its face give the normal in both directions: a disc of radius r on a surface of stiffness K
responds to a skew angle e with the moment K·r²/4·e while all of it touches. Derived: the mean of x² over a disc is
r²/4.

Each source is weighted by its variance. The noise of the force is estimated from the scatter of new readings.

With `directions` = 1, the estimate equals the one in the paper's experiments on a contour: it covers only the
direction along the path, from reported depths, for a tool that does not turn.
"""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from hil_bridge.control.checks import FORBID_EXTRA, require_above_zero, require_shares_and_slope
from hil_bridge.control.geometry.ways import Place
from hil_bridge.control.limiting import within
from protocol.geometry import Vector
from protocol.marks import SettingError

PACE_S = 0.09
"""Time between two readings of the estimate, s. Chosen: half a sample period of the paper's setup, so that every
one of its samples is a reading. In the 4 ms cycle of a streaming robot, the tool moves by less than the noise of
its direction.
"""
_UNKNOWN = math.radians(5.0) ** 2
"""Variance of a direction before the first reading, rad². Chosen."""
_REMEMBERED = 0.8
"""Share of the variance that remains after each reading. Chosen."""
_SAME_HEADING = math.cos(math.radians(20.0))
"""Cosine of the largest rotation of the heading within one stretch of the path. Chosen."""
_BLIND_S = 0.25
"""Time after a corner during which the force is ignored, s. Chosen: friction turns when the robot turns, later than
the order.
"""
_MOST_SKEW = math.radians(10.0)
"""Largest skew that a moment may indicate. Chosen."""
_TRUSTED_STIFFNESS = 0.3
"""Relative error of a skew angle from the moments, because the stiffness is only estimated. Chosen. From reported
depths it is that of surface and arm in series, so a skew is overestimated by the surface's stiffness over the arm's.
"""


_NO_SUMS = (0.0, 0.0, 0.0, 0.0, 0.0)


class FacingState(Struct, frozen=True):
    """State of the estimate between samples."""

    fall: Place = (0.0, 0.0)
    """Slopes p and q by which the surface falls away along t and b."""
    friction_angle: float | None = None
    """Friction angle φ, rad; None until a path has been recorded to learn it from."""
    friction_variance: float = _UNKNOWN
    """Variance of `friction_angle`, rad²."""
    points: tuple[tuple[float, float, float], ...] = ()
    """Newest readings on this heading, oldest first: path length in m, depth in m and direction of the force in rad."""
    heading: Place = (1.0, 0.0)
    variances: Place = (_UNKNOWN, _UNKNOWN)
    """Scatter of the readings along and across the heading, rad²."""
    sigma: float = math.inf
    """Standard deviation of the estimate in its worse direction, rad."""
    blind: float = 0.0
    """Remaining time during which the force is ignored, s."""
    waited: float = 0.0
    """Accumulated time of the samples since the last reading, s."""
    count: int = 0
    sums: tuple[float, ...] = _NO_SUMS
    """Sums over the samples since the last reading: force along a, t, b, N, and skew angles from the moments along
    t and b, rad.
    """


class FacingSample(Struct, frozen=True):
    """Input of the estimate from one sample."""

    dt: float
    """Time since the previous sample, s."""
    travel: float
    """Reported path length, m."""
    depth: float
    """Reported depth, m."""
    force: Vector
    """Reaction force along a, t, b, N. A component is positive if the tool presses in its direction."""
    heading: Place
    """Unit vector of the motion along t and b; both components are 0 while the tool is stationary."""
    axis: Vector = (1.0, 0.0, 0.0)
    """Unit vector of the tool axis along a, t, b."""
    skew: Place | None = None
    """Tilt that corrects the skew measured by the moments at the face, along t and b, rad; None for a tool without
    a face.
    """


@dataclass(frozen=True, slots=True)
class Facing:
    """Parameters of the estimate. All are chosen."""

    __pydantic_config__: ClassVar = FORBID_EXTRA

    window_mm: float = 6.0
    """Length over which the path counts as straight."""
    learning_share: float = 0.15
    """Weight of a new friction angle in each reading."""
    smoothing_share: float = 0.3
    """Weight of a new normal in each reading; there are eleven readings per second."""
    steepest_deg: float = 60.0
    """Largest plausible angle of the normal."""
    uncertain_deg: float = 2.0
    """Standard deviation above which the tool does not follow the estimate."""
    moment_noise_nm: float = 0.01
    """Noise of a moment at the face, averaged over one reading."""
    directions: int = 2
    """1: only along the path; the controller receives reported depths. 2: also across it; the controller receives
    depths from the plane that the normal predicts.
    """

    def __post_init__(self) -> None:
        require_above_zero(
            self,
            "window_mm",
            "learning_share",
            "smoothing_share",
            "steepest_deg",
            "uncertain_deg",
            "moment_noise_nm",
        )
        require_shares_and_slope(self)
        if self.directions not in (1, 2):
            raise SettingError("directions", f"must be 1 or 2, got {self.directions}")

    @property
    def shows_ground(self) -> bool:
        """Whether the controller receives depths from the plane that the normal predicts."""
        return self.directions == 2

    def after(self, state: FacingState, sample: FacingSample, stiffness_nm_rad: float) -> FacingState:
        """Return the state after one sample in contact. Samples are averaged to one reading per `PACE_S`.
        `stiffness_nm_rad` is the moment per skew angle of the tool's face.
        """
        state = _turn_corner(state, sample)
        if state.blind > 0.0:
            return replace(state, blind=state.blind - sample.dt, waited=0.0, count=0, sums=_NO_SUMS)
        values = (*sample.force, *(sample.skew or (0.0, 0.0)))
        if not all(map(math.isfinite, (*values, sample.travel, sample.depth))) or not sample.force[0] > 0.0:
            return state
        sums = tuple(a + b for a, b in zip(state.sums, values, strict=True))
        count, waited = state.count + 1, state.waited + sample.dt
        if waited < PACE_S:
            return replace(state, waited=waited, count=count, sums=sums)
        mean = [value / count for value in sums]
        state = replace(state, waited=0.0, count=0, sums=_NO_SUMS)
        return self._read(state, sample, mean, stiffness_nm_rad)

    def _read(
        self, state: FacingState, sample: FacingSample, mean: list[float], stiffness: float
    ) -> FacingState:
        """Return the state after one step of the estimate, with a new reading."""
        hx, hy = sample.heading
        slides = bool(hx or hy)
        if not slides:
            hx, hy = state.heading
        force, force_t, force_b = mean[:3]
        psi = math.atan2(force_t * hx + force_b * hy, force)
        if slides:
            state = self._with_point(state, (sample.travel, sample.depth, psi))
        p, q = state.fall
        along, across = math.atan(p * hx + q * hy), math.atan(q * hx - p * hy)
        estimates: list[list[tuple[float, float]]] = [
            [],
            [],
        ]  # for each axis: angle of the normal and its variance
        scatter = list(state.variances)
        both = self.directions == 2
        if slides and both:  # otherwise the direction of friction is unknown
            read_across = -math.atan2(force_b * hx - force_t * hy, force)
            scatter[1] = _spread(scatter[1], read_across - across)
            estimates[1].append((read_across, scatter[1]))
        if slides and state.friction_angle is not None:
            read_along = state.friction_angle - psi
            scatter[0] = _spread(scatter[0], read_along - along)
            estimates[0].append((read_along, scatter[0] + state.friction_variance))
        if sample.skew is not None and both:
            for axis, estimate in enumerate(self._from_moments(sample, mean, (hx, hy), stiffness)):
                estimates[axis].append(estimate)
        share, steepest = self.smoothing_share, math.radians(self.steepest_deg)
        angles, variances = [along, across], [_UNKNOWN, _UNKNOWN]
        for axis, sources in enumerate(estimates):
            if not sources:
                continue
            weight = sum(1.0 / variance for _, variance in sources)
            target = sum(angle / variance for angle, variance in sources) / weight
            target = within(target, -steepest, steepest)
            angles[axis] += share * (target - angles[axis])
            variances[axis] = share / (2.0 - share) / weight
        u, v = math.tan(angles[0]), math.tan(angles[1])
        return replace(
            state,
            fall=(u * hx - v * hy, u * hy + v * hx),
            variances=(scatter[0], scatter[1]),
            sigma=math.sqrt(max(variances)),
        )

    def _with_point(self, state: FacingState, point: tuple[float, float, float]) -> FacingState:
        """Return the state with one more point of the path, and the friction angle derived from the points in the
        window.
        """
        travel = point[0]
        oldest = travel - self.window_mm * 1e-3
        points = (*(one for one in state.points if oldest <= one[0] < travel), point)
        if len(points) < 4 or points[-1][0] - points[0][0] < self.window_mm * 0.5e-3:
            return replace(state, points=points)
        along, deep, directions = np.array(points).T
        along = along - along.mean()
        slope = float(along @ deep) / float(along @ along)
        rest = deep - deep.mean() - slope * along
        noise = float(rest @ rest) / (len(points) - 2) / float(along @ along)
        friction_angle, known, share = (
            math.atan(slope) + float(directions.mean()),
            state.friction_angle,
            self.learning_share,
        )
        if known is None:
            return replace(state, points=points, friction_angle=friction_angle, friction_variance=noise)
        return replace(
            state,
            points=points,
            friction_angle=known + share * (friction_angle - known),
            friction_variance=(1.0 - share) ** 2 * state.friction_variance + share**2 * noise,
        )

    def _from_moments(
        self, sample: FacingSample, mean: list[float], heading: Place, stiffness: float
    ) -> list[tuple[float, float]]:
        """Return the normal derived from the moments at the face: angle and variance, along and across the heading."""
        (a, t, b), (hx, hy), noise = sample.axis, heading, self.moment_noise_nm / stiffness
        estimates = []
        for own, skew in (
            (t * hx + b * hy, mean[3] * hx + mean[4] * hy),
            (b * hx - t * hy, mean[4] * hx - mean[3] * hy),
        ):
            skew = within(skew, -_MOST_SKEW, _MOST_SKEW)
            estimates.append((-math.atan2(own, a) - skew, noise**2 + (_TRUSTED_STIFFNESS * skew) ** 2))
        return estimates


@dataclass(frozen=True, slots=True)
class Contour(Facing):
    """Parameters of the estimate in a run without steps, as in the paper's experiments. All are chosen."""

    __pydantic_config__: ClassVar = FORBID_EXTRA

    learning_share: float = 0.1
    """Weight of a new friction angle in each reading."""
    smoothing_share: float = 0.5
    """Weight of a new normal in each reading."""
    directions: int = 1
    """1: only along the path; the controller receives reported depths. 2: also across it; the controller receives
    depths from the plane that the normal predicts.
    """


def _turn_corner(state: FacingState, sample: FacingSample) -> FacingState:
    """Return the state for the heading of this sample. After a corner, the list of path points starts again."""
    if sample.heading == state.heading or sample.heading == (0.0, 0.0):
        return state
    (x, y), (u, v) = sample.heading, state.heading
    if x * u + y * v >= _SAME_HEADING:
        return replace(state, heading=sample.heading)
    return replace(state, heading=sample.heading, points=(), blind=_BLIND_S)


def elsewhere(state: FacingState) -> FacingState:
    """Return the state for a stroke at another position, where the friction is known and the surface is not."""
    return FacingState(friction_angle=state.friction_angle, friction_variance=state.friction_variance)


def inward(fall: Place) -> Vector:
    """Return the inward unit normal of a surface with the given slopes, along a, t, b."""
    p, q = fall
    length = math.sqrt(1.0 + p * p + q * q)
    return 1.0 / length, -p / length, -q / length


def _spread(variance: float, error: float) -> float:
    return _REMEMBERED * variance + (1.0 - _REMEMBERED) * error * error


def lateral_of(force: Vector, fall: Place) -> float:
    """Return the magnitude of the force along the surface, N."""
    a, t, b = inward(fall)
    pressed = force[0] * a + force[1] * t + force[2] * b
    return math.hypot(force[0] - pressed * a, force[1] - pressed * t, force[2] - pressed * b)
