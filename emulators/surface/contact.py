"""Contact of the tool tip with a surface: shape, material and friction at a point.

A surface lies in the base frame (z up). Most kinds are a line in the plane of path and height, the same everywhere
across the path; others are curved both ways. The material acts along the outward normal and never pulls; its
stiffness may change along the path, and the surface may end. Friction is Coulomb's, smoothed near zero velocity.
A wall across the path is a block that stands on the surface. It pushes a place within it out the shorter way: through
its upright face, and then the surface below pushes too, or through its top, which is the surface raised.
"""

import copy
import math
from collections import deque
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from emulators.faults.ledger import Handler
from emulators.surface.face import ONE_POINT_REMEMBERED, Face
from emulators.surface.faults import SurfaceFaults
from emulators.surface.materials import Linear, Memory
from emulators.surface.profile import SurfaceKind, SurfaceProfile
from emulators.surface.removal import Removal, Removed, State
from emulators.surface.shapes import Plane

__all__ = ["Contact", "SurfaceKind", "SurfaceProfile"]

Floats = NDArray[np.float64]

_REMEMBERED = 64
"""Chosen: more blocks of samples than lie between the end of the committed path and the present."""
_UP = np.array([0.0, 0.0, 1.0])
"""Base z."""


def _unread(time: float) -> None:
    """Nothing was computed ahead."""


class _Past(NamedTuple):
    """State to which a surface with a memory goes back."""

    memory: Memory
    removal: State | None


class _Friction(NamedTuple):
    """Coulomb's friction, smoothed near zero velocity."""

    coefficient: float
    smoothing: float
    """m/s"""

    def apply(self, pressing: Floats, normal: Floats, sliding: Floats) -> Floats:
        """Force (3, n), N, of a push (n,) along a normal and its friction against sliding (3, n), m/s."""
        speed = np.einsum("ij,ij->j", sliding, sliding)
        speed += self.smoothing**2
        np.sqrt(speed, out=speed)
        against = self.coefficient * pressing
        against /= speed
        force: Floats = pressing * normal
        force -= against * sliding
        return force


class _Extent(NamedTuple):
    """Where the surface begins and ends along the path, m; infinite where it does not."""

    begin: float
    end: float

    @property
    def is_bounded(self) -> bool:
        """Whether there is a begin or an end."""
        return self.begin > -math.inf or self.end < math.inf

    def is_beyond(self, along: Floats) -> NDArray[np.bool_]:
        """Which places (n,) are not on the surface."""
        return (along < self.begin) | (along > self.end)


