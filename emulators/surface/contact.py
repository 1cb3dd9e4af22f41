"""Contact of the tool tip with a surface: shape, material and friction at a point.

A surface is a profile in the plane of path and height, the same everywhere across the path, in the base
frame (z up). The material acts along the outward normal and never pulls; its stiffness may change along the
path, and the surface may end. Friction is Coulomb's, smoothed near zero velocity.
Source of the default stiffness: project specification of the force control, section 5.
"""

import copy
import math
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from itertools import pairwise
from typing import Any, ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from emulators.faults.ledger import Handler
from emulators.surface.faults import SurfaceFaults
from emulators.surface.materials import MaterialProfile, Memory
from protocol.marks import Mark, check_settings, setting

Floats = NDArray[np.float64]

_REMEMBERED = 64
"""Chosen: more blocks of samples than lie between the end of the committed path and the present."""
_UP = np.array([0.0, 0.0, 1.0])
"""Base z."""


def _unread(time: float) -> None:
    """Nothing was computed ahead."""


class SurfaceKind(StrEnum):
    """Shape of the surface along the path."""

    FLAT = "flat"
    SLOPED = "sloped"
    SINUSOIDAL = "sinusoidal"
    CIRCULAR_ARC = "circular_arc"


class Shape(Protocol):
    """A solid below a line in the plane of path coordinate and height."""

    def depth_and_normal(self, along: Floats, height: Floats) -> tuple[Floats, Floats, Floats]:
        """Depth below the surface along its normal, m, negative outside; outward unit normal along and up.

        `along` and `height` (n,) are path coordinate and height of the tip, m.
        """


@dataclass(frozen=True, slots=True)
class Plane:
    """A plane that rises along the path."""

    height: float
    """Height at path coordinate 0, m."""
    slope: float = 0.0
    """rad, positive where the surface rises along the path."""

    def depth_and_normal(self, along: Floats, height: Floats) -> tuple[Floats, Floats, Floats]:
        sine, cosine = math.sin(self.slope), math.cos(self.slope)
        depth = (self.height - height) * cosine + along * sine
        return depth, np.full_like(along, -sine), np.full_like(along, cosine)


@dataclass(frozen=True, slots=True)
class Sinusoidal:
    """Waves about a height, rising through it at path coordinate 0.

    The depth is that below the tangent under the tip: exact to first order in depth times curvature.
    """

    height: float
    """m"""
    amplitude: float
    """m"""
    period: float
    """Length of a wave along the path, m."""

    def depth_and_normal(self, along: Floats, height: Floats) -> tuple[Floats, Floats, Floats]:
        wave_number = 2.0 * math.pi / self.period
        phase = wave_number * along
        rise = self.amplitude * wave_number * np.cos(phase)
        cosine = 1.0 / np.sqrt(1.0 + rise * rise)
        depth = (self.height + self.amplitude * np.sin(phase) - height) * cosine
        return depth, -rise * cosine, cosine


@dataclass(frozen=True, slots=True)
class CircularArc:
    """A lying cylinder with its crest at path coordinate 0."""

    height: float
    """Height of the crest, m."""
    radius: float
    """m"""

    def depth_and_normal(self, along: Floats, height: Floats) -> tuple[Floats, Floats, Floats]:
        up = height - (self.height - self.radius)
        distance = np.hypot(along, up)
        # A tip in the axis itself has no normal. Any would do; up is the limit of the others from above.
        safe = np.where(distance > 0.0, distance, 1.0)
        return self.radius - distance, along / safe, np.where(distance > 0.0, up / safe, 1.0)


