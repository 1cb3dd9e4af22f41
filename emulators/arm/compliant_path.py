"""Path of a compliant arm's tool: the path that the encoders measure, plus the deflection.

Contact, weight and motion cause the deflection.

The tool is a mass on the arm's compliance, with one natural frequency and damping ratio in all directions:

    d'' + 2 ζ ω d' + ω² (d - C F) = -p''

where d is the deflection, p the path of the rigid arm, C the compliance and F the force of contact and weight. The
effective mass (ω² C)⁻¹ makes the deflection C F under a constant force, and contact, spring and damper never add
energy.

The equation is integrated on a fixed time grid that begins at power-up. The integration is exact if the force and the
path of the rigid arm are linear between two grid points, so that its velocity jumps at the points. A block of points is
solved at once, by Newton's method where the tool touches the surface. The results therefore do not depend on the times
of the reads, to within the tolerance of that method. After the newest point, the motion continues with a constant
force, and the contact force is that of this motion.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from emulators.arm.mode import POINTS, Block, Mode, responses
from emulators.arm.plane_contact import PlaneContact
from emulators.seams import ArmPath, Floats
from emulators.surface.plane_law import PlaneLaw
from protocol.geometry import Quaternion, angle_between

STEP_S, FINE_STEP_S = 1.0 / 500, 1.0 / 1000
"""Time step of the grid, s, and that for a spindle. Chosen: a contact of 100 kN/m on the lightest of our arms, 4 kg at
the tool, oscillates at 25 Hz, with 20 points per period. Up to 200 kN/m, the largest force of an impact is right to
1 %.
"""
_SOME_POINTS, _FEW_POINTS = 32, 16
"""Largest number of points solved at once in contact, and where contact begins, ends or changes. Chosen."""
_ITERATIONS = 20
_TOLERANCE_N = 1e-4
"""Largest error of the contact force in a solution, N. Chosen: far below the noise of every sensor."""
_CONTRACTION = 0.6
"""Share of the error that an iteration may leave; if more remains, the contact is linearised again. Chosen."""
_POSITION_STEP_M, _VELOCITY_STEP_M_S = 1e-8, 1e-6
"""Steps of the difference quotients of a surface's force, m and m/s. Chosen."""
_SHIFTS = np.zeros((7, 2, 3))
"""Offsets in position and velocity of a sample and of its six neighbours."""
_SHIFTS[1:4, 0] = _POSITION_STEP_M * np.eye(3)
_SHIFTS[4:7, 1] = _VELOCITY_STEP_M_S * np.eye(3)
_KEPT = 24_000
"""Number of grid points that are kept at least. Chosen: more than the ten seconds of an arm's path on the finest grid
use at once.
"""
_NEAR_M, _NEAR_RAD = 2e-3, 0.01
"""Displacement and rotation of the tool after which the compliance is computed again, m and rad. Chosen."""
_ON_GRID = 1e-5
"""Distance from a grid point, in steps, at which a time is that of the point. Chosen: far above a rounding error."""
_BEFORE_S = 2e-9
"""Time before a grid point at which the path of the arm is read for it, s. Chosen: a controller whose cycle begins at
that point then does not run it for this read.
"""
_GAP_S = 5.0
"""Longest time without a reader, s. After a longer time, the tool restarts from its equilibrium. Chosen."""


def _forget() -> None:
    """Do nothing, because there is no memory."""


def _no_plane() -> None:
    """Return None, because the surface is not a plane."""


class Contact(NamedTuple):
    """Contact that acts on the tool."""

    force: Callable[[Floats, Floats, Floats], Floats]
    """Function that returns the force (n, 3), N, base frame, at times (n,) in ascending order, s, for positions and
    velocities (n, 3) of the tool.

    The times follow the motion that was accepted last. Repeated calls return equal results.
    """
    keep: Callable[[], object] = _forget
    """Callback for when the motion of the last call of `force` has been accepted."""
    plane: Callable[[], PlaneLaw | None] = _no_plane
    """Function that returns the law to which `force` reduces at present; None if it depends on more than that."""


class Bearing(NamedTuple):
    """Support of the tool: the compliance at its position, and the deflection that its weight causes there."""

    compliance: Floats
    """Compliance of the tool (6, 6), base frame: translation, m, and rotation, rad, per wrench about the tip, N and
    N·m.
    """
    sag: Floats
    """Deflection (6,) due to the weight of the tool, m and rad."""


