"""Path of a compliant arm's tool: the path that the encoders see, and the deflection by contact, weight and motion.

The tool is a mass on the arm's compliance, with one natural frequency and damping ratio in all directions:

    d'' + 2 ζ ω d' + ω² (d - C F) = -p''

where d is the deflection, p the path of the rigid arm, C the compliance and F the force of contact and weight. The
effective mass (ω² C)⁻¹ makes the deflection by a constant force C F, and contact, spring and damper never add energy.

The equation is integrated on a fixed grid of time, exactly for a force that is linear between two points of the grid.
A block of points is solved at once, by Newton's method where the surface is touched. So what is read does not depend
on when it is read, to within the tolerance of that method; behind the newest point the force counts as constant.
"""

import math
from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from emulators.seams import ArmPath, Floats
from protocol.geometry import Quaternion

STEP_S = 1.0 / 2000
"""Chosen: the grid. A contact of 100 kN/m on a mass of 1 kg oscillates at 50 Hz, with 40 points a period."""
_POINTS, _FEW_POINTS = 32, 16
"""Chosen: points solved at once, and where contact begins, ends or changes."""
_ITERATIONS = 20
_TOLERANCE_N = 1e-5
"""Chosen: far below the noise of every sensor."""
_CONTRACTION = 0.6
"""Chosen: where an iteration leaves more of the error, the contact is linearised again."""
_POSITION_STEP_M, _VELOCITY_STEP_M_S = 1e-8, 1e-6
"""Chosen: steps of the difference quotients of a surface's force."""
_SHIFTS = np.zeros((7, 2, 3))
"""Position and velocity of a sample and of its six neighbours."""
_SHIFTS[1:4, 0] = _POSITION_STEP_M * np.eye(3)
_SHIFTS[4:7, 1] = _VELOCITY_STEP_M_S * np.eye(3)
_KEPT = 24_000
"""Chosen: points that are kept, more than the ten seconds of an arm's path at the finest grid use at once."""
_NEAR_M = 2e-3
"""Chosen: the compliance is computed again where the tool has moved so far."""
_GAP_S = 5.0
"""Chosen: after a longer time without a reader the tool starts again from its equilibrium."""


def _forget() -> None:
    """Nothing is remembered."""


class Contact(NamedTuple):
    """What touches the tool."""

    force: Callable[[Floats, Floats, Floats], Floats]
    """Force (n, 3), N, base frame, at ascending times (n,), s, for positions and velocities (n, 3) of the tool. They
    follow those that were kept last; asked again, it answers the same.
    """
    keep: Callable[[], object] = _forget
    """Called when the motion that was asked about last has been accepted."""


class Bearing(NamedTuple):
    """What carries the tool: the compliance where it is, and what its own weight does there."""

    compliance: Floats
    """Of the tool (6, 6), base frame: translation, m, and rotation, rad, by a wrench about the tip, N and N·m."""
    sag: Floats
    """Deflection (6,) by the weight of the tool, m and rad."""


class Mode(NamedTuple):
    """One mode of oscillation."""

    frequency_hz: float
    damping_ratio: float

    def transition(self, duration: Floats) -> tuple[Floats, Floats]:
        """Return the transition of deflection and velocity (2, 2, n) over a duration (n,), s, and their response
        (2, n) to a constant acceleration of 1.
        """
        omega = 2.0 * math.pi * self.frequency_hz
        decay = self.damping_ratio * omega
        damped = omega * math.sqrt(1.0 - self.damping_ratio**2)
        envelope = np.exp(-decay * duration)
        cosine, sine = envelope * np.cos(damped * duration), envelope * np.sin(damped * duration) / damped
        first, second = cosine + decay * sine, cosine - decay * sine
        matrix = np.array([[first, sine], [-(omega**2) * sine, second]])
        return matrix, np.array([(1.0 - first) / omega**2, sine])

    @property
    def stiffness(self) -> float:
        """Square of the angular frequency, 1/s²."""
        return (2.0 * math.pi * self.frequency_hz) ** 2


class Grid(NamedTuple):
    """The grid of time on which the motion is integrated."""

    powered_at: float
    """Its begin, s, with the tool in equilibrium."""
    step: float = STEP_S
    """s; shorter for a surface with memory, which has to see as many samples as the sensor."""