@dataclass(frozen=True, slots=True)
class SurfaceProfile:
    """Shape, place and material of the surface."""

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    kind: SurfaceKind = setting(SurfaceKind.FLAT, Mark.CHOSEN, "shape along the path")
    origin_x_mm: float = setting(900.0, Mark.CHOSEN, "base x of path coordinate 0", unit="mm")
    origin_y_mm: float = setting(0.0, Mark.CHOSEN, "base y of path coordinate 0", unit="mm")
    path_deg: float = setting(
        90.0, Mark.CHOSEN, "direction of the path in the base x-y plane, 0 along x, 90 along y", unit="°"
    )
    height_mm: float = setting(590.0, Mark.CHOSEN, "base z of the surface at path coordinate 0", unit="mm")
    slope_deg: float = setting(
        5.0, Mark.CHOSEN, "rise along the path (sloped)", unit="°", minimum=-80.0, maximum=80.0
    )
    amplitude_mm: float = setting(
        5.0, Mark.CHOSEN, "amplitude of the waves (sinusoidal)", unit="mm", minimum=0.0
    )
    period_mm: float = setting(
        100.0, Mark.CHOSEN, "period of the waves along the path (sinusoidal)", unit="mm", above=0.0
    )
    radius_mm: float = setting(300.0, Mark.CHOSEN, "radius (circular_arc)", unit="mm", above=0.0)
    stiffness_n_m: float = setting(
        5000.0, Mark.OBSERVED, "stiffness along the normal; the paper's sponge", unit="N/m", minimum=0.0
    )
    damping_ns_m: float = setting(
        10.0,
        Mark.ASSUMED,
        "damping along the normal while in contact (material linear)",
        unit="N·s/m",
        minimum=0.0,
    )
    material: MaterialProfile = field(default_factory=MaterialProfile)
    stiffness_profile: tuple[tuple[float, float], ...] = setting(
        (),
        Mark.CHOSEN,
        "factors on the stiffness along the path, linear between, constant beyond: pairs of path coordinate "
        "in mm and factor; empty for 1 everywhere",
    )
    begin_mm: float | None = setting(
        None, Mark.CHOSEN, "path coordinate before which there is no surface; none by default", unit="mm"
    )
    end_mm: float | None = setting(
        None, Mark.CHOSEN, "path coordinate behind which there is no surface; none by default", unit="mm"
    )
    friction: float = setting(0.2, Mark.ASSUMED, "Coulomb coefficient against tangential motion", minimum=0.0)
    friction_smoothing_mm_s: float = setting(
        1.0,
        Mark.CHOSEN,
        "tangential speed at which friction has 71 % of its full value",
        unit="mm/s",
        above=0.0,
    )

    def __post_init__(self) -> None:
        check_settings(self)
        if any(len(pair) != 2 for pair in self.stiffness_profile):
            raise ValueError("stiffness_profile must be pairs of path coordinate and factor")
        if not all(math.isfinite(number) for pair in self.stiffness_profile for number in pair):
            raise ValueError("stiffness_profile must be finite numbers")
        if any(factor < 0.0 for _, factor in self.stiffness_profile):
            raise ValueError("stiffness_profile must have factors of at least 0")
        for (place, _), (following, _) in pairwise(self.stiffness_profile):
            if not place < following:
                raise ValueError(f"stiffness_profile must ascend, but {following:g} mm follows {place:g} mm")
        if self.begin_mm is not None and self.end_mm is not None and not self.begin_mm < self.end_mm:
            raise ValueError(f"end_mm must be more than begin_mm, {self.begin_mm:g}, got {self.end_mm:g}")

    def shape(self) -> Shape:
        """The surface in m and rad."""
        height = self.height_mm / 1000.0
        match self.kind:
            case SurfaceKind.FLAT:
                return Plane(height)
            case SurfaceKind.SLOPED:
                return Plane(height, math.radians(self.slope_deg))
            case SurfaceKind.SINUSOIDAL:
                return Sinusoidal(height, self.amplitude_mm / 1000.0, self.period_mm / 1000.0)
            case SurfaceKind.CIRCULAR_ARC:
                return CircularArc(height, self.radius_mm / 1000.0)