class Grid(NamedTuple):
    """Time grid on which the motion is integrated."""

    powered_at: float
    """Start of the grid, s, with the tool in equilibrium."""
    step: float = STEP_S
    """Time step, s; shorter for a spindle, and for a surface with memory, which must receive as many samples as the
    sensor.
    """
    has_memory: bool = False
    """Whether the contact force depends on the earlier motion."""


def _unread(time: float) -> None:
    """Do nothing, because no reader has read ahead."""


class CompliantPath:
    """True path of the tool of a compliant arm: an `ArmPath` that wraps the path of the arm."""

    def __init__(
        self, path: ArmPath, mode: Mode, bearing: Callable[[float], Bearing], contact: Contact, grid: Grid
    ) -> None:
        """`bearing` maps a time, s, to the bearing for the pose of the rigid arm at that time."""
        step = grid.step
        self._path, self._mode, self._bearing_at, self._contact = path, mode, bearing, contact
        self._step, self._has_memory = step, grid.has_memory
        self._responses = responses(mode, step)
        self._without_contact: dict[int, Floats] = {}
        """Matrices of `Responses.without_contact` for few points, by their number."""
        self.on_change: Callable[[float], object] = _unread
        """Callback for the time from which the path differs from the path that could be read before, s."""
        path.on_change = self._on_path_change
        self._bearing = Bearing(np.zeros((6, 6)), np.zeros(6))
        self._borne_at: tuple[Floats, Quaternion] = np.zeros(3), (1.0, 0.0, 0.0, 0.0)
        """Position, m, and orientation of the rigid arm for which the bearing was computed."""
        self._rows = np.zeros((2 * _KEPT, 15))
        """Of each grid point from `_oldest` on: deflection, deflection velocity, contact force, mean velocity of the
        rigid arm since the point before, and its position. The deflection velocity is relative to that mean velocity.
        """
        self._linear: Floats | None = None
        """Matrix for the contact that was linearised last, which maps the error of its force to the correction."""
        self._oldest = self._newest = self._readable = 0
        """Numbers of the oldest and the newest known grid point, and of the newest that may be computed.

        No point is known before the first read.
        """
        self._plane: PlaneContact | None = None
        """Contact with the plane `_law`, or None if it must be derived again."""
        self._law: PlaneLaw | None = None
        self._begun, self._is_solving, self._origin = False, False, grid.powered_at

    # --- as a path

    def advance(self, now: float) -> None:
        """Advance the path of the arm; see `ArmPath.advance`."""
        self._path.advance(now)

    def committed_until(self, now: float) -> float:
        """Return the time up to which the path is committed, s; see `ArmPath.committed_until`."""
        return self._readable_until(now, self._path.committed_until(now))

    def predicted_until(self, now: float) -> float:
        """Return the time up to which the path may be read, s; see `ArmPath.predicted_until`."""
        return self._readable_until(now, self._path.predicted_until(now))

    def _readable_until(self, now: float, limit: float) -> float:
        """Return the time of the newest grid point up to which the path of the arm may be read, at least `now`, s."""
        point = self._point_before(limit)
        self._readable = max(self._readable, point)
        return max(now, min(limit, self._origin + point * self._step))

    def orientations(self, times: Floats) -> list[tuple[slice, Quaternion]]:
        """Return the orientations of the rigid arm; see `ArmPath.orientations`.

        `rotations` returns the additional rotation due to the compliance.
        """
        return self._path.orientations(times)

    def trajectory(self, times: Floats) -> tuple[Floats, Floats]:
        """Return positions and velocities including the deflection; see `ArmPath.trajectory`."""
        self._extend(float(times[0]), float(times[-1]))
        positions, velocities = self._path.trajectory(times)
        offset, velocities = self._deflection(times, velocities)
        return positions + offset, velocities

    def contact_forces(self, times: Floats) -> Floats:
        """Return the contact force on the tool (n, 3), base frame, N, linear between the points of the grid.

        `times` (n,) are in ascending order, s. For a surface without memory.
        """
        begin, end = float(times[0]), float(times[-1])
        self._extend(begin, end)
        oldest, newest = self._oldest, self._newest
        first = min(max(self._point_before(begin), oldest), newest)
        last = min(max(self._point_before(end) + 1, oldest), newest)
        points = np.arange(first, last + 1, dtype=np.float64)
        at, known = (times - self._origin) / self._step, self._rows[first - oldest : last + 1 - oldest]
        forces = np.empty((3, len(times)))
        for axis in range(3):
            forces[axis] = np.interp(at, points, known[:, 6 + axis])
        if at[-1] > newest + _ON_GRID:
            ahead = int(np.searchsorted(at, newest + _ON_GRID))
            late = times[ahead:]
            forces[:, ahead:] = self._contact.force(late, *self.trajectory(late)).T
        return forces.T

    def rotations(self, times: Floats) -> Floats:
        """Return the rotation of the tool due to contact and weight (n, 3), rad, base frame.

        `times` (n,) are in ascending order, s.
        """
        self._extend(float(times[0]), float(times[-1]))
        bearing = self._bearing
        at = (times - self._origin) / self._step
        points = self._points_before(np.round(at))
        rotations: Floats = (
            self._rows[points - self._oldest, 6:9] @ bearing.compliance[3:, :3].T + bearing.sag[3:]
        )
        return rotations

    def rewind(self, time: float) -> None:
        """Discard all points from this time on, s, because the path or the surface has changed."""
        self._newest = max(min(self._newest, self._point_before(time)), self._oldest)

    def _on_path_change(self, time: float) -> None:
        self.rewind(time)
        self.on_change(time)

    # --- the deflection

    def _deflection(self, times: Floats, velocities: Floats) -> tuple[Floats, Floats]:
        """Return the deflection (n, 3), m, and the velocity of the tool (n, 3), m/s, at times (n,), s.

        `velocities` (n, 3) are the velocities of the rigid arm at these times, m/s.
        """
        step, rows = self._step, self._rows
        at = (times - self._origin) / step
        points = self._points_before(at)
        since = np.maximum((at - points) * step, 0.0)
        here, there = rows[points - self._oldest], rows[np.minimum(points + 1, self._newest) - self._oldest]
        s, rigid = (since / step)[:, None], there[:, 9:12].copy()
        after_jump = here[:, 3:6] + here[:, 9:12] - rigid
        a, b, va, vb = here[:, :3], there[:, :3], after_jump * step, there[:, 3:6] * step
        bend, twist = 3.0 * (b - a) - 2.0 * va - vb, 2.0 * (a - b) + va + vb
        offset = a + s * (va + s * (bend + s * twist))
        drift = (va + s * (2.0 * bend + 3.0 * s * twist)) / step
        ahead = np.flatnonzero(points >= self._newest)
        if len(ahead):
            newest, duration, bearing = self._newest_row, since[ahead], self._bearing
            pull = self._mode.stiffness * (bearing.compliance[:3, :3] @ newest[6:9] + bearing.sag[:3])
            rigid[ahead] = velocities[ahead]
            after_jump = newest[3:6] + newest[9:12] - rigid[ahead]
            matrix, held = self._mode.transition(duration)
            for row, out in ((0, offset), (1, drift)):
                out[ahead] = (
                    np.outer(matrix[row, 0], newest[:3])
                    + matrix[row, 1][:, None] * after_jump
                    + np.outer(held[row], pull)
                )
        return offset, rigid + drift

    @property
    def _newest_row(self) -> Floats:
        """Row (15,) of the newest grid point."""
        row: Floats = self._rows[self._newest - self._oldest]
        return row

    def _point_before(self, time: float) -> int:
        """Return the number of the newest grid point that is not after a time, s."""
        return math.floor((time - self._origin) / self._step + _ON_GRID)

    def _points_before(self, steps: Floats) -> NDArray[np.int_]:
        """Return the number of the newest known grid point that is not after each of these times (n,), in steps."""
        points: NDArray[np.int_] = (steps + _ON_GRID).astype(int)
        return np.minimum(np.maximum(points, self._oldest), self._newest)

    def _times(self, first: int, count: int) -> Floats:
        """Return the times (count,) of the grid points from number `first` on, s."""
        return self._origin + np.arange(first, first + count, dtype=np.float64) * self._step

    def _extend(self, begin: float, end: float) -> None:
        """Compute every grid point up to `end`, s, unless the contact reads the path while a point is computed."""
        if self._is_solving:
            return
        last, gap = self._point_before(end), math.ceil(_GAP_S / self._step)
        last = max(last, min(last + 1, self._readable))
        if not self._begun or last - self._newest > gap:
            self._start(max(min(self._point_before(begin), last - gap), 0))
        while self._newest < last:
            point, points = self._newest, min(POINTS, last - self._newest)
            times = self._times(point + 1, points) - _BEFORE_S
            positions, _ = self._path.trajectory(times)
            if self._newest == point:  # an arm that senses its contact may have rewound the path
                self._is_solving = True
                far = self._first_far(times, positions)
                self._solve(positions[: far + 1])
                if self._newest == point + far + 1:
                    self._bear(times[far : far + 1], positions[far])
                self._is_solving = False

    def _start(self, point: int) -> None:
        """Start in equilibrium at a grid point."""
        time = self._times(point, 1)
        before = np.maximum(time - _BEFORE_S, self._origin)
        positions, velocities = self._path.trajectory(before)
        self._bear(before, positions[0])
        compliance, sag, still = self._bearing.compliance[:3, :3], self._bearing.sag[:3], np.zeros((1, 3))
        offset = sag.copy()
        for _ in range(_ITERATIONS):
            force, (by_position, _) = self._linearise(time, positions + offset, still)
            error = compliance @ force[0] + sag - offset
            offset += np.linalg.solve(np.eye(3) - compliance @ by_position[0], error)
        force = self._contact.force(time, positions + offset, still)
        self._oldest = self._newest = point
        self._rows[0] = [*offset, 0.0, 0.0, 0.0, *force[0], *velocities[0], *positions[0]]
        self._begun = True

    def _bear(self, time: Floats, position: Floats) -> None:
        """Compute the bearing for the rigid arm at a time (1,), s, when it is at this position (3,), m."""
        self._bearing = self._bearing_at(float(time[0]))
        self._borne_at = position, self._path.orientations(time)[0][1]
        self._linear = self._plane = None

    def _first_far(self, times: Floats, positions: Floats) -> int:
        """Return the index of the first of these points at which the bearing must be computed again.

        Without such a point, it is their number. `positions` (n, 3) are those of the rigid arm at `times` (n,), s. A
        block ends at such a point, so the compliance changes at the same points, whatever the blocks are.
        """
        place, quaternion = self._borne_at
        distances = np.abs(positions - place)
        far = [len(times)]
        if distances.max() > _NEAR_M:
            far.append(int(np.argmax(distances.max(axis=1) > _NEAR_M)))
        for part, turned in self._path.orientations(times):
            if turned != quaternion and angle_between(turned, quaternion) > _NEAR_RAD:
                far.append(part.start)
        return min(far)

    def _solve(self, positions: Floats) -> None:
        """Compute the next points, or at least the first of them, for these positions (n, 3) of the rigid arm, m."""
        start = self._newest_row
        if (law := self._contact.plane()) is not None:
            self._store(positions, self._contact_with(law).motion(start, positions))
            return
        block = self._free_motion(start, positions)
        if not start[6:9].any():
            force = self._contact.force(
                block.times, block.positions + block.base[0], block.velocities + block.base[1]
            )
            if not force.any():
                self._note(block, block.base, force)
                return
        elif self._solve_as_linear(block.first(min(len(positions), _SOME_POINTS)), start[6:9]):
            return
        points = min(len(positions), _FEW_POINTS)
        while not self._solved(block.first(points), start[6:9], points == 1):
            points = (points + 1) // 2

    def _free_motion(self, start: Floats, positions: Floats) -> Block:
        """Return the block of the next points, without contact at these points.

        `start` (15,) is the row of the newest point, and `positions` (n, 3) are those of the rigid arm.
        """
        places = np.concatenate((start[None, 12:], positions))
        velocities = (places[1:] - places[:-1]) / self._step
        compliance = self._mode.stiffness * self._bearing.compliance[:3, :3]
        points, grid = len(velocities), self._responses
        matrix = self._without_contact.get(points)
        if matrix is None:
            matrix = grid.without_contact(points)
            if points <= _FEW_POINTS:
                self._without_contact[points] = matrix
        known = np.empty((points + 4, 3))
        known[:2] = start[:6].reshape(2, 3)
        known[2] = compliance @ start[6:9]
        known[3] = self._mode.stiffness * self._bearing.sag[:3]
        known[4] = velocities[0] - start[9:12]
        known[5:] = velocities[1:] - velocities[:-1]
        forced = grid.forced[:, :points, 1 : points + 1]
        times = self._times(self._newest + 1, points)
        return Block(matrix @ known, forced, compliance, times, positions, velocities)

    def _contact_with(self, law: PlaneLaw) -> PlaneContact:
        """Return the contact of the tool with a plane on the present bearing."""
        if self._plane is None or law is not self._law:
            compliance = self._mode.stiffness * self._bearing.compliance[:3, :3]
            self._plane = PlaneContact(law, self._responses, compliance, self._bearing.sag[:3])
            self._law = law
        return self._plane

    def _solve_as_linear(self, block: Block, force: Floats) -> bool:
        """Solve a block whose contact stays nearly linear; return whether the iteration converges.

        `force` is the contact force at the last solved point.
        """
        forces = np.repeat(force[None], len(block.times), axis=0)
        for linear in (self._linear, None):
            if linear is None:
                middle = len(block.times) // 2
                # a surface with memory needs the motion up to there
                part = slice(0 if self._has_memory else middle, middle + 1)
                moved = block.response(forces)
                _, (by_position, by_velocity) = self._linearise(
                    block.times[part],
                    block.positions[part] + moved[0, part],
                    block.velocities[part] + moved[1, part],
                )
                self._linear = linear = self._responses.joined(
                    _SOME_POINTS, by_position[-1] @ block.compliance, by_velocity[-1] @ block.compliance
                )
            before = math.inf
            for _ in range(_ITERATIONS):
                moved = block.response(forces)
                answer = self._contact.force(
                    block.times, block.positions + moved[0], block.velocities + moved[1]
                )
                error = answer - forces
                size = float(np.abs(error).max())
                if size <= _TOLERANCE_N:
                    self._note(block, moved, answer)
                    return True
                if size > _CONTRACTION * before:
                    break
                before = size
                forces = forces + (linear[: error.size, : error.size] @ error.ravel()).reshape(error.shape)
        return False

    def _solved(self, block: Block, force: Floats, last: bool) -> bool:
        """Solve a block by Newton's method; return whether the iteration converges.

        With `last`, the best result is kept even if the iteration does not converge.
        """
        before = forces = np.repeat(force[None], len(block.times), axis=0)
        share, best, change = 1.0, math.inf, np.zeros_like(forces)
        for _ in range(_ITERATIONS):
            moved = block.response(forces)
            answer, slopes = self._linearise(
                block.times, block.positions + moved[0], block.velocities + moved[1]
            )
            error = float(np.abs(answer - forces).max())
            if error <= _TOLERANCE_N:
                self._note(block, moved, answer)
                return True
            if error < best:
                best, share, before = error, 1.0, forces
                change = block.newton_step(answer - forces, slopes)
            else:
                share *= 0.5
            forces = before + share * change
        if last:
            moved = block.response(before)
            self._note(
                block,
                moved,
                self._contact.force(block.times, block.positions + moved[0], block.velocities + moved[1]),
            )
        return last

    def _linearise(
        self, times: Floats, positions: Floats, velocities: Floats
    ) -> tuple[Floats, tuple[Floats, Floats]]:
        """Return the contact force (n, 3) and its derivatives with respect to position and velocity (n, 3, 3)."""
        if self._has_memory:
            forces = np.array(
                [
                    self._contact.force(times, positions + near, velocities + faster)
                    for near, faster in _SHIFTS
                ]
            )
        else:  # a sample and its six neighbours at once
            shifted = (
                (positions[:, None] + _SHIFTS[:, 0]).reshape(-1, 3),
                (velocities[:, None] + _SHIFTS[:, 1]).reshape(-1, 3),
            )
            forces = self._contact.force(np.repeat(times, 7), *shifted).reshape(-1, 7, 3).transpose(1, 0, 2)
        by_position = (forces[1:4] - forces[0]) / _POSITION_STEP_M
        by_velocity = (forces[4:7] - forces[0]) / _VELOCITY_STEP_M_S
        return forces[0], (by_position.transpose(1, 2, 0), by_velocity.transpose(1, 2, 0))

    def _note(self, block: Block, moved: Floats, force: Floats) -> None:
        """Store the points of a block: deflections and velocities (2, n, 3), forces (n, 3)."""
        motion = np.concatenate((moved[0], moved[1], force, block.velocities), axis=1)
        self._store(block.positions, motion)

    def _store(self, positions: Floats, motion: Floats) -> None:
        """Store the next points: positions of the rigid arm (n, 3), and the other columns of the rows (n, 12)."""
        count = len(motion)
        begin = self._newest + 1 - self._oldest
        if begin + count > len(self._rows):  # keep the newer half
            self._rows[:_KEPT] = self._rows[begin - _KEPT : begin]
            self._oldest, begin = self._newest + 1 - _KEPT, _KEPT
        self._rows[begin : begin + count, :12] = motion
        self._rows[begin : begin + count, 12:] = positions
        self._newest += count
        self._contact.keep()