class _Responses(NamedTuple):
    """Responses of deflection and velocity at n points of the grid behind the present one."""

    free: Floats
    """To deflection and velocity now, (2, n, 2)."""
    forced: Floats
    """To an acceleration at each point, linear in between, (2, n, n + 1)."""
    held: Floats
    """To an acceleration that is constant between two points, (2, n, n)."""
    settled: Floats
    """To an acceleration that is the same from the present point on, (2, n)."""

    def joined(self, by_position: Floats, by_velocity: Floats, compliance: Floats) -> Floats:
        """Return the inverse (3 n, 3 n) that removes the error of a force, for one linear contact of these slopes
        (3, 3). Its part for fewer points is its corner.
        """
        slopes = (by_position @ compliance)[None], (by_velocity @ compliance)[None]
        return np.array(np.linalg.inv(_coupled(self.forced[:, :, 1:], *slopes)), np.float64)


@lru_cache(maxsize=8)
def _responses(mode: Mode, step: float) -> _Responses:
    """Return the responses at the most points that are solved at once."""
    points = _POINTS
    matrices, held_1 = mode.transition(np.array([step]))
    matrix, held = matrices[:, :, 0], held_1[:, 0]
    inverse = np.linalg.inv(
        np.array([[0.0, 1.0], [-mode.stiffness, -2.0 * mode.damping_ratio * mode.stiffness**0.5]])
    )
    end = inverse @ (held - np.array([0.0, step])) / step
    """Part of the response to the acceleration at the end of a step; the rest is that to the one at its begin."""
    begin = held - end
    free, forced, constant = (
        np.zeros((points, 2, 2)),
        np.zeros((2, points, points + 1)),
        np.zeros((2, points, points)),
    )
    power = np.eye(2)
    for gap in range(points):
        rows = np.arange(gap, points)
        forced[:, rows, rows - gap] += (power @ begin)[:, None]
        forced[:, rows, rows - gap + 1] += (power @ end)[:, None]
        constant[:, rows, rows - gap] = (power @ held)[:, None]
        power = matrix @ power
        free[gap] = power
    return _Responses(free.transpose(1, 0, 2), forced, constant, constant.sum(axis=2))


def _unread(time: float) -> None:
    """No reader has looked ahead."""