class Contact:
    """The force that a surface exerts on the tool tip."""

    def __init__(self, profile: SurfaceProfile, on_change: Callable[[float], object] = _unread) -> None:
        """`on_change` is told since when the surface is another, s."""
        self._surface = profile.shape()
        self._material = profile.material.law(profile.stiffness_n_m, profile.damping_ns_m)
        self._memory = Memory()
        self._memories: deque[Memory] = deque(maxlen=_REMEMBERED)
        """States at the last times, oldest first."""
        self._counts = True
        self.faults = SurfaceFaults(on_change)
        """Changes of the surface by its faults."""
        places = [(place / 1000.0, factor) for place, factor in profile.stiffness_profile]
        self._factors = np.array(places or [(0.0, 1.0)]).T
        self._uniform = not places
        begin, end = profile.begin_mm, profile.end_mm
        self._ends = begin is not None or end is not None
        self._begin = -math.inf if begin is None else begin / 1000.0
        self._end = math.inf if end is None else end / 1000.0
        self._friction = profile.friction
        self._smoothing = profile.friction_smoothing_mm_s / 1000.0
        angle = math.radians(profile.path_deg)
        self._path = np.array([math.cos(angle), math.sin(angle), 0.0])
        self._origin = np.array([profile.origin_x_mm, profile.origin_y_mm, 0.0]) / 1000.0
        self._level: tuple[float, Floats] | None = None
        """Depth of the base frame's origin and normal (3, 1) of a surface whose normal is the same everywhere."""
        if isinstance(self._surface, Plane) and not self._ends:
            depth, normals = self._depth_and_normal(np.zeros((3, 1)))
            self._level = float(depth[0]), normals

    @property
    def handlers(self) -> Mapping[str, Handler]:
        """Handlers of its faults, for a ledger."""
        return self.faults.handlers

    def depth_and_normal(self, positions: Floats) -> tuple[Floats, Floats]:
        """Depth (n,) of the tip below the surface, m, negative outside, and the outward normals (n, 3).

        Where the surface has ended the depth is at most 0. `positions` (n, 3) are those of the tip in the
        base frame, m; so are the normals.
        """
        depth, normal = self._depth_and_normal(positions.T)
        return depth, np.broadcast_to(normal.T, positions.shape)

    def aside(self) -> "Contact":
        """A copy for questions: they change neither the memory nor the counts of this one."""
        twin = copy.copy(self)
        twin._memories, twin._counts = deque(maxlen=1), False
        return twin

    def rewind(self, time: float) -> None:
        """Go back to before this time, s: the samples from then on are shown again."""
        if not self._material.has_memory:
            return
        while self._memories and self._memory.time >= time:
            self._memory = self._memories.pop()

    @property
    def remembered_until(self) -> float | None:
        """Time of the newest sample of a material with a memory, s; None for one that has none."""
        return self._memory.time if self._material.has_memory else None

    def force(self, positions: Floats, velocities: Floats, times: Floats | None = None) -> Floats:
        """Force on the tool tip in the base frame (n, 3), N, for tip positions and velocities (n, 3).

        A material with a memory needs the `times` (n,) too, ascending, s, and goes on from the call before.
        """
        hardness: Floats | float = 1.0
        if self.faults.faulty and times is not None:
            positions, velocities = self._as_seen(positions, velocities, times)
            hardness = self.faults.stiffness(times)
        # One row an axis: numpy is quickest along the last dimension, and three is too short for it.
        depth, normal = self._depth_and_normal(positions.T)
        material = self._material
        if not material.has_memory and not (depth > 0.0).any():
            return np.zeros_like(positions)
        velocity = velocities.T
        leaving = np.einsum("ij,ij->j", velocity, normal)
        factor = hardness if self._uniform else self._factor(positions) * hardness
        if material.has_memory:
            self._memories.append(self._memory)
        pressing, self._memory = material.press(depth, -leaving, factor, times, self._memory)
        sliding = velocity - leaving * normal
        speed = np.sqrt(np.einsum("ij,ij->j", sliding, sliding) + self._smoothing**2)
        force: Floats = pressing * normal - (self._friction * pressing / speed) * sliding
        return force.T

    def _as_seen(self, positions: Floats, velocities: Floats, times: Floats) -> tuple[Floats, Floats]:
        """Positions and velocities (n, 3) against a surface that its faults have moved."""
        height, speed = self.faults.rise(times)
        seen = positions - np.outer(height, _UP)
        if self._counts:
            touched = self._depth_and_normal(positions.T)[0] > 0.0
            touched |= self._depth_and_normal(seen.T)[0] > 0.0
            self.faults.count(times, touched)
        return seen, velocities - np.outer(speed, _UP)

    def _factor(self, positions: Floats) -> Floats:
        """Factor (n,) on the stiffness under the tip."""
        places, factors = self._factors
        factor: Floats = np.interp((positions - self._origin) @ self._path, places, factors)
        return factor

    def _depth_and_normal(self, positions: Floats) -> tuple[Floats, Floats]:
        """Depth (n,) and outward normals (3, n), or (3, 1) for all alike, at tip positions (3, n)."""
        if self._level is not None:
            depth_of_origin, normal = self._level
            return depth_of_origin - normal[:, 0] @ positions, normal
        along = self._path @ (positions - self._origin[:, None])
        depth, normal_along, normal_up = self._surface.depth_and_normal(along, positions[2])
        if self._ends:
            beyond = (along < self._begin) | (along > self._end)
            depth = np.where(beyond, np.minimum(depth, 0.0), depth)
        return depth, np.stack((normal_along * self._path[0], normal_along * self._path[1], normal_up))
