"""Where the surface's normal lies, in both directions, from force, motion and moments, with the uncertainty of it.

Work in the task frame: a into the surface, t along x, b along y. The surface falls away by `fall` = (p, q): its inward
unit normal is along a − p·t − q·b. A tool that presses with N and slides along the heading h meets friction against h.
So the force tells the normal across h at once, and along h together with the friction angle φ. With N pressing and the
surface falling away by θ along h it tells

    ψ = atan2(f_h, f_a) = φ − θ.

φ is learnt from the path of the last millimetres, which tells θ without friction but late. A flat tool tells both
directions by the moments at its face: a disc of radius r on a surface of stiffness K answers a skew angle e by K·r²/4·e
while all of it touches. Derived: the mean of x² over a disc is r²/4.

Each source is weighed by its variance. Noise of the force is taken from how far new readings lie from the estimate.

With `directions` = 1 the estimate is that of the paper's experiments on a contour: of the direction along the path
alone, from reported depths, for a tool that does not turn.
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
"""Time between two readings of the estimate, s. Chosen: half a sample of the paper's chain, all of whose samples count.
In the 4 ms of a robot that streams the tool moves by less than the noise of its direction.
"""
_UNKNOWN = math.radians(5.0) ** 2
"""Chosen: variance of a direction before anything was read, rad²."""
_REMEMBERED = 0.8
"""Chosen: share of the variance that each reading keeps."""
_SAME_HEADING = math.cos(math.radians(20.0))
"""Chosen: a heading that turned by less is the same stretch of the path."""
_BLIND_S = 0.25
"""Chosen: time after a corner for which the force is not read: friction turns with the robot, not with the order."""
_MOST_SKEW = math.radians(10.0)
"""Chosen: no moment is taken for more than this."""
_TRUSTED_STIFFNESS = 0.3
"""Chosen: share of its skew angle by which the moments may be wrong, for the stiffness is an estimate."""


_NO_SUMS = (0.0, 0.0, 0.0, 0.0, 0.0)


class FacingState(Struct, frozen=True):
    """State of the estimate between samples."""

    fall: Place = (0.0, 0.0)
    """Slopes p and q by which the surface falls away along t and b."""
    friction_angle: float | None = None
    """φ, rad; None before there was a path to learn it from."""
    friction_variance: float = _UNKNOWN
    """rad²"""
    points: tuple[tuple[float, float, float], ...] = ()
    """Way in m, depth in m and direction of the force in rad, of the newest readings on this heading, oldest first."""
    heading: Place = (1.0, 0.0)
    variances: Place = (_UNKNOWN, _UNKNOWN)
    """Scatter of the readings along and across the heading, rad²."""
    sigma: float = math.inf
    """Standard deviation of the estimate in its worse direction, rad."""
    blind: float = 0.0
    """Time for which the force is not read yet, s."""
    waited: float = 0.0
    """Time of the samples that were added up since the last reading, s."""
    count: int = 0
    sums: tuple[float, ...] = _NO_SUMS
    """Sums of force along a, t, b, N, and of the skew angles by the moments along t and b, rad."""


class Look(Struct, frozen=True):
    """One sample as the estimate needs it."""

    dt: float
    """s"""
    travel: float
    """Reported length of the way, m."""
    depth: float
    """Reported depth, m."""
    force: Vector
    """Reaction along a, t, b, N, positive where the tool presses that way."""
    heading: Place
    """Unit vector of the motion in t and b; both 0 while the tool stands."""
    axis: Vector = (1.0, 0.0, 0.0)
    """The tool's own axis along a, t, b: unit vector."""
    skew: Place | None = None
    """How the moments at the face say that this axis must tip, along t and b, rad; None for a tool without a face."""


