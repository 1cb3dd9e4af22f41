"""Motion of a compliant arm's tool against a flat surface with a linear material, one grid point after another.

The force at the end of a step is that of the law for the motion at the end of this step. For a given ratio g of
friction to sliding velocity, the step is linear in the force; g is found by the secant method, and by bisection where
that leaves the bracket. The general solution in `emulators.arm.compliant_path` gives the same motion, and takes ten
times as long. Above the surface, a step has no force. The steps are computed in Python, because a robot's cycle has few
of them.
"""

import math
from collections.abc import Sequence
from typing import TypeAlias

import numpy as np

from emulators.arm.mode import Responses
from emulators.seams import Floats
from emulators.surface.plane_law import PlaneLaw

_TOLERANCE_N = 1e-3
"""Largest error of the friction force, N. Chosen: far below the noise of every sensor."""
_ITERATIONS = 40
_NO_FORCE = (0.0, 0.0, 0.0)


_Triple: TypeAlias = tuple[float, float, float]


class PlaneContact:
    """Motion of the tool above and against a plane. Its frame has the surface's normal as its first axis."""

    def __init__(self, law: PlaneLaw, responses: Responses, compliance: Floats, sag: Floats) -> None:
        """`compliance` is the acceleration per unit of force (3, 3), 1/kg, and `sag` the deflection (3,) by the weight
        of the tool, m, both in the base frame.
        """
        self._law, self._step = law, responses.step
        normal = np.array(law.normal)
        across = np.cross(normal, np.eye(3)[int(np.argmin(np.abs(normal)))])
        across /= math.sqrt(across @ across)
        self._frame: Floats = np.array([normal, across, np.cross(normal, across)])
        local = self._frame @ compliance @ self._frame.T
        self._compliance: tuple[_Triple, ...] = tuple(map(tuple, local.tolist()))
        self._sag: _Triple = tuple((self._frame @ sag).tolist())
        (self._keeping, begin, end) = (
            part.tolist()
            for part in (responses.free[:, 0], responses.forced[:, 0, 0], responses.forced[:, 0, 1])
        )
        self._begin, self._end = begin, end
        by_position, by_velocity = (end[k] * local for k in (0, 1))
        self._by_velocity: tuple[_Triple, ...] = tuple(map(tuple, by_velocity.tolist()))
        self._normal_position: _Triple = tuple(by_position[0].tolist())
        self._relief: _Triple = tuple(
            (law.stiffness * by_position[0] + law.damping * by_velocity[0]).tolist()
        )
        """Decrease of the normal force per unit of each component of the force at the end of a step."""
        self._ratio = self._change = 0.0
        """Ratio of friction to sliding velocity at the end of the newest step, N·s/m, and its change in that step. The
        next ratio is searched from their sum.
        """

    def motion(self, start: Floats, positions: Floats) -> Floats:
        """Return the motion (n, 12) at n grid points: deflection, its velocity, contact force and velocity of the arm.

        `positions` (n, 3) are those of the rigid arm at these points. `start` (15,) contains the motion and the
        position at the point before. All are in the base frame.
        """
        frame, step, (g0, g1, g2) = self._frame, self._step, self._sag
        (m00, m01), (m10, m11) = self._keeping
        (b0, b1), (e0, e1) = self._begin, self._end
        local = np.concatenate((start.reshape(5, 3), positions)) @ frame.T
        (d0, d1, d2), (v0, v1, v2), force, (u0, u1, u2), (p0, p1, p2), *places = local.tolist()
        # The weight only shifts the deflection d, so the motion is computed relative to the sag.
        d0, d1, d2, origin = d0 - g0, d1 - g1, d2 - g2, self._law.depth_of_origin - g0
        a0, a1, a2 = self._acceleration(force)
        rows = []
        for q0, q1, q2 in places:
            w0, w1, w2 = (q0 - p0) / step, (q1 - p1) / step, (q2 - p2) / step
            # Where the velocity of the arm jumps, that of the tool does not.
            v0, v1, v2 = v0 + u0 - w0, v1 + u1 - w1, v2 + u2 - w2
            d0, v0 = m00 * d0 + m01 * v0 + b0 * a0, m10 * d0 + m11 * v0 + b1 * a0
            d1, v1 = m00 * d1 + m01 * v1 + b0 * a1, m10 * d1 + m11 * v1 + b1 * a1
            d2, v2 = m00 * d2 + m01 * v2 + b0 * a2, m10 * d2 + m11 * v2 + b1 * a2
            depth = origin - q0 - d0
            if depth > 0.0:
                f0, f1, f2 = self._next_force(depth, (w0 + v0, w1 + v1, w2 + v2))
                a0, a1, a2 = self._acceleration((f0, f1, f2))
                d0, d1, d2 = d0 + e0 * a0, d1 + e0 * a1, d2 + e0 * a2
                v0, v1, v2 = v0 + e1 * a0, v1 + e1 * a1, v2 + e1 * a2
            else:
                self._ratio = self._change = f0 = f1 = f2 = a0 = a1 = a2 = 0.0
            rows.append((d0 + g0, d1 + g1, d2 + g2, v0, v1, v2, f0, f1, f2, w0, w1, w2))
            p0, p1, p2, u0, u1, u2 = q0, q1, q2, w0, w1, w2
        motion: Floats = np.array(rows).reshape(-1, 3) @ frame
        return motion.reshape(-1, 12)

    def _acceleration(self, force: Sequence[float]) -> _Triple:
        """Return the acceleration by a force, m/s²."""
        f0, f1, f2 = force
        (c00, c01, c02), (c10, c11, c12), (c20, c21, c22) = self._compliance
        return (
            c00 * f0 + c01 * f1 + c02 * f2,
            c10 * f0 + c11 * f1 + c12 * f2,
            c20 * f0 + c21 * f1 + c22 * f2,
        )

    def _next_force(self, depth: float, velocity: _Triple) -> _Triple:
        """Return the force at the end of the next step, N.

        Depth, m, and velocity, m/s, are those without this force.
        """
        before = self._ratio
        force, self._ratio = self._force(depth, velocity, before + self._change)
        self._change = self._ratio - before if before > 0.0 else 0.0
        return force

    def _force(self, depth: float, velocity: _Triple, ratio: float) -> tuple[_Triple, float]:
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

    def _with_ratio(self, normal: float, velocity: _Triple, ratio: float) -> _Triple:
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
