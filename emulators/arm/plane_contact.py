"""Motion of a compliant arm's tool against a flat surface with a linear material, one grid point after another.

The force at the end of a step is that of the law for the motion at the end of this step. For a given ratio g of
friction to sliding velocity, the step is linear in the force; g is found by the secant method, and by bisection where
that leaves the bracket. The general solution in `emulators.arm.compliant_path` gives the same motion, and takes ten
times as long.
"""

import math

import numpy as np

from emulators.arm.mode import Responses
from emulators.seams import Floats
from emulators.surface.plane_law import PlaneLaw

_TOLERANCE_N = 1e-3
"""Largest error of the friction force, N. Chosen: far below the noise of every sensor."""
_ITERATIONS = 40
_NO_FORCE = (0.0, 0.0, 0.0)


class PlaneContact:
    """Contact of the tool with a plane. Its frame has the surface's normal as its first axis."""

    def __init__(self, law: PlaneLaw, responses: Responses, compliance: Floats) -> None:
        """`compliance` is the acceleration per unit of force (3, 3), 1/kg, base frame."""
        self._law = law
        normal = np.array(law.normal)
        across = np.cross(normal, np.eye(3)[int(np.argmin(np.abs(normal)))])
        across /= math.sqrt(across @ across)
        self._frame: Floats = np.array([normal, across, np.cross(normal, across)])
        local = self._frame @ compliance @ self._frame.T
        self._compliance: tuple[tuple[float, float, float], ...] = tuple(map(tuple, local.tolist()))
        (self._keeping, begin, end) = (
            part.tolist()
            for part in (responses.free[:, 0], responses.forced[:, 0, 0], responses.forced[:, 0, 1])
        )
        self._begin, self._end = begin, end
        by_position, by_velocity = (end[k] * local for k in (0, 1))
        self._by_velocity: tuple[tuple[float, float, float], ...] = tuple(map(tuple, by_velocity.tolist()))
        self._normal_position: tuple[float, float, float] = tuple(by_position[0].tolist())
        self._relief: tuple[float, float, float] = tuple(
            (law.stiffness * by_position[0] + law.damping * by_velocity[0]).tolist()
        )
        """Decrease of the normal force per unit of each component of the force at the end of a step."""
        self._ratio = self._change = 0.0
        """Ratio of friction to sliding velocity at the end of the newest step, N·s/m, and its change in that step. The
        next ratio is searched from their sum.
        """

    def is_free(self, positions: Floats) -> bool:
        """Return whether the tool touches the surface at none of these positions (n, 3), m, base frame."""
        return bool((positions @ self._frame[0]).min() >= self._law.depth_of_origin)

    def forces(self, positions: Floats, velocities: Floats) -> Floats:
        """Return the contact force (n, 3) at the grid points, base frame, N.

        `positions` and `velocities` (n, 3) are those of the tool if no force acted at these points, base frame.
        """
        frame, origin = self._frame, self._law.depth_of_origin
        (m00, m01), (m10, m11) = self._keeping
        (b0, b1), (e0, e1) = self._begin, self._end
        (c00, c01, c02), (c10, c11, c12), (c20, c21, c22) = self._compliance
        # offset d, its rate v and acceleration a, due to the forces at these points
        d0 = d1 = d2 = v0 = v1 = v2 = a0 = a1 = a2 = 0.0
        ratio, change = self._ratio, self._change
        forces = []
        for x, (u0, u1, u2) in zip(
            (positions @ frame[0]).tolist(), (velocities @ frame.T).tolist(), strict=True
        ):
            d0, v0 = m00 * d0 + m01 * v0 + b0 * a0, m10 * d0 + m11 * v0 + b1 * a0
            d1, v1 = m00 * d1 + m01 * v1 + b0 * a1, m10 * d1 + m11 * v1 + b1 * a1
            d2, v2 = m00 * d2 + m01 * v2 + b0 * a2, m10 * d2 + m11 * v2 + b1 * a2
            depth = origin - x - d0
            before = ratio
            if depth > 0.0:
                force, ratio = self._force(depth, (u0 + v0, u1 + v1, u2 + v2), ratio + change)
            else:
                force, ratio = _NO_FORCE, 0.0
            change = ratio - before if before > 0.0 else 0.0
            f0, f1, f2 = force
            a0 = c00 * f0 + c01 * f1 + c02 * f2
            a1 = c10 * f0 + c11 * f1 + c12 * f2
            a2 = c20 * f0 + c21 * f1 + c22 * f2
            d0, v0, d1, v1, d2, v2 = (
                d0 + e0 * a0,
                v0 + e1 * a0,
                d1 + e0 * a1,
                v1 + e1 * a1,
                d2 + e0 * a2,
                v2 + e1 * a2,
            )
            forces.append(force)
        self._ratio, self._change = ratio, change
        return np.array(forces) @ frame

    def _force(
        self, depth: float, velocity: tuple[float, float, float], ratio: float
    ) -> tuple[tuple[float, float, float], float]:
        """Return the force at the end of a step, N, and the ratio of friction to sliding velocity, N·s/m.

        Depth, m, and velocity, m/s, are those without this force. The search begins at `ratio`.
        """
        law, r0 = self._law, self._relief[0]
        normal = law.stiffness * depth - law.damping * velocity[0]
        if normal <= 0.0:
            return _NO_FORCE, 0.0
        if ratio <= 0.0:
            ratio = law.friction * normal / ((1.0 + r0) * math.hypot(velocity[1], velocity[2], law.smoothing))
        before = error_before = low = 0.0
        high = math.inf
        f0, f1, f2 = normal / (1.0 + r0), 0.0, 0.0
        for k in range(_ITERATIONS if ratio > 0.0 else 0):
            f0, f1, f2 = self._with_ratio(normal, velocity, ratio)
            speed = math.hypot(f1, f2) / ratio
            error = law.friction * max(f0, 0.0) / math.hypot(speed, law.smoothing) - ratio
            if abs(error) * speed <= _TOLERANCE_N:
                break
            low, high = (ratio, high) if error > 0.0 else (low, ratio)
            step = error
            if k and error != error_before:
                step *= (ratio - before) / (error_before - error)
            before, error_before = ratio, error
            ratio += step
            if not low < ratio < high:
                ratio = before + error if high == math.inf else 0.5 * (low + high)
        if f0 <= 0.0:
            return _NO_FORCE, 0.0
        p0, p1, p2 = self._normal_position
        raised = p0 * f0 + p1 * f1 + p2 * f2
        if raised > depth:  # the damper alone must not push the tool out
            share = depth / raised
            f0, f1, f2 = share * f0, share * f1, share * f2
        return (f0, f1, f2), ratio

    def _with_ratio(
        self, normal: float, velocity: tuple[float, float, float], ratio: float
    ) -> tuple[float, float, float]:
        """Return the force for a given ratio of friction to sliding velocity, N."""
        _, (e10, e11, e12), (e20, e21, e22) = self._by_velocity
        r0, r1, r2 = self._relief
        # 3 equations: (1 + r0) f0 + r1 f1 + r2 f2 = normal, and f_i + ratio (E f)_i = -ratio u_i for i = 1, 2
        a11, a12, a21, a22 = 1.0 + ratio * e11, ratio * e12, ratio * e21, 1.0 + ratio * e22
        determinant = a11 * a22 - a12 * a21
        u1, u2 = -ratio * velocity[1], -ratio * velocity[2]
        # f1 = c1 - s1 f0 and f2 = c2 - s2 f0
        c1, c2 = (a22 * u1 - a12 * u2) / determinant, (a11 * u2 - a21 * u1) / determinant
        g1, g2 = ratio * e10, ratio * e20
        s1, s2 = (a22 * g1 - a12 * g2) / determinant, (a11 * g2 - a21 * g1) / determinant
        f0 = (normal - r1 * c1 - r2 * c2) / (1.0 + r0 - r1 * s1 - r2 * s2)
        return f0, c1 - s1 * f0, c2 - s2 * f0