@dataclass(frozen=True, slots=True)
class Facing:
    """Parameters of the estimate. All are chosen."""

    __pydantic_config__: ClassVar = FORBID_EXTRA

    window_mm: float = 6.0
    """Way over which the path is taken for straight."""
    learning_share: float = 0.15
    """Share of a new friction angle that is taken over each reading."""
    smoothing_share: float = 0.3
    """Share of a new normal that is taken over each reading; there are eleven a second."""
    steepest_deg: float = 60.0
    """Angle beyond which no normal is believed."""
    uncertain_deg: float = 2.0
    """Standard deviation above which the tool is not turned after the estimate."""
    moment_noise_nm: float = 0.01
    """Noise of a moment at the face, averaged over one reading."""
    directions: int = 2
    """1: along the path alone, and the controller is shown reported depths. 2: across it too, and the controller is
    shown depths from the plane that the normal predicts.
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
        """Whether the controller is shown depths from the plane that the normal predicts."""
        return self.directions == 2

    def after(self, state: FacingState, look: Look, stiffness_nm_rad: float) -> FacingState:
        """State after one sample in contact. Samples are averaged to a reading each `PACE_S`. `stiffness_nm_rad` is
        the moment per skew angle of the tool's face.
        """
        state = _turn_corner(state, look)
        if state.blind > 0.0:
            return replace(state, blind=state.blind - look.dt, waited=0.0, count=0, sums=_NO_SUMS)
        values = (*look.force, *(look.skew or (0.0, 0.0)))
        if not all(map(math.isfinite, (*values, look.travel, look.depth))) or not look.force[0] > 0.0:
            return state
        sums = tuple(a + b for a, b in zip(state.sums, values, strict=True))
        count, waited = state.count + 1, state.waited + look.dt
        if waited < PACE_S:
            return replace(state, waited=waited, count=count, sums=sums)
        mean = [value / count for value in sums]
        state = replace(state, waited=0.0, count=0, sums=_NO_SUMS)
        return self._read(state, look, mean, stiffness_nm_rad)

    def _read(self, state: FacingState, look: Look, mean: list[float], stiffness: float) -> FacingState:
        """State after a reading: one step of the estimate."""
        hx, hy = look.heading
        slides = bool(hx or hy)
        if not slides:
            hx, hy = state.heading
        force, force_t, force_b = mean[:3]
        psi = math.atan2(force_t * hx + force_b * hy, force)
        if slides:
            state = self._learnt(state, (look.travel, look.depth, psi))
        p, q = state.fall
        along, across = math.atan(p * hx + q * hy), math.atan(q * hx - p * hy)
        seen: list[list[tuple[float, float]]] = [
            [],
            [],
        ]  # by axis: where the normal is seen, and the variance
        scatter = list(state.variances)
        both = self.directions == 2
        if slides and both:  # else friction may point anywhere
            read_across = -math.atan2(force_b * hx - force_t * hy, force)
            scatter[1] = _spread(scatter[1], read_across - across)
            seen[1].append((read_across, scatter[1]))
        if slides and state.friction_angle is not None:
            read_along = state.friction_angle - psi
            scatter[0] = _spread(scatter[0], read_along - along)
            seen[0].append((read_along, scatter[0] + state.friction_variance))
        if look.skew is not None and both:
            for axis, told in enumerate(self._by_moments(look, mean, (hx, hy), stiffness)):
                seen[axis].append(told)
        share, steepest = self.smoothing_share, math.radians(self.steepest_deg)
        angles, variances = [along, across], [_UNKNOWN, _UNKNOWN]
        for axis, told_by in enumerate(seen):
            if not told_by:
                continue
            weight = sum(1.0 / variance for _, variance in told_by)
            wanted = sum(angle / variance for angle, variance in told_by) / weight
            wanted = within(wanted, -steepest, steepest)
            angles[axis] += share * (wanted - angles[axis])
            variances[axis] = share / (2.0 - share) / weight
        u, v = math.tan(angles[0]), math.tan(angles[1])
        return replace(
            state,
            fall=(u * hx - v * hy, u * hy + v * hx),
            variances=(scatter[0], scatter[1]),
            sigma=math.sqrt(max(variances)),
        )

    def _learnt(self, state: FacingState, point: tuple[float, float, float]) -> FacingState:
        """State with one more point of the path, and the friction angle that the window tells."""
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
        seen, known, share = (
            math.atan(slope) + float(directions.mean()),
            state.friction_angle,
            self.learning_share,
        )
        if known is None:
            return replace(state, points=points, friction_angle=seen, friction_variance=noise)
        return replace(
            state,
            points=points,
            friction_angle=known + share * (seen - known),
            friction_variance=(1.0 - share) ** 2 * state.friction_variance + share**2 * noise,
        )

    def _by_moments(
        self, look: Look, mean: list[float], heading: Place, stiffness: float
    ) -> list[tuple[float, float]]:
        """Estimate the normal from the moments at the face: angle and variance along and across the heading."""
        (a, t, b), (hx, hy), noise = look.axis, heading, self.moment_noise_nm / stiffness
        told = []
        for own, skew in (
            (t * hx + b * hy, mean[3] * hx + mean[4] * hy),
            (b * hx - t * hy, mean[4] * hx - mean[3] * hy),
        ):
            skew = within(skew, -_MOST_SKEW, _MOST_SKEW)
            told.append((-math.atan2(own, a) - skew, noise**2 + (_TRUSTED_STIFFNESS * skew) ** 2))
        return told


@dataclass(frozen=True, slots=True)
class Contour(Facing):
    """Parameters of the estimate in a run without steps, as in the paper's experiments. All are chosen."""

    __pydantic_config__: ClassVar = FORBID_EXTRA

    learning_share: float = 0.1
    """Share of a new friction angle that is taken over each reading."""
    smoothing_share: float = 0.5
    """Share of a new normal that is taken over each reading."""
    directions: int = 1
    """1: along the path alone, and the controller is shown reported depths. 2: across it too, and the controller is
    shown depths from the plane that the normal predicts.
    """


def _turn_corner(state: FacingState, look: Look) -> FacingState:
    """State on the heading of this sample: behind a corner the points of the path restart."""
    if look.heading == state.heading or look.heading == (0.0, 0.0):
        return state
    (x, y), (u, v) = look.heading, state.heading
    if x * u + y * v >= _SAME_HEADING:
        return replace(state, heading=look.heading)
    return replace(state, heading=look.heading, points=(), blind=_BLIND_S)


def elsewhere(state: FacingState) -> FacingState:
    """State for a stroke at another place: the friction is known, the surface is not."""
    return FacingState(friction_angle=state.friction_angle, friction_variance=state.friction_variance)


def inward(fall: Place) -> Vector:
    """Inward unit normal of a surface that falls away by these slopes, along a, t, b."""
    p, q = fall
    length = math.sqrt(1.0 + p * p + q * q)
    return 1.0 / length, -p / length, -q / length


def _spread(variance: float, error: float) -> float:
    return _REMEMBERED * variance + (1.0 - _REMEMBERED) * error * error


def lateral_of(force: Vector, fall: Place) -> float:
    """Length of the force along the surface, N."""
    a, t, b = inward(fall)
    pressed = force[0] * a + force[1] * t + force[2] * b
    return math.hypot(force[0] - pressed * a, force[1] - pressed * t, force[2] - pressed * b)
