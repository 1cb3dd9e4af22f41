"""Force mode and freedrive: compliant axes of the tool follow the force on it, all others the program's motion.

Source of all meanings: Universal Robots' script manual, `force_mode` and its settings. The maker publishes no law.
Assumed: in each cycle a compliant axis moves at gain · (force wanted + force on the tool), bounded by its limit.
The force wanted is the tool's on its surroundings; the one on the tool is actual_TCP_force, as a program reads it.
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
"""Least distance of the tool from the origin of a frame of type 1, m. Source: Universal Robots' user manual."""
_MOTION_LEAST = 1e-3
"""Assumed: a tool slower than this in the plane, m/s, turns no frame of type 3."""


class Admittance(NamedTuple):
    """How compliant axes answer a force."""

    gain: float
    """Speed along an axis for each newton, m/s/N."""
    turn_gain: float
    """Speed about an axis for each newton metre, rad/s/(N·m)."""
    damping: float
    """Share of the speed, 0 … 1, that a cycle without any force takes away."""
    least_n: float
    """A smaller force counts as none where none is wanted, N; a moment likewise, N·m for each 10 N."""


class ForceTask(NamedTuple):
    """One call of force_mode()."""

    frame: Pose
    """In the base frame."""
    compliant: tuple[bool, ...]
    """Of the axes of the frame: along x, y, z, about x, y, z."""
    wrench: Wrench
    """That the tool is to put on its surroundings, N and N·m, axes of the frame."""
    kind: int
    """1: y points from the tool to the frame's origin; 2: as it is; 3: x is the tool's motion in the x-y plane."""
    limits: tuple[float, ...]
    """Largest speed of compliant axes, m/s and rad/s. The others' largest deviation is never reached: see `step`."""


class Steered(NamedTuple):
    """The program's motion in one cycle, before a force has changed it."""

    old: Pose
    """Of the tool at the begin."""
    planned: Pose
    """At the end."""
    placed: bool
    """The program orders places of a path, whatever the force has done to the arm, and no speeds."""


class Motion(NamedTuple):
    """One cycle of the arm in force mode."""

    path: Joints
    """Joints where the program's motion along the other axes alone would lead."""
    joints: Joints


class ForceMode:
    """Force mode that is on, cycle by cycle."""

    def __init__(self, task: ForceTask, period: float) -> None:
        """`period` is the cycle, s."""
        self.task = task
        self._period = period
        self._speeds = [0.0] * 6
        """Of the compliant axes, in the frame."""
        self._motion_turn: Quaternion | None = None
        """The last frame of type 3 for which the tool moved."""
        self._placed: Pose | None = None
        """The end of the last cycle of a path, as the program ordered it."""

    def change(self, task: ForceTask) -> None:
        """Another call while it is on: the speeds continue."""
        self.task = task

    def step(self, admittance: Admittance, steered: Steered, wrench: Wrench) -> tuple[Pose, Pose]:
        """Poses of the tool at the end of the cycle: by the program's motion alone, and with the force's.

        `wrench` acts on the tool, base axes, moments about the tool. The program's motion along compliant axes has no
        effect (assumed). This arm does not yield along the others, so that they hold the program's path exactly.
        """
        task, dt = self.task, self._period
        old, planned, placed = steered
        begin = self._placed if placed and self._placed is not None else old
        self._placed = planned if placed else None
        turn = self._turn(old, [(b - a) / dt for a, b in zip(begin.position, planned.position, strict=True)])
        if turn is None:
            self._speeds = [0.0] * 6
            return planned, planned
        back = inverse(turn)
        place = rotate(back, [b - a for a, b in zip(old.position, planned.position, strict=True)])
        angles = rotate(back, rotation_vector(product(planned.quaternion, inverse(old.quaternion))))
        felt = (*rotate(back, wrench[:3]), *rotate(back, wrench[3:]))
        path, whole = [], []
        for axis, step in enumerate((*place, *angles)):
            if not task.compliant[axis]:
                self._speeds[axis] = 0.0
                path.append(step)
                whole.append(step)
                continue
            self._speeds[axis] = speed = self._speed(admittance, axis, felt[axis])
            path.append(0.0)
            whole.append(speed * dt)
        return _moved(old, turn, path), _moved(old, turn, whole)

    def _speed(self, admittance: Admittance, axis: int, felt: float) -> float:
        turns = axis >= 3
        wanted, limit = self.task.wrench[axis], abs(self.task.limits[axis])
        least = admittance.least_n * (0.1 if turns else 1.0)
        if wanted == 0.0 and abs(felt) < least:
            speed = self._speeds[axis] * (1.0 - admittance.damping)
        else:
            speed = (admittance.turn_gain if turns else admittance.gain) * (wanted + felt)
        return min(max(speed, -limit), limit)

    def _turn(self, old: Pose, motion: list[float]) -> Quaternion | None:
        """Return the axes of the frame in the base frame now; None while no axis is compliant.

        The motion, m/s, is the program's: that of a compliant axis would turn a frame of type 3 (assumed).
        """
        frame = self.task.frame
        if self.task.kind == 1:
            return _pointing(frame, old.position)
        if self.task.kind == 3:
            x, y, _ = rotate(inverse(frame.quaternion), motion)
            if math.hypot(x, y) > _MOTION_LEAST:
                about_z = turn_by((0.0, 0.0, math.atan2(y, x)))
                self._motion_turn = product(frame.quaternion, about_z)
            return self._motion_turn
        return frame.quaternion


def _pointing(frame: Pose, place: Vector) -> Quaternion | None:
    """Return the frame turned by the least angle that makes its y axis point from a place to its origin."""
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
    """Return a pose after a step along and about the axes of a frame; the turn is about the tool."""
    x, y, z = (a + b for a, b in zip(old.position, rotate(turn, step[:3]), strict=True))
    return Pose((x, y, z), product(turn_by(rotate(turn, step[3:])), old.quaternion))


def external_wrench(given: Value | None, turn: Quaternion, tool: Pose) -> Wrench:
    """Return a client's forces along the base axes, N and N·m:

    `given` along those of the flange, whose orientation is `turn`, and about it. Those here are about the tool.
    None given are none.
    """
    if not isinstance(given, tuple):
        return (0.0,) * 6
    wrench = (*rotate(turn, given[:3]), *rotate(turn, given[3:]))
    return about_tool(wrench, rotate(turn, tool.position))


def about_tool(wrench: Wrench, arm: Vector) -> Wrench:
    """Convert a wrench with moments about the flange to moments about the tool, which is `arm` away, base axes."""
    (a, b, c, u, v, w), (x, y, z) = wrench, arm
    return a, b, c, u - (y * c - z * b), v - (z * a - x * c), w - (x * b - y * a)


def solve_motion(arm: Arm, tcp: Pose, poses: tuple[Pose, Pose], near: Joints) -> Motion | None:
    """Return the joints of both poses of a step; None if none hold one of them. `tcp` is the tool in the flange."""
    back = invert(tcp)
    path, whole = (nearest(arm, compose(pose, back), near) for pose in poses)
    return None if path is None or whole is None else Motion(path, whole)
