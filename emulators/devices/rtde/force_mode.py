"""Force mode and freedrive: the tool's compliant axes follow the force on it, and the other axes follow the
program's motion.

Source of all meanings: Universal Robots' script manual, `force_mode` and its settings. The desired force acts from
the tool on its surroundings; the force on the tool is actual_TCP_force, as a program reads it.

The maker publishes no control law. This one is derived from recordings of a UR10e at a damping of 0 with 15 to 55 N
on a work piece: S. Gadringer, H. Gattringer, A. Mueller, "Assessment of force control for surface finishing", Mech.
Sci. 13 (2022) 361, doi:10.5194/ms-13-361-2022, with their plots in
JKU-Linz-Institute-of-Robotics/ur10e_force_control_comparison on GitHub.

- Without a contact, an axis accelerates as a mass of 65 kg divided by the gain scaling: 0.13 m/s² for 15 N at a
  scaling of 0.5, 0.23 m/s² at 1, and 0.28 m/s² for 35 N at 0.5. At 0.2 m/s, it still accelerates.
- In contact, it also loses speed with a time constant of 50 ms. If this law receives the recorded force with a delay
  of 20 ms, its speed from 0.08 to 1.5 s after the impact differs from the recorded one by 0.3 (15 N at a scaling of 1),
  0.5 (35 N) and 0.6 (55 N) of that speed's root mean square, and by 0.85 for 15 N at 0.5. Without that loss, it
  differs by 2.4 to 17 times that speed.

The forces of this law then settle within 0.6 to 0.7 s on 50 kN/m at a scaling of 1, those of the recordings within
0.58 to 0.86 s. At 15 N and a scaling of 0.5, the real arm bounced twice and took 2 s, which this law does not
reproduce.

In addition, an axis loses the share `damping` of its speed in each cycle: without a force, it keeps its speed at 0, as
in the manual. Assumed: the law holds for moments, and for other arms.

So an axis hits a rigid body at speed and bounces before it holds the force; it oscillates if the body is stiff and
the gain high. Universal Robots' forum reports both of a UR10e with 10 N on wood (thread 22537).
"""

import math
from typing import NamedTuple

from emulators.devices.rtde.kinematics import Arm, Joints, compose, invert, nearest
from protocol.devices.rtde.fields import Value
from protocol.geometry import (
    Pose,
    Quaternion,
    Vector,
    Wrench,
    inverse,
    product,
    rotate,
    rotation_vector,
    turn_by,
)

_POINT_LEAST = 0.01
"""Minimum distance of the tool from the origin of a frame of type 1, m. Source: Universal Robots' user manual."""
_MOTION_LEAST = 1e-3
"""Tool speed in the plane below which a frame of type 3 does not turn, m/s. Assumed."""
_CONTACT_N = 3.0
"""Force along an axis from which it is in contact, N; for a moment, a tenth of this value in N·m. It is half the
desired force if that is less. Chosen: above the noise of the force.
"""


class Admittance(NamedTuple):
    """Response of compliant axes to a force."""

    gain: float
    """Speed along an axis per force, m/s/N."""
    turn_gain: float
    """Angular speed about an axis per moment, rad/s/(N·m)."""
    damping: float
    """Share of its speed that an axis loses in each cycle."""
    least_n: float
    """Dead band for axes without a desired force, N. For a moment, the dead band in N·m is a tenth of this value."""
    lag_s: float = 0.0
    """Time constant with which an axis in contact reaches the speed gain · force, s; 0: it has that speed at once."""


class ForceTask(NamedTuple):
    """Arguments of a force_mode() call."""

    frame: Pose
    """Task frame in the base frame."""
    compliant: tuple[bool, ...]
    """Whether each axis of the frame is compliant: along x, y, z, about x, y, z."""
    wrench: Wrench
    """Desired wrench of the tool on its surroundings, N and N·m, in axes of the frame."""
    kind: int
    """Type of the frame. 1: y points from the tool to the frame's origin; 2: the frame is used as given; 3: x is
    the tool's direction of motion in the x-y plane.
    """
    limits: tuple[float, ...]
    """Maximum speed of each compliant axis, m/s or rad/s. For other axes, the maximum deviation, which is never
    reached; see `step`.
    """


class Steered(NamedTuple):
    """Motion that the program commands in one cycle, before a force changes it."""

    old: Pose
    """Pose of the tool at the start of the cycle."""
    planned: Pose
    """Pose that the program commands for the end of the cycle."""
    placed: bool
    """Whether the program commands positions of a path rather than speeds. The positions do not depend on the
    force's effect on the arm.
    """


class Motion(NamedTuple):
    """Motion of the arm in one cycle of force mode."""

    path: Joints
    """Joint angles that the program's motion along the other axes alone would reach."""
    joints: Joints


