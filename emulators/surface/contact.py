"""Contact of the tool tip with a surface: shape, material and friction at a point.

A surface is defined in the base frame (z up). Most kinds are a profile in the plane of path and height, constant
across the path; others are curved in both directions. The material acts along the outward normal and never pulls; its
stiffness may change along the path, and the surface may end. Friction is Coulomb friction, smoothed near zero velocity.
A wall across the path is a block on the surface. It pushes a point inside it out in the shorter direction: through its
upright face, where the surface below pushes too, or through its top, which is the raised surface.
"""

import copy
import math
from collections import deque
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from emulators.faults.ledger import Handler
from emulators.surface.face import FACE_NEEDS_NO_MEMORY, Face
from emulators.surface.faults import SurfaceFaults
from emulators.surface.materials import Linear, Memory
from emulators.surface.plane_law import PlaneLaw
from emulators.surface.profile import SurfaceKind, SurfaceProfile
from emulators.surface.removal import Removal, Removed, State
from emulators.surface.shapes import Plane

__all__ = ["Contact", "SurfaceKind", "SurfaceProfile"]

Floats = NDArray[np.float64]

_REMEMBERED = 64
"""Number of earlier states that are kept. Chosen: more blocks of samples than fit between the present and the end
of the committed path.
"""
_UP = np.array([0.0, 0.0, 1.0])
"""Unit vector of base z."""


def _unread(time: float) -> None:
    """Do nothing, because nothing was computed ahead."""


class _Past(NamedTuple):
    """Earlier state to which a surface with memory can return."""

    memory: Memory
    removal: State | None


class _Friction(NamedTuple):
    """Coulomb friction, smoothed near zero velocity."""

    coefficient: float
    smoothing: float
    """Speed at which friction has 71 % of its full value, m/s."""

    def apply(self, pressing: Floats, normal: Floats, sliding: Floats) -> Floats:
        """Return the force (3, n), N, that results from a normal force and its friction.

        `pressing` (n,) is the normal force, N, and `sliding` (3, n) is the sliding velocity, m/s.
        """
        speed = np.einsum("ij,ij->j", sliding, sliding)
        speed += self.smoothing**2
        np.sqrt(speed, out=speed)
        against = self.coefficient * pressing
        against /= speed
        force: Floats = pressing * normal
        force -= against * sliding
        return force


class _Extent(NamedTuple):
    """Start and end of the surface along the path, m; infinite if the surface is unbounded."""

    begin: float
    end: float

    @property
    def is_bounded(self) -> bool:
        """Whether the surface has a start or an end."""
        return self.begin > -math.inf or self.end < math.inf

    def is_beyond(self, along: Floats) -> NDArray[np.bool_]:
        """Return which path coordinates (n,) are beyond the start or the end."""
        return (along < self.begin) | (along > self.end)