class Contact:
    """The force that a surface exerts on the tool tip."""

    def __init__(
        self,
        profile: SurfaceProfile,
        on_change: Callable[[float], object] = _unread,
        face: Face | None = None,
    ) -> None:
        """`on_change` is told since when the surface is another, s. `face` is that of the tool, None for a point: the
        points of a face follow each other within a sample, and each is answered as if it bore all.

        Raises ValueError, in one line, for a file of heights that cannot be read, and for settings that do not go with
        the face.
        """
        self._surface = profile.shape()
        self._material = profile.material.law(profile.stiffness_n_m, profile.damping_ns_m)
        if face is not None and self._material.has_memory:
            raise ValueError(ONE_POINT_REMEMBERED)
        self._points = 1 if face is None else face.count
        self._removal: Removal | None = None
        if profile.removal.um_per_n_cm2_m > 0.0:
            area = None if face is None else face.area
            self._removal = Removal(profile.removal, self._points, area)
        self._memory = Memory()
        self._memories: deque[_Past] = deque(maxlen=_REMEMBERED)
        """States at the last times, oldest first."""
        self._counts = True
        self.faults = SurfaceFaults(on_change)
        """Changes of the surface by its faults."""
        places = [(place / 1000.0, factor) for place, factor in profile.stiffness_profile]
        self._factors = np.array(places or [(0.0, 1.0)]).T
        self._uniform = not places
        begin, end = profile.begin_mm, profile.end_mm
        self._extent = _Extent(
            -math.inf if begin is None else begin / 1000.0, math.inf if end is None else end / 1000.0
        )
        self._wall_at = math.inf if profile.wall_at_mm is None else profile.wall_at_mm / 1000.0
        self._wall_height = profile.wall_height_mm / 1000.0
        self._wall = Linear(profile.wall_stiffness_n_m, profile.damping_ns_m)
        self._friction = _Friction(profile.friction, profile.friction_smoothing_mm_s / 1000.0)
        angle = math.radians(profile.path_deg)
        self._path = np.array([math.cos(angle), math.sin(angle), 0.0])
        self._left = np.array([-math.sin(angle), math.cos(angle), 0.0])
        self._origin = np.array([profile.origin_x_mm, profile.origin_y_mm, 0.0]) / 1000.0
        self._level: tuple[float, Floats] | None = None
        """Depth of the base frame's origin and normal (3, 1) of a surface whose normal is the same everywhere."""
        if isinstance(self._surface, Plane) and not self._extent.is_bounded and profile.wall_at_mm is None:
            depth, normals = self._shaped(np.zeros((3, 1)))
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

    def normals(self, positions: Floats, times: Floats) -> Floats:
        """Outward unit normals (n, 3) below positions (n, 3), m, base frame; NaN where the surface has ended."""
        if self.faults.faulty:
            positions = positions - np.outer(self.faults.rise(times)[0], _UP)
        _, normals = self.depth_and_normal(positions)
        along, *_ = self._places(positions.T)
        ended = self._extent.is_beyond(along)
        return np.where(ended[:, None], np.nan, normals + 0.0)  # no minus zero

    def aside(self) -> "Contact":
        """Return a copy for questions: they change neither the memory nor the counts of this one."""
        twin = copy.copy(self)
        twin._memories, twin._counts = deque(maxlen=1), False
        twin._removal = None if self._removal is None else self._removal.aside()
        return twin

    def rewind(self, time: float) -> None:
        """Go back to before this time, s: the samples from then on are shown again."""
        while self._memories and (shown := self.remembered_until) is not None and shown >= time:
            self._memory, removal = self._memories.pop()
            if self._removal is not None and removal is not None:
                self._removal.restore(removal)

    def _remember(self) -> None:
        """Keep the present state for `rewind`."""
        removal = self._removal
        self._memories.append(_Past(self._memory, None if removal is None else removal.state))
        if removal is not None and (oldest := self._memories[0].removal) is not None:
            removal.forget(oldest)

    @property
    def remembered_until(self) -> float | None:
        """Time of the newest sample of a surface that wears or has a material with a memory, s; None for others."""
        if self._removal is not None:
            return self._removal.time
        return self._memory.time if self._material.has_memory else None

    @property
    def removed(self) -> Removed | None:
        """Depths removed so far; None for a surface that does not wear."""
        if self._removal is None:
            return None
        depths, spacing = self._removal.removed(), self._removal.spacing
        (x, y, _), (along_x, along_y, _) = self._origin.tolist(), self._path.tolist()
        back, right = (0.5 * spacing * (nodes - 1) for nodes in depths.shape)
        origin = (x - back * along_x + right * along_y, y - back * along_y - right * along_x)
        return Removed(origin, (along_x, along_y), (-back, -right), spacing, depths)

    def force(self, positions: Floats, velocities: Floats, times: Floats | None = None) -> Floats:
        """Force on the tool tip in the base frame (n, 3), N, for tip positions and velocities (n, 3).

        A surface with a memory needs the `times` (n,) too, ascending, s, and continues from the call before.
        """
        if self.remembered_until is not None:
            self._remember()
        if self._removal is None:
            return self._pushed(positions, velocities, times)
        if times is None:
            raise ValueError("a surface that wears must be told the times of the samples")
        since, force = self._removal.since(times), np.empty_like(positions)
        for part in self._removal.steps(times):
            force[part] = self._pushed(positions[part], velocities[part], times[part], since[part])
        return force

    def _pushed(
        self, positions: Floats, velocities: Floats, times: Floats | None, since: Floats | None = None
    ) -> Floats:
        """As `force`; `since` (n,) is the time since the sample before, s, of a surface that wears."""
        hardness: Floats | float = 1.0
        if self.faults.faulty and times is not None:
            positions, velocities = self._as_seen(positions, velocities, times)
            hardness = self.faults.stiffness(times)
        # One row an axis: numpy is quickest along the last dimension, and three is too short for it.
        depth, normal = self._depth_and_normal(positions.T)
        material = self._material
        beside = None if self._wall_at == math.inf else self._beside(positions.T)
        if not material.has_memory and not np.count_nonzero(depth > 0.0) and beside is None:
            return np.zeros(positions.shape)
        velocity = velocities.T
        leaving = np.einsum("ij,ij->j", velocity, normal)
        factor = hardness if self._uniform else self._factor(positions) * hardness
        pressing, self._memory = material.press(depth, -leaving, factor, times, self._memory)
        sliding = velocity - leaving * normal
        if self._removal is not None and since is not None:
            along, across, _ = self._places(positions.T)
            way = np.sqrt(np.einsum("ij,ij->j", sliding, sliding)) * since
            self._removal.wear(along, across, pressing * way)
        force = self._friction.apply(pressing, normal, sliding)
        if beside is not None:
            inward = self._path[:, None]
            coming = self._path @ velocity
            against, _ = self._wall.press(beside, coming, 1.0, None, Memory())
            force += self._friction.apply(against, -inward, velocity - coming * inward)
        return force.T

    def _as_seen(self, positions: Floats, velocities: Floats, times: Floats) -> tuple[Floats, Floats]:
        """Positions and velocities (n, 3) against a surface that its faults have moved."""
        height, speed = self.faults.rise(times)
        seen = positions - np.outer(height, _UP)
        if self._counts:
            touched = self._depth_and_normal(positions.T)[0] > 0.0
            touched |= self._depth_and_normal(seen.T)[0] > 0.0
            by_sample = np.logical_or.reduceat(touched, np.arange(0, len(times), self._points))
            self.faults.count(times[:: self._points], by_sample)
        return seen, velocities - np.outer(speed, _UP)

    def _factor(self, positions: Floats) -> Floats:
        """Factor (n,) on the stiffness under the tip."""
        places, factors = self._factors
        factor: Floats = np.interp((positions - self._origin) @ self._path, places, factors)
        return factor

    def _depth_and_normal(self, positions: Floats) -> tuple[Floats, Floats]:
        """Depth (n,) and outward normals (3, n), or (3, 1) for all alike, at tip positions (3, n)."""
        depth, normal = self._shaped(positions)
        if self._removal is not None:
            along, across, _ = self._places(positions)
            depth = depth - self._removal.depth(along, across)
        return depth, normal

    def _shaped(self, positions: Floats) -> tuple[Floats, Floats]:
        """Return the same while nothing has been removed."""
        if self._level is not None:
            depth_of_origin, normal = self._level
            return depth_of_origin - normal[:, 0] @ positions, normal
        along, across, height = self._places(positions)
        if self._wall_at < math.inf:
            through_top = (along > self._wall_at) & ~self._through_face(along, across, height)
            height = np.where(through_top, self._under_top(height), height)
        depth, (n_along, n_left, n_up) = self._surface.depth_and_normal(along, across, height)
        if self._extent.is_bounded:
            beyond = self._extent.is_beyond(along)
            depth = np.where(beyond, np.minimum(depth, 0.0), depth)
        x, y, _ = self._path
        return depth, np.stack((n_along * x - n_left * y, n_along * y + n_left * x, n_up))

    def _places(self, positions: Floats) -> tuple[Floats, Floats, Floats]:
        """Positions (3, n) in the frame of the shape: along, across, height, m."""
        from_origin = positions - self._origin[:, None]
        return self._path @ from_origin, self._left @ from_origin, positions[2]

    def _through_face(self, along: Floats, across: Floats, height: Floats) -> NDArray[np.bool_]:
        """Which places (n,) are in the wall, and nearer to its upright face than to its top."""
        aside = along - self._wall_at
        below_top, _ = self._surface.depth_and_normal(along, across, self._under_top(height))
        return (aside > 0.0) & (aside < below_top) & ~self._extent.is_beyond(along)

    def _beside(self, positions: Floats) -> Floats | None:
        """How far places (3, n) are behind the upright face of the wall that pushes them back (n,), m; None where it
        pushes none of them.
        """
        along, across, height = self._places(positions)
        pushed = self._through_face(along, across, height)
        return np.where(pushed, along - self._wall_at, 0.0) if pushed.any() else None

    def _under_top(self, height: Floats) -> Floats:
        """Heights (n,) where the surface without the wall is as near as its top is with it. A lying cylinder is no
        less thick below its axis.
        """
        return np.maximum(height - self._wall_height, np.minimum(height, self._surface.narrows_below))
