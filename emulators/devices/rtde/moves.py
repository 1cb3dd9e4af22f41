"""Planned moves: along a line, or linear in joint space, with constant acceleration at both ends."""

import math
from collections.abc import Callable, Iterator
from itertools import count
from typing import NamedTuple, TypeAlias

from emulators.devices.rtde.arm import Place
from emulators.devices.rtde.controller import Controller
from emulators.devices.rtde.kinematics import Joints, flange
from protocol.geometry import Pose, Vector, angle_between, slerp

JointPath: TypeAlias = Iterator[Place]
_LEAST = 1e-6
"""Minimum of speeds and accelerations, m or rad, and s. Chosen."""
_TURN_LENGTH = 1.0
"""Length that corresponds to a rotation of 1 rad, m. Assumed."""
_LEAST_PACE = 0.01
"""Minimum share of its speed to which a move is slowed down. Assumed."""
_SLOWER_TRIES = 8
"""Maximum number of attempts to shorten the next step. Chosen."""
_UNDER = 0.999
"""Share of a limit that a slowed move uses. Chosen."""


class Ramp(NamedTuple):
    """Velocity profile with constant acceleration at both ends, as the fraction 0 … 1 of the path over time."""

    length: float
    """Length of the path, m or rad; 0 or less for an empty path."""
    speed: float
    acceleration: float
    total: float
    """Duration, s."""

    def at(self, t: float) -> float:
        """Return the fraction of the path that is completed after a time, s."""
        end = self.total - t
        if not (self.length > 0.0 and end > 0.0):
            return 1.0
        if t < self.speed / self.acceleration:
            done = self.acceleration * t * t / 2.0
        elif end < self.speed / self.acceleration:
            done = self.length - self.acceleration * end * end / 2.0
        else:
            done = self.speed * (t - self.speed / self.acceleration / 2.0)
        return done / self.length


def plan_ramp(length: float, speed: float, acceleration: float) -> Ramp:
    """Plan a motion that is no faster than requested. It reaches the requested speed if the path is long enough."""
    if not length > 0.0:
        return Ramp(0.0, 1.0, 1.0, 0.0)
    speed, acceleration = max(speed, _LEAST), max(acceleration, _LEAST)
    speed = min(speed, math.sqrt(length * acceleration))
    return Ramp(length, speed, acceleration, length / speed + speed / acceleration)


def rates_in_time(length: float, acceleration: float, time: float) -> tuple[float, float]:
    """Return speed and acceleration of a motion with exactly this duration, s. The acceleration is increased if it
    is too small.
    """
    least = 4.0 * length / (time * time)
    acceleration = max(acceleration, least, _LEAST)
    root = math.sqrt(max(0.0, (acceleration * time) ** 2 - 4.0 * length * acceleration))
    return (acceleration * time - root) / 2.0, acceleration


def plan_line(
    controller: Controller, goal: Pose, speed: float, acceleration: float, time: float = 0.0
) -> JointPath | None:
    """Plan a straight line, by m/s and m/s² or by a duration, s. Return None if a value is not finite.

    The target may be out of reach: the move ends where the line leaves the workspace. Derived: PolyScope's node
    "Direction, until tool contact" exports a line of 1000 m, which a contact ends.
    """
    if not all(map(math.isfinite, (speed, acceleration, *goal.position))):
        return None
    start = controller.manipulator.forward(controller.arm.joints)
    turn = angle_between(start.quaternion, goal.quaternion)
    length = max(math.dist(start.position, goal.position), turn * _TURN_LENGTH)
    if time > 0.0:
        speed, acceleration = rates_in_time(length, acceleration, time)

    def at(share: float) -> Pose:
        x, y, z = (a + (b - a) * share for a, b in zip(start.position, goal.position, strict=True))
        return Pose((x, y, z), slerp(start.quaternion, goal.quaternion, share))

    return _along(controller, at, plan_ramp(length, speed, acceleration))


def plan_arc(
    controller: Controller, via: Pose, goal: Pose, speed: float, acceleration: float
) -> JointPath | None:
    """Plan a circle through three points, by m/s and m/s²; a line if the points are collinear. Return None if a
    value is not finite.
    """
    start = controller.manipulator.forward(controller.arm.joints)
    circle = _circle(start.position, via.position, goal.position)
    if circle is None:
        return plan_line(controller, goal, speed, acceleration)
    if not all(map(math.isfinite, (speed, acceleration))) or controller.manipulator.solve(goal) is None:
        return None
    centre, first, second, angle = circle
    length = max(math.hypot(*first) * angle, angle_between(start.quaternion, goal.quaternion) * _TURN_LENGTH)

    def at(share: float) -> Pose:
        cosine, sine = math.cos(angle * share), math.sin(angle * share)
        x, y, z = (c + u * cosine + v * sine for c, u, v in zip(centre, first, second, strict=True))
        return Pose((x, y, z), slerp(start.quaternion, goal.quaternion, share))

    return _along(controller, at, plan_ramp(length, speed, acceleration))