class Contact:
    """Contact model that returns the force of a surface on the tool tip."""

    def __init__(
        self,
        profile: SurfaceProfile,
        on_change: Callable[[float], object] = _unread,
        face: Face | None = None,
    ) -> None:
        """`on_change` is called with the time, s, from which a fault has changed the surface.

        `face` is the face of the tool; None for a point. The points of a face are consecutive within a sample, and
        the force at each point is computed as if the point carried the entire load. Raises ValueError, in one line,
        for a height map file that cannot be read, and for settings that are incompatible with the face.
        """
        self._surface = profile.shape()
        self._material = profile.material.law(profile.stiffness_n_m, profile.damping_ns_m)
        if face is not None and self._material.has_memory:
            raise ValueError(FACE_NEEDS_NO_MEMORY)
        self._points = 1 if face is None else face.count
        self._removal: Removal | None = None
        if profile.removal.um_per_n_cm2_m > 0.0:
            area = None if face is None else face.area
            self._removal = Removal(profile.removal, self._points, area)
        self._memory = Memory()
        self._memories: deque[_Past] = deque(maxlen=_REMEMBERED)
        """Recent states of the surface, oldest first."""
        self._counts = True
        self.faults = SurfaceFaults(on_change)
        """Changes of the surface by the faults of its target."""
        factors = [(coordinate / 1000.0, factor) for coordinate, factor in profile.stiffness_profile]
        self._factors = np.array(factors or [(0.0, 1.0)]).T
        self._uniform = not factors
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
        """Depth of the base frame's origin and normal (3, 1) if the normal of the surface is constant."""
        if isinstance(self._surface, Plane) and not self._extent.is_bounded and profile.wall_at_mm is None:
            depth, normals = self._unworn_depth_and_normal(np.zeros((3, 1)))
            self._level = float(depth[0]), normals

        self._plane = self._plane_law()

    def _plane_law(self) -> PlaneLaw | None:
        """Return the law of this surface if it is a plane of linear material that does not wear; None otherwise."""
        if self._level is None or not isinstance(self._material, Linear):
            return None
        if self._removal is not None or not self._uniform:
            return None
        (depth, normal), friction = self._level, self._friction
        x, y, z = normal[:, 0].tolist()
        law = self._material
        return PlaneLaw(
            depth, (x, y, z), law.stiffness, law.damping, friction.coefficient, friction.smoothing
        )

    @property
    def plane(self) -> PlaneLaw | None:
        """Law to which the force reduces while the surface has no fault; None for a surface with more than that."""
        return None if self.faults.faulty else self._plane

    @property
    def handlers(self) -> Mapping[str, Handler]:
        """Fault handlers for a ledger, by fault name."""
        return self.faults.handlers

    def depth_and_normal(self, positions: Floats) -> tuple[Floats, Floats]:
        """Return the depth (n,) of the tip below the surface, m, negative outside, and the outward normals (n, 3).

        Beyond the end of the surface, the depth is at most 0. `positions` (n, 3) are tip positions, m. Positions
        and normals are in the base frame.
        """
        depth, normal = self._depth_and_normal(positions.T)
        return depth, np.broadcast_to(normal.T, positions.shape)

    def normals(self, positions: Floats, times: Floats) -> Floats:
        """Return outward unit normals (n, 3) of the surface below positions (n, 3), m, base frame.

        The result is NaN beyond the end of the surface.
        """
        if self.faults.faulty:
            positions = positions - np.outer(self.faults.rise(times)[0], _UP)
        _, normals = self.depth_and_normal(positions)
        along, *_ = self._path_coordinates(positions.T)
        ended = self._extent.is_beyond(along)
        return np.where(ended[:, None], np.nan, normals + 0.0)  # avoids minus zero

    def aside(self) -> "Contact":
        """Return a copy for queries that must not change the memory or the counts of this surface."""
        twin = copy.copy(self)
        twin._memories, twin._counts = deque(maxlen=1), False
        twin._removal = None if self._removal is None else self._removal.aside()
        return twin

    def rewind(self, time: float) -> None:
        """Return to the state before this time, s. The samples after this time will be passed again."""
        while self._memories and (newest := self.remembered_until) is not None and newest >= time:
            self._memory, removal = self._memories.pop()
            if self._removal is not None and removal is not None:
                self._removal.restore(removal)

    def _remember(self) -> None:
        """Store the present state for `rewind`."""
        removal = self._removal
        self._memories.append(_Past(self._memory, None if removal is None else removal.state))
        if removal is not None and (oldest := self._memories[0].removal) is not None:
            removal.forget(oldest)

    @property
    def remembered_until(self) -> float | None:
        """Time of the newest sample, s, if the surface wears or its material has memory; None otherwise."""
        if self._removal is not None:
            return self._removal.time
        return self._memory.time if self._material.has_memory else None

    @property
    def removed(self) -> Removed | None:
        """Material removed so far; None if the surface does not wear."""
        if self._removal is None:
            return None
        depths, spacing = self._removal.removed(), self._removal.spacing
        (x, y, _), (along_x, along_y, _) = self._origin.tolist(), self._path.tolist()
        back, right = (0.5 * spacing * (nodes - 1) for nodes in depths.shape)
        origin = (x - back * along_x + right * along_y, y - back * along_y - right * along_x)
        return Removed(origin, (along_x, along_y), (-back, -right), spacing, depths)

    def force(self, positions: Floats, velocities: Floats, times: Floats | None = None) -> Floats:
        """Return the force (n, 3) on the tool tip, base frame, N, for tip positions and velocities (n, 3).

        A surface with memory also needs `times` (n,) in ascending order, s, and continues from the previous call.
        """
        if self.remembered_until is not None:
            self._remember()
        if self._removal is None:
            return self._tip_force(positions, velocities, times)
        if times is None:
            raise ValueError("a surface that wears needs the times of the samples")
        since, force = self._removal.since(times), np.empty_like(positions)
        for part in self._removal.steps(times):
            force[part] = self._tip_force(positions[part], velocities[part], times[part], since[part])
        return force

    def _tip_force(
        self, positions: Floats, velocities: Floats, times: Floats | None, since: Floats | None = None
    ) -> Floats:
        """Return the force on the tool tip as `force` does, without advancing the time steps of wear.

        `since` (n,) is the time since the previous sample, s, for a surface that wears.
        """
        hardness: Floats | float = 1.0
        if self.faults.faulty and times is not None:
            positions, velocities = self._relative_motion(positions, velocities, times)
            hardness = self.faults.stiffness(times)
        # One row per axis: numpy is fastest along the last dimension, and three elements are too few for it.
        depth, normal = self._depth_and_normal(positions.T)
        material = self._material
        wall_depth = None if self._wall_at == math.inf else self._wall_depth(positions.T)
        if not material.has_memory and not np.count_nonzero(depth > 0.0) and wall_depth is None:
            return np.zeros(positions.shape)
        velocity = velocities.T
        leaving = np.einsum("ij,ij->j", velocity, normal)
        factor = hardness if self._uniform else self._factor(positions) * hardness
        pressing, self._memory = material.press(depth, -leaving, factor, times, self._memory)
        sliding = velocity - leaving * normal
        if self._removal is not None and since is not None:
            along, across, _ = self._path_coordinates(positions.T)
            distance = np.sqrt(np.einsum("ij,ij->j", sliding, sliding)) * since
            self._removal.wear(along, across, pressing * distance)
        force = self._friction.apply(pressing, normal, sliding)
        if wall_depth is not None:
            inward = self._path[:, None]
            approach = self._path @ velocity
            against, _ = self._wall.press(wall_depth, approach, 1.0, None, Memory())
            force += self._friction.apply(against, -inward, velocity - approach * inward)
        return force.T

    def _relative_motion(self, positions: Floats, velocities: Floats, times: Floats) -> tuple[Floats, Floats]:
        """Return positions and velocities (n, 3) relative to the surface, which its faults may have moved."""
        height, speed = self.faults.rise(times)
        relative = positions - np.outer(height, _UP)
        if self._counts:
            touched = self._depth_and_normal(positions.T)[0] > 0.0
            touched |= self._depth_and_normal(relative.T)[0] > 0.0
            by_sample = np.logical_or.reduceat(touched, np.arange(0, len(times), self._points))
            self.faults.count(times[:: self._points], by_sample)
        return relative, velocities - np.outer(speed, _UP)

    def _factor(self, positions: Floats) -> Floats:
        """Return the factor (n,) by which the stiffness below the tip is multiplied."""
        coordinates, factors = self._factors
        factor: Floats = np.interp((positions - self._origin) @ self._path, coordinates, factors)
        return factor

    def _depth_and_normal(self, positions: Floats) -> tuple[Floats, Floats]:
        """Return depth (n,) and outward normals (3, n), or (3, 1) if constant, at tip positions (3, n)."""
        depth, normal = self._unworn_depth_and_normal(positions)
        if self._removal is not None:
            along, across, _ = self._path_coordinates(positions)
            depth = depth - self._removal.depth(along, across)
        return depth, normal

    def _unworn_depth_and_normal(self, positions: Floats) -> tuple[Floats, Floats]:
        """Return depth and normal like `_depth_and_normal`, for the surface before any material was removed."""
        if self._level is not None:
            depth_of_origin, normal = self._level
            return depth_of_origin - normal[:, 0] @ positions, normal
        along, across, height = self._path_coordinates(positions)
        if self._wall_at < math.inf:
            through_top = (along > self._wall_at) & ~self._through_face(along, across, height)
            height = np.where(through_top, self._under_top(height), height)
        depth, (n_along, n_left, n_up) = self._surface.depth_and_normal(along, across, height)
        if self._extent.is_bounded:
            beyond = self._extent.is_beyond(along)
            depth = np.where(beyond, np.minimum(depth, 0.0), depth)
        x, y, _ = self._path
        return depth, np.stack((n_along * x - n_left * y, n_along * y + n_left * x, n_up))

    def _path_coordinates(self, positions: Floats) -> tuple[Floats, Floats, Floats]:
        """Return positions (3, n) in the frame of the shape: along the path, across it, and height, m."""
        from_origin = positions - self._origin[:, None]
        return self._path @ from_origin, self._left @ from_origin, positions[2]

    def _through_face(self, along: Floats, across: Floats, height: Floats) -> NDArray[np.bool_]:
        """Return which points (n,) are inside the wall and closer to its upright face than to its top."""
        behind_face = along - self._wall_at
        below_top, _ = self._surface.depth_and_normal(along, across, self._under_top(height))
        return (behind_face > 0.0) & (behind_face < below_top) & ~self._extent.is_beyond(along)

    def _wall_depth(self, positions: Floats) -> Floats | None:
        """Return the depth (n,) of positions (3, n) behind the upright face of the wall, m.

        The depth is 0 for positions that the face does not push back. The result is None if the face pushes no
        position back.
        """
        along, across, height = self._path_coordinates(positions)
        pushed = self._through_face(along, across, height)
        return np.where(pushed, along - self._wall_at, 0.0) if pushed.any() else None

    def _under_top(self, height: Floats) -> Floats:
        """Return heights (n,) that are as far from the surface as `height` is from the top of the wall.

        Below the axis of a cylinder the solid narrows again, so the heights are not lowered further there.
        """
        return np.maximum(height - self._wall_height, np.minimum(height, self._surface.narrows_below))
