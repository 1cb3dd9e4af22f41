"""Moves that are planned before they begin: along a line, or in joints, with even acceleration at both ends."""

import math
from collections.abc import Iterator
from typing import TypeAlias

from emulators.devices.rtde.arm import Place
from emulators.devices.rtde.controller import Controller
from emulators.devices.rtde.kinematics import Joints
from protocol.geometry import Pose, angle_between, slerp

Walk: TypeAlias = Iterator[Place]
_LEAST = 1e-6
"""Chosen: slower speeds and smaller accelerations count as this, m or rad, and s."""
_TURN_LENGTH = 1.0
"""Assumed: a turn of 1 rad counts as so long a way, m."""


def shares(length: float, speed: float, acceleration: float, dt: float) -> Iterator[float]:
    """Parts 0 … 1 of a way, cycle by cycle, the last one 1."""
    if not length > 0.0:
        yield 1.0
        return
    speed, acceleration = max(speed, _LEAST), max(acceleration, _LEAST)
    speed = min(speed, math.sqrt(length * acceleration))
    ramp = speed / acceleration
    total = length / speed + ramp
    for number in range(1, math.ceil(total / dt)):
        t = number * dt
        end = total - t
        if t < ramp:
            done = acceleration * t * t / 2.0
        elif end < ramp:
            done = length - acceleration * end * end / 2.0
        else:
            done = speed * (t - ramp / 2.0)
        yield done / length
    yield 1.0


def line_walk(controller: Controller, goal: Pose, speed: float, acceleration: float) -> Walk | None:
    """Along a straight line, m/s and m/s²; None where no joints hold the goal, or the values are no numbers."""
    if not all(map(math.isfinite, (speed, acceleration))) or controller.solve(goal) is None:
        return None
    start = controller.forward(controller.arm.joints)
    turn = angle_between(start.quaternion, goal.quaternion)
    length = max(math.dist(start.position, goal.position), turn * _TURN_LENGTH)

    def places() -> Walk:
        for share in shares(length, speed, acceleration, controller.period):
            x, y, z = (a + (b - a) * share for a, b in zip(start.position, goal.position, strict=True))
            pose = Pose((x, y, z), slerp(start.quaternion, goal.quaternion, share))
            joints = controller.solve(pose, controller.arm.joints)
            if joints is None:
                controller.protective_stop("a line leaves the workspace")
                return
            yield Place(joints)

    return places()


def joint_walk(controller: Controller, goal: Joints, speed: float, acceleration: float) -> Walk | None:
    """Straight in joints, rad/s and rad/s² of the one that goes farthest; None where a value is no number."""
    if not all(map(math.isfinite, (*goal, speed, acceleration))):
        return None
    start = controller.arm.joints
    length = max(abs(b - a) for a, b in zip(start, goal, strict=True))

    def places() -> Walk:
        for share in shares(length, speed, acceleration, controller.period):
            a, b, c, d, e, f = (old + (new - old) * share for old, new in zip(start, goal, strict=True))
            yield Place((a, b, c, d, e, f))

    return places()
