"""Moves that are planned before they begin: along a line, or in joints, with even acceleration at both ends."""

import math
from collections.abc import Callable, Iterator
from itertools import count
from typing import NamedTuple, TypeAlias

from emulators.devices.rtde.arm import Place
from emulators.devices.rtde.controller import Controller
from emulators.devices.rtde.kinematics import Joints, flange
from protocol.geometry import Pose, Vector, angle_between, slerp

Walk: TypeAlias = Iterator[Place]
_LEAST = 1e-6
"""Chosen: slower speeds and smaller accelerations count as this, m or rad, and s."""
_TURN_LENGTH = 1.0
"""Assumed: a turn of 1 rad counts as so long a way, m."""
_LEAST_PACE = 0.01
"""Assumed: a move is slowed down to this share of its speed, and no further."""
_SLOWER_TRIES = 8
"""Chosen: how often the next place is drawn nearer."""
_UNDER = 0.999
"""Chosen: share of a limit that a slower move takes."""


class Ramp(NamedTuple):
    """A way with even acceleration at both ends, as parts 0 … 1 of it over the time."""

    length: float
    """m or rad; not above 0 for a way that is none."""
    speed: float
    acceleration: float
    total: float
    """s"""

    def at(self, t: float) -> float:
        """Return the part that is done after a time, s."""
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
    """Plan a motion no faster than requested that reaches the speed if it is long enough."""
    if not length > 0.0:
        return Ramp(0.0, 1.0, 1.0, 0.0)
    speed, acceleration = max(speed, _LEAST), max(acceleration, _LEAST)
    speed = min(speed, math.sqrt(length * acceleration))
    return Ramp(length, speed, acceleration, length / speed + speed / acceleration)


def rates_in_time(length: float, acceleration: float, time: float) -> tuple[float, float]:
    """Speed and acceleration by which a way takes just a time, s; the acceleration grows where it is too small."""
    least = 4.0 * length / (time * time)
    acceleration = max(acceleration, least, _LEAST)
    root = math.sqrt(max(0.0, (acceleration * time) ** 2 - 4.0 * length * acceleration))
    return (acceleration * time - root) / 2.0, acceleration


def line_walk(
    controller: Controller, goal: Pose, speed: float, acceleration: float, time: float = 0.0
) -> Walk | None:
    """Along a straight line, m/s and m/s², or in a time, s; None where the values are not numbers.

    The goal may be out of reach: the move ends where the line leaves the workspace. Derived: PolyScope's node
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


def arc_walk(controller: Controller, via: Pose, goal: Pose, speed: float, acceleration: float) -> Walk | None:
    """Along the circle through three places, m/s and m/s²; a line where they lie on one. None as of `line_walk`."""
    start = controller.manipulator.forward(controller.arm.joints)
    circle = _circle(start.position, via.position, goal.position)
    if circle is None:
        return line_walk(controller, goal, speed, acceleration)
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
    """Centre, the radius to the start, the one a quarter turn on, and the angle to the goal by way of `via`."""
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


def _along(controller: Controller, at: Callable[[float], Pose], ramp: Ramp) -> Walk:
    """Return the joints of a path's poses."""

    def joints_at(share: float) -> Joints | None:
        joints = controller.manipulator.solve(at(share), controller.arm.joints)
        if joints is None:
            controller.protective_stop("a line leaves the workspace")
        return joints

    return _paced(controller, joints_at, ramp)


def _paced(controller: Controller, joints_at: Callable[[float], Joints | None], ramp: Ramp) -> Walk:
    """Places cycle by cycle, later than planned by the speed slider, and where a joint or the tool would be faster than
    it may be. With the slider at 0 the arm stands in its path (Universal_Robots_ROS_Driver, pull request 250).

    Derived: tests of Universal Robots' C++ client library order moves in too short a time, and expect their end.
    Assumed: how far a controller slows down. A move that would still be too fast makes a protective stop.
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
    """How many times the limits of joints and tool are taken by going from joints to others in one cycle."""
    profile, dt, lengths = controller.profile, controller.period, controller.manipulator.lengths
    turn = max(abs(b - a) for a, b in zip(here, joints, strict=True))
    way = math.dist(flange(lengths, here).position, flange(lengths, joints).position)
    return max(turn / profile.max_joint_speed_rad_s, way * 1e3 / profile.max_tcp_speed_mm_s) / dt


def joint_walk(
    controller: Controller, goal: Joints, speed: float, acceleration: float, time: float = 0.0
) -> Walk | None:
    """Straight in joints, rad/s and rad/s² of the one that goes farthest, or in a time, s; None where a value is no
    number.
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

    return _paced(controller, joints_at, plan_ramp(length, speed, acceleration))