class CompliantPath:
    """The true path of the tool of a compliant arm: an `ArmPath` around that of the arm."""

    def __init__(
        self, path: ArmPath, mode: Mode, bearing: Callable[[float], Bearing], contact: Contact, grid: Grid
    ) -> None:
        """`bearing` is asked for a time, s, and answers for the rigid arm's pose of that time."""
        step = grid.step
        self._path, self._mode, self._bearing_at, self._contact = path, mode, bearing, contact
        self._step, self._remembers = step, step < STEP_S
        self._responses = _responses(mode, step)
        self.on_change: Callable[[float], object] = _unread
        """Called with the time, s, from which on the path is another than it could be read."""
        path.on_change = self._moved_otherwise
        self._bearing: Bearing | None = None
        self._borne_at = np.full(3, math.inf)
        self._rows = np.zeros((_KEPT, 12))
        """By point of the grid: deflection, its velocity, force of the contact, and velocity of the rigid arm."""
        self._linear: Floats | None = None
        """The contact that was last linearised."""
        self._oldest = self._newest = 0
        """Points of the grid that are known; none before the first reader."""
        self._begun, self._powered_at = False, grid.powered_at

    # --- as a path

    def advance(self, now: float) -> None:
        """As `ArmPath.advance`."""
        self._path.advance(now)

    def committed_until(self, now: float) -> float:
        """As `ArmPath.committed_until`."""
        return self._path.committed_until(now)

    def predicted_until(self, now: float) -> float:
        """As `ArmPath.predicted_until`."""
        return self._path.predicted_until(now)

    def orientations(self, times: Floats) -> list[tuple[slice, Quaternion]]:
        """As `ArmPath.orientations`: of the rigid arm. The rotation by the compliance is that of `rotations`."""
        return self._path.orientations(times)

    def trajectory(self, times: Floats) -> tuple[Floats, Floats]:
        """As `ArmPath.trajectory`."""
        self._extend(float(times[0]), float(times[-1]))
        positions, velocities = self._path.trajectory(times)
        offset, drift = self._deflection(times, velocities)
        return positions + offset, velocities + drift

    def rotations(self, times: Floats) -> Floats:
        """Return the rotation of the tool by contact and weight (n, 3), rad, base frame, at ascending times (n,), s."""
        self._extend(float(times[0]), float(times[-1]))
        bearing = self._bearing
        assert bearing is not None, "the path has begun"
        points = np.clip(np.round(times / self._step).astype(int), self._oldest, self._newest)
        rotations: Floats = self._rows[points % _KEPT, 6:9] @ bearing.compliance[3:, :3].T + bearing.sag[3:]
        return rotations

    def rewind(self, time: float) -> None:
        """Forget everything from this time on, s: path or surface are others."""
        self._newest = max(min(self._newest, math.floor(time / self._step)), self._oldest)

    def _moved_otherwise(self, time: float) -> None:
        self.rewind(time)
        self.on_change(time)

    # --- the deflection

    def _deflection(self, times: Floats, velocities: Floats) -> tuple[Floats, Floats]:
        """Deflection (n, 3), m, and its velocity (n, 3), m/s, for a path of these velocities at times (n,)."""
        step, rows = self._step, self._rows
        points = np.clip(np.floor(times / step).astype(int), self._oldest, self._newest)
        since = np.maximum(times - points * step, 0.0)
        here = rows[points % _KEPT]
        there = rows[np.minimum(points + 1, self._newest) % _KEPT]
        s = (since / step)[:, None]
        a, b, va, vb = here[:, :3], there[:, :3], here[:, 3:6] * step, there[:, 3:6] * step
        bend, twist = 3.0 * (b - a) - 2.0 * va - vb, 2.0 * (a - b) + va + vb
        offset = a + s * (va + s * (bend + s * twist))
        drift = (va + s * (2.0 * bend + 3.0 * s * twist)) / step
        ahead = np.flatnonzero(points >= self._newest)
        if len(ahead):
            newest, duration, bearing = rows[self._newest % _KEPT], since[ahead], self._bearing
            assert bearing is not None, "the path has begun"
            pull = self._mode.stiffness * (bearing.compliance[:3, :3] @ newest[6:9] + bearing.sag[:3])
            # a duration of nothing has no change of velocity either
            change = (velocities[ahead] - newest[9:]) / np.maximum(duration, 1e-12)[:, None]
            matrix, held = self._mode.transition(duration)
            for row, out in ((0, offset), (1, drift)):
                out[ahead] = (
                    np.outer(matrix[row, 0], newest[:3])
                    + np.outer(matrix[row, 1], newest[3:6])
                    + held[row][:, None] * (pull - change)
                )
        return offset, drift

    def _extend(self, begin: float, end: float) -> None:
        """Compute every point of the grid up to `end`, s."""
        last = math.floor(end / self._step)
        if not self._begun or last - self._newest > _GAP_S / self._step:
            last_gap = last - _GAP_S / self._step
            self._start(math.floor(max(self._powered_at / self._step, min(begin / self._step, last_gap))))
        while self._newest < last:
            point, points = self._newest, min(_POINTS, last - self._newest)
            times = np.arange(point, point + points + 1, dtype=np.float64) * self._step
            positions, velocities = self._path.trajectory(times)
            if self._newest == point:  # the arm may have felt its contact meanwhile
                self._solve(times, positions, velocities)

    def _start(self, point: int) -> None:
        """Begin in equilibrium at a point of the grid."""
        time = np.array([point * self._step])
        positions, velocities = self._path.trajectory(time)
        bearing = self._borne(float(time[0]), positions[0])
        compliance, still = bearing.compliance[:3, :3], np.zeros((1, 3))
        offset = bearing.sag[:3].copy()
        for _ in range(_ITERATIONS):
            force, (by_position, _) = self._linearised(time, positions + offset, still)
            error = compliance @ force[0] + bearing.sag[:3] - offset
            offset += np.linalg.solve(np.eye(3) - compliance @ by_position[0], error)
        force = self._contact.force(time, positions + offset, still)
        self._oldest = self._newest = point
        self._rows[point % _KEPT] = [*offset, 0.0, 0.0, 0.0, *force[0], *velocities[0]]
        self._begun = True

    def _borne(self, time: float, position: Floats) -> Bearing:
        """Return compliance and sag near a position of the rigid arm, m, which it has at a time, s."""
        if self._bearing is None or np.abs(position - self._borne_at).max() > _NEAR_M:
            self._bearing, self._borne_at = self._bearing_at(time), position
            self._linear = None
        return self._bearing

    def _solve(self, times: Floats, positions: Floats, velocities: Floats) -> None:
        """Compute the points at times[1:]; at least the first of them."""
        start = self._rows[self._newest % _KEPT]
        bearing = self._borne(float(times[0]), positions[0])
        compliance = self._mode.stiffness * bearing.compliance[:3, :3]
        sag = self._mode.stiffness * bearing.sag[:3]
        points, grid = len(times) - 1, self._responses
        state, change = start[:6].reshape(2, 3), np.diff(velocities, axis=0) / self._step
        base = grid.free[:, :points] @ state - grid.held[:, :points, :points] @ change
        base += grid.forced[:, :points, 0, None] * (compliance @ start[6:9])
        base += grid.settled[:, :points, None] * sag
        block = _Block(
            base,
            grid.forced[:, :points, 1 : points + 1],
            compliance,
            times[1:],
            positions[1:],
            velocities[1:],
        )
        if not start[6:9].any():
            force = self._contact.force(block.times, block.positions + base[0], block.velocities + base[1])
            if not force.any():
                self._note(block, base, force)
                return
        elif self._solved_as_linear(block, start[6:9]):
            return
        points = min(points, _FEW_POINTS)
        while not self._solved(block.first(points), start[6:9], points == 1):
            points = (points + 1) // 2

    def _solved_as_linear(self, block: "_Block", force: Floats) -> bool:
        """Solve a block whose contact stays nearly the same linear one; whether that converges. `force` is the last."""
        forces = np.repeat(force[None], len(block.times), axis=0)
        for linear in (self._linear, None):
            if linear is None:
                middle = slice(len(block.times) // 2, len(block.times) // 2 + 1)
                moved = block.response(forces)
                _, (by_position, by_velocity) = self._linearised(
                    block.times[middle],
                    block.positions[middle] + moved[0, middle],
                    block.velocities[middle] + moved[1, middle],
                )
                self._linear = linear = self._responses.joined(
                    by_position[0], by_velocity[0], block.compliance
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

    def _solved(self, block: "_Block", force: Floats, last: bool) -> bool:
        """Solve a block by Newton's method; whether that converges. The `last` try is kept as it is."""
        before = forces = np.repeat(force[None], len(block.times), axis=0)
        share, best, change = 1.0, math.inf, np.zeros_like(forces)
        for _ in range(_ITERATIONS):
            moved = block.response(forces)
            answer, slopes = self._linearised(
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

    def _linearised(
        self, times: Floats, positions: Floats, velocities: Floats
    ) -> tuple[Floats, tuple[Floats, Floats]]:
        """Return the force of the contact (n, 3) and its slopes by position and by velocity (n, 3, 3)."""
        if self._remembers:
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

    def _note(self, block: "_Block", moved: Floats, force: Floats) -> None:
        """Keep the points of a block: deflections and velocities (2, n, 3), forces (n, 3)."""
        count = len(force)
        rows = (self._newest + 1 + np.arange(count)) % _KEPT
        self._rows[rows] = np.concatenate((moved[0], moved[1], force, block.velocities), axis=1)
        self._newest += count
        self._oldest = max(self._oldest, self._newest - _KEPT + 1)
        self._contact.keep()


class _Block(NamedTuple):
    """Points of the grid that are solved together."""

    base: Floats
    """Deflection and velocity (2, n, 3) without a force of the contact at these points."""
    forced: Floats
    """Response (2, n, n) to the acceleration at each of them."""
    compliance: Floats
    """Acceleration by force (3, 3), 1/kg."""
    times: Floats
    """(n,), s"""
    positions: Floats
    """Of the rigid arm (n, 3), m."""
    velocities: Floats
    """Of the rigid arm (n, 3), m/s."""

    def first(self, points: int) -> "_Block":
        """Return the block of the first points."""
        base, forced, compliance, *motion = self
        return _Block(
            base[:, :points], forced[:, :points, :points], compliance, *(part[:points] for part in motion)
        )

    def response(self, force: Floats) -> Floats:
        """Return deflection and velocity (2, n, 3) for a force of the contact (n, 3)."""
        return self.base + self.forced @ (force @ self.compliance.T)

    def newton_step(self, error: Floats, slopes: tuple[Floats, Floats]) -> Floats:
        """Return the change of the force (n, 3) that removes an error (n, 3) of it."""
        flat = _coupled(self.forced, slopes[0] @ self.compliance, slopes[1] @ self.compliance)
        return np.array(np.linalg.solve(flat, error.ravel()), np.float64).reshape(error.shape)


def _coupled(forced: Floats, by_position: Floats, by_velocity: Floats) -> Floats:
    """Return the matrix (3 n, 3 n) from a change of the force to that of its error.

    `by_position` and `by_velocity` (n or 1, 3, 3) are the slopes of the contact times the compliance.
    """
    count = forced.shape[1]
    matrix = np.zeros((count, 3, count, 3))
    for slope, response in zip((by_position, by_velocity), forced, strict=True):
        matrix -= slope[:, :, None, :] * response[:, None, :, None]
    matrix += np.eye(3 * count).reshape(matrix.shape)
    return matrix.reshape(3 * count, 3 * count)