class ForceMode:
    """Active force mode, computed in each cycle."""

    def __init__(self, task: ForceTask, period: float) -> None:
        """Start force mode. `period` is the cycle time, s."""
        self.task = task
        self._period = period
        self._speeds = [0.0] * 6
        """Speeds of the compliant axes, in the axes of the task frame."""
        self._motion_turn: Quaternion | None = None
        """Last frame of type 3 in which the tool moved."""
        self._placed: Pose | None = None
        """Pose that the program commanded for the end of the last cycle of a path."""

    def change(self, task: ForceTask) -> None:
        """Change the arguments of an active force mode. The speeds are kept."""
        self.task = task

    def rest(self) -> None:
        """Set the speeds of the compliant axes to 0, because the arm brakes or is stationary."""
        self._speeds = [0.0] * 6

    def step(self, admittance: Admittance, steered: Steered, wrench: Wrench) -> tuple[Pose, Pose]:
        """Return two poses of the tool at the end of the cycle: after the program's motion alone, and after the
        force's motion as well.

        `wrench` acts on the tool, in base axes, with moments about the tool. The program's motion along compliant
        axes has no effect (assumed). This arm does not yield along the other axes, so they follow the program's
        path exactly.
        """
        task, dt = self.task, self._period
        old, planned, placed = steered
        begin = self._placed if placed and self._placed is not None else old
        self._placed = planned if placed else None
        turn = self._turn(old, [(b - a) / dt for a, b in zip(begin.position, planned.position, strict=True)])
        if turn is None:
            self.rest()
            return planned, planned
        back = inverse(turn)
        place = rotate(back, [b - a for a, b in zip(old.position, planned.position, strict=True)])
        angles = rotate(back, rotation_vector(product(planned.quaternion, inverse(old.quaternion))))
        force = (*rotate(back, wrench[:3]), *rotate(back, wrench[3:]))
        path, total = [], []
        for axis, step in enumerate((*place, *angles)):
            if not task.compliant[axis]:
                self._speeds[axis] = 0.0
                path.append(step)
                total.append(step)
                continue
            self._speeds[axis] = speed = self._speed(admittance, axis, force[axis])
            path.append(0.0)
            total.append(speed * dt)
        return _moved(old, turn, path), _moved(old, turn, total)

    def _speed(self, admittance: Admittance, axis: int, force: float) -> float:
        turns = axis >= 3
        unit = 0.1 if turns else 1.0
        desired, limit = self.task.wrench[axis], abs(self.task.limits[axis])
        speed = self._speeds[axis] * (1.0 - admittance.damping)
        if desired != 0.0 or abs(force) >= admittance.least_n * unit:
            drive = (admittance.turn_gain if turns else admittance.gain) * (desired + force)
            lag = admittance.lag_s
            if lag == 0.0:
                speed = drive
            elif abs(force) >= min(_CONTACT_N * unit, 0.5 * abs(desired)):
                speed += (drive - speed) * (1.0 - math.exp(-self._period / lag))
            else:
                speed += drive * self._period / lag
        return min(max(speed, -limit), limit)

    def _turn(self, old: Pose, motion: list[float]) -> Quaternion | None:
        """Return the current axes of the task frame in the base frame; None if no axis is compliant.

        The motion, m/s, is the program's motion. The motion of a compliant axis would turn a frame of type 3
        (assumed).
        """
        frame = self.task.frame
        if self.task.kind == 1:
            return _point_y_axis(frame, old.position)
        if self.task.kind == 3:
            x, y, _ = rotate(inverse(frame.quaternion), motion)
            if math.hypot(x, y) > _MOTION_LEAST:
                about_z = turn_by((0.0, 0.0, math.atan2(y, x)))
                self._motion_turn = product(frame.quaternion, about_z)
            return self._motion_turn
        return frame.quaternion


def _point_y_axis(frame: Pose, place: Vector) -> Quaternion | None:
    """Return the frame after the smallest rotation that points its y axis from a position to its origin."""
    to_origin = [a - b for a, b in zip(frame.position, place, strict=True)]
    length = math.hypot(*to_origin)
    if length < _POINT_LEAST:
        return None
    x, y, z = (part / length for part in to_origin)
    a, b, c = rotate(frame.quaternion, (0.0, 1.0, 0.0))
    axis = (b * z - c * y, c * x - a * z, a * y - b * x)
    sine, cosine = math.hypot(*axis), a * x + b * y + c * z
    if sine < 1e-9:
        if cosine > 0.0:
            return frame.quaternion
        return product(frame.quaternion, turn_by((math.pi, 0.0, 0.0)))
    angle = math.atan2(sine, cosine) / sine
    return product(turn_by([part * angle for part in axis]), frame.quaternion)


def _moved(old: Pose, turn: Quaternion, step: list[float]) -> Pose:
    """Return a pose after a step along and about the axes of a frame. The rotation is about the tool."""
    x, y, z = (a + b for a, b in zip(old.position, rotate(turn, step[:3]), strict=True))
    return Pose((x, y, z), product(turn_by(rotate(turn, step[3:])), old.quaternion))


def external_wrench(given: Value | None, turn: Quaternion, tool: Pose) -> Wrench:
    """Return a client's wrench in base axes, with moments about the tool, N and N·m. It is zero if the client sends
    none.

    `given` is in axes of the flange, whose orientation is `turn`, with moments about the flange.
    """
    if not isinstance(given, tuple):
        return (0.0,) * 6
    wrench = (*rotate(turn, given[:3]), *rotate(turn, given[3:]))
    return about_tool(wrench, rotate(turn, tool.position))


def about_tool(wrench: Wrench, arm: Vector) -> Wrench:
    """Convert a wrench with moments about the flange to moments about the tool. `arm` is the vector from flange to
    tool, in base axes.
    """
    (a, b, c, u, v, w), (x, y, z) = wrench, arm
    return a, b, c, u - (y * c - z * b), v - (z * a - x * c), w - (x * b - y * a)


def solve_motion(arm: Arm, tcp: Pose, poses: tuple[Pose, Pose], near: Joints) -> Motion | None:
    """Return the joint angles of both poses of a step; None if either has no solution. `tcp` is the tool in the
    flange frame.
    """
    back = invert(tcp)
    path, total = (nearest(arm, compose(pose, back), near) for pose in poses)
    return None if path is None or total is None else Motion(path, total)