def _circle(start: Vector, via: Vector, goal: Vector) -> tuple[Vector, Vector, Vector, float] | None:
    """Return the centre of a circle, its radius vectors at the start and a quarter turn later, and the angle to the
    target through `via`.
    """
    a, b = _minus(via, start), _minus(goal, start)
    normal = _cross(a, b)
    square = _dot(normal, normal)
    if square < _LEAST**4:
        return None
    to_centre = _scaled(
        _minus(_scaled(_cross(b, normal), _dot(a, a)), _scaled(_cross(a, normal), _dot(b, b))),
        0.5 / square,
    )
    centre = _minus(start, _scaled(to_centre, -1.0))
    first = _minus(start, centre)
    second = _cross(_scaled(normal, 1.0 / math.sqrt(square)), first)
    end = _minus(goal, centre)
    angle = math.atan2(_dot(end, second), _dot(end, first)) % (2.0 * math.pi)
    return centre, first, second, angle


def _minus(a: Vector, b: Vector) -> Vector:
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


def _scaled(a: Vector, factor: float) -> Vector:
    return a[0] * factor, a[1] * factor, a[2] * factor


def _cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def _dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _along(controller: Controller, at: Callable[[float], Pose], ramp: Ramp) -> JointPath:
    """Yield the joint angles at the poses of a path."""

    def joints_at(share: float) -> Joints | None:
        joints = controller.manipulator.solve(at(share), controller.arm.joints)
        if joints is None:
            controller.protective_stop("a line leaves the workspace")
        return joints

    return _pace(controller, joints_at, ramp)


def _pace(controller: Controller, joints_at: Callable[[float], Joints | None], ramp: Ramp) -> JointPath:
    """Yield the joint positions of a move, cycle by cycle.

    The speed slider delays the move, and it is slower where a joint or the tool would exceed its limit. With the
    slider at 0, the arm stops on its path (Universal_Robots_ROS_Driver, pull request 250).

    Derived: tests of Universal Robots' C++ client library command moves with too short a duration, and expect them
    to complete. Assumed: how far a controller slows down. A move that would still be too fast causes a protective
    stop.
    """
    dt, late_s = controller.period, 0.0
    last = controller.arm.joints
    for number in count(1):
        before = number * dt - dt - late_s
        if before >= ramp.total and number > 1:
            return
        step = dt * controller.io.slider
        joints = joints_at(ramp.at(before + step))
        for _ in range(_SLOWER_TRIES):
            if (
                joints is None
                or (excess := _excess(controller, last, joints)) <= 1.0
                or step < _LEAST_PACE * dt
            ):
                break
            step *= _UNDER / excess
            joints = joints_at(ramp.at(before + step))
        if joints is None:
            return
        late_s += dt - step
        last = joints
        yield Place(joints)


def _excess(controller: Controller, here: Joints, joints: Joints) -> float:
    """Return the ratio by which a change of joint angles in one cycle exceeds the limits of joints and tool."""
    profile, dt, lengths = controller.profile, controller.period, controller.manipulator.lengths
    turn = max(abs(b - a) for a, b in zip(here, joints, strict=True))
    distance = math.dist(flange(lengths, here).position, flange(lengths, joints).position)
    return max(turn / profile.max_joint_speed_rad_s, distance * 1e3 / profile.max_tcp_speed_mm_s) / dt


def plan_joint_move(
    controller: Controller, goal: Joints, speed: float, acceleration: float, time: float = 0.0
) -> JointPath | None:
    """Plan a motion linear in joint space. Return None if a value is not finite.

    It is given by rad/s and rad/s² of the joint that moves farthest, or by a duration, s.
    """
    if not all(map(math.isfinite, (*goal, speed, acceleration))):
        return None
    start = controller.arm.joints
    length = max(abs(b - a) for a, b in zip(start, goal, strict=True))
    if time > 0.0:
        speed, acceleration = rates_in_time(length, acceleration, time)

    def joints_at(share: float) -> Joints:
        a, b, c, d, e, f = (old + (new - old) * share for old, new in zip(start, goal, strict=True))
        return a, b, c, d, e, f

    return _pace(controller, joints_at, plan_ramp(length, speed, acceleration))
