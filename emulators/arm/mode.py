"""Mode of oscillation of a compliant arm's tool, and its responses on a grid of points in time."""

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from emulators.seams import Floats

POINTS = 128
"""Largest number of grid points solved at once. Chosen."""


class Mode(NamedTuple):
    """Mode of oscillation."""

    frequency_hz: float
    damping_ratio: float

    def transition(self, duration: Floats) -> tuple[Floats, Floats]:
        """Return the transition matrices of deflection and velocity (2, 2, n) over durations (n,), s.

        It also returns the response (2, n) of deflection and velocity to a constant acceleration of 1.
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


class Responses(NamedTuple):
    """Responses of deflection and velocity at the n grid points after the current point."""

    free: Floats
    """Response to the current deflection and velocity, (2, n, 2)."""
    forced: Floats
    """Response to an acceleration at each point, linear between points, (2, n, n + 1)."""
    jumped: Floats
    """Response to a jump of the velocity at each point, from the current point on, (2, n, n)."""
    settled: Floats
    """Response to an acceleration that is constant from the current point on, (2, n)."""
    step: float
    """Time between two points, s."""

    def without_contact(self, points: int) -> Floats:
        """Return the matrix (2, points, points + 4) of the motion if no force acts at these points.

        Its columns belong to the current deflection and velocity, the acceleration at the current point due to a force
        that falls to zero until the next point, the constant acceleration, and the jump of the velocity at each point.
        """
        return np.concatenate(
            (
                self.free[:, :points],
                self.forced[:, :points, :1],
                self.settled[:, :points, None],
                -self.jumped[:, :points, :points],
            ),
            axis=2,
        )

    def joined(self, points: int, by_position: Floats, by_velocity: Floats) -> Floats:
        """Return the matrix (3 n, 3 n) that maps the error of a force to its correction, for a linear contact.

        `by_position` and `by_velocity` (3, 3) are the slopes of the contact times the compliance. The upper left
        corner of the matrix applies to fewer points.
        """
        forced = self.forced[:, :points, 1 : points + 1]
        coupling = coupling_matrix(forced, by_position[None], by_velocity[None])
        return np.array(np.linalg.inv(coupling), np.float64)


@lru_cache(maxsize=8)
def responses(mode: Mode, step: float) -> Responses:
    """Return the responses at the maximum number of points that are solved at once."""
    points = POINTS
    matrices, held_1 = mode.transition(np.array([step]))
    matrix, held = matrices[:, :, 0], held_1[:, 0]
    inverse = np.linalg.inv(
        np.array([[0.0, 1.0], [-mode.stiffness, -2.0 * mode.damping_ratio * mode.stiffness**0.5]])
    )
    end = inverse @ (held - np.array([0.0, step])) / step
    """Part of the response to the acceleration at the end of a step; the remainder is the response to the
    acceleration at its start.
    """
    begin = held - end
    free, forced, jumped = (
        np.zeros((points, 2, 2)),
        np.zeros((2, points, points + 1)),
        np.zeros((2, points, points)),
    )
    settled, power, total = np.zeros((2, points)), np.eye(2), np.zeros(2)
    for gap in range(points):
        rows = np.arange(gap, points)
        forced[:, rows, rows - gap] += (power @ begin)[:, None]
        forced[:, rows, rows - gap + 1] += (power @ end)[:, None]
        total = total + power @ held
        power = matrix @ power
        jumped[:, rows, rows - gap] = power[:, 1, None]
        free[gap], settled[:, gap] = power, total
    return Responses(free.transpose(1, 0, 2), forced, jumped, settled, step)


def coupling_matrix(forced: Floats, by_position: Floats, by_velocity: Floats) -> Floats:
    """Return the matrix (3 n, 3 n) that maps a change of the force to the error that the change removes.

    `by_position` and `by_velocity` (n or 1, 3, 3) are the slopes of the contact times the compliance.
    """
    count = forced.shape[1]
    matrix = np.zeros((count, 3, count, 3))
    for slope, response in zip((by_position, by_velocity), forced, strict=True):
        matrix -= slope[:, :, None, :] * response[:, None, :, None]
    matrix += np.eye(3 * count).reshape(matrix.shape)
    return matrix.reshape(3 * count, 3 * count)


class Block(NamedTuple):
    """Grid points that are solved together."""

    base: Floats
    """Deflection and velocity (2, n, 3) if no contact force acts at these points."""
    forced: Floats
    """Response (2, n, n) to the acceleration at each point."""
    compliance: Floats
    """Acceleration per unit of force (3, 3), 1/kg."""
    times: Floats
    """Times of the points (n,), s."""
    positions: Floats
    """Positions of the rigid arm (n, 3), m."""
    velocities: Floats
    """Mean velocities of the rigid arm since the point before (n, 3), m/s."""

    def first(self, points: int) -> "Block":
        """Return a block with only the first points of this block."""
        base, forced, compliance, *motion = self
        return Block(
            base[:, :points], forced[:, :points, :points], compliance, *(part[:points] for part in motion)
        )

    def response(self, force: Floats) -> Floats:
        """Return deflection and velocity (2, n, 3) for a contact force (n, 3)."""
        return self.base + self.forced @ (force @ self.compliance.T)

    def newton_step(self, error: Floats, slopes: tuple[Floats, Floats]) -> Floats:
        """Return the change of the contact force (n, 3) that removes its error (n, 3)."""
        flat = coupling_matrix(self.forced, slopes[0] @ self.compliance, slopes[1] @ self.compliance)
        return np.array(np.linalg.solve(flat, error.ravel()), np.float64).reshape(error.shape)
