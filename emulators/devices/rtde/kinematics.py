"""Joints and poses of Universal Robots' arms: forward kinematics, and every inverse solution.

Denavit-Hartenberg lengths: Universal Robots' page on them. A real arm adds its own calibration. Lengths in m, angles
in rad. With all joints at zero the arm lies along base -x, and the tool points along base -y.

Joints 2, 3 and 4 have parallel axes, so that they move in one plane. It stands beside the base axis by d4.
"""

import math
from collections import deque
from collections.abc import Iterator, Mapping
from functools import lru_cache
from typing import NamedTuple, TypeAlias

from protocol.geometry import Pose, Quaternion, Vector, inverse, product, rotate

Joints: TypeAlias = tuple[float, float, float, float, float, float]
"""Base, shoulder, elbow, wrist 1 to 3, rad."""

RANGE = 2.0 * math.pi
"""Each joint turns so far either way, rad. Source: Universal Robots' user manuals."""
_STEP_M, _ROOM_STEPS = 0.05, 3
"""Chosen: a place that an arm can hold is looked for in such steps, and is so many of them inside its reach."""
_SINGULAR = 1e-6
"""A sine below this leaves an angle open, which stays as it was."""
_HALF = math.sqrt(0.5)


class Arm(NamedTuple):
    """Lengths of an arm, m."""

    d1: float
    a2: float
    a3: float
    d4: float
    d5: float
    d6: float


ARMS: Mapping[str, Arm] = {
    "ur5e": Arm(0.1625, -0.425, -0.3922, 0.1333, 0.0997, 0.0996),
    "ur10e": Arm(0.1807, -0.6127, -0.57155, 0.17415, 0.11985, 0.11655),
    "ur5": Arm(0.089159, -0.425, -0.39225, 0.10915, 0.09465, 0.0823),
    "ur10": Arm(0.1273, -0.612, -0.5723, 0.163941, 0.1157, 0.0922),
}
"""Arms by name; those with an e are e-Series, the others CB3."""
_SMALL, _LARGE = (3.1e4, 3.1e4, 3.1e4, 4.7e3, 4.7e3, 4.7e3), (6.7e4, 6.7e4, 3.1e4, 1.0e4, 1.0e4, 1.0e4)
JOINT_STIFFNESS: Mapping[str, Joints] = {"ur5e": _SMALL, "ur5": _SMALL, "ur10e": _LARGE, "ur10": _LARGE}
"""Assumed, N·m/rad: of strain-wave gears of sizes 32 and 25 in the main axes and 17 and 14 in the wrist, at low torque.
Universal Robots publishes none. An arm has a second encoder behind each gear, but reports the motor's angle.
"""
USUAL: Joints = (0.0, -math.pi / 2, -math.pi / 2, -math.pi / 2, math.pi / 2, 0.0)
"""Chosen: the posture next to which one is looked for at the start, elbow up and the tool down."""


def compose(first: Pose, second: Pose) -> Pose:
    """Return the second pose, given in the frame of the first, in the first one's own frame."""
    (x, y, z), quaternion = first
    (a, b, c), turned = second
    u, v, t = rotate(quaternion, (a, b, c))
    return Pose((x + u, y + v, z + t), product(quaternion, turned))


class ToolPoses:
    """Poses of tools at the flange. The newest are kept, since two further cycles ask for the same ones."""

    def __init__(self) -> None:
        self._newest: deque[tuple[Pose, Pose, Pose]] = deque(maxlen=2)

    def at(self, flange_pose: Pose, tool: Pose) -> Pose:
        """Where a tool is, base frame: from the pose of the flange and the tool in its frame."""
        for known, in_it, pose in self._newest:
            if known is flange_pose and in_it is tool:
                return pose
        pose = compose(flange_pose, tool)
        self._newest.append((flange_pose, tool, pose))
        return pose


def invert(pose: Pose) -> Pose:
    """Return the outer frame in the frame of the pose."""
    back = inverse(pose.quaternion)
    x, y, z = rotate(back, pose.position)
    return Pose((-x, -y, -z), back)


def _of_wrist_1(base: float, total: float) -> Quaternion:
    """Multiply turns about z, each followed by a quarter turn about x; angles are halves, rad."""
    c, s, u, v = math.cos(base), math.sin(base), math.cos(total), math.sin(total)
    return -s * v, c * u, s * u, c * v


def _of_tool(wrist_2: float, wrist_3: float) -> Quaternion:
    """Multiply turns about z with a quarter turn back about x between them, in the same way."""
    both, less = wrist_2 + wrist_3, wrist_3 - wrist_2
    return _HALF * math.cos(both), -_HALF * math.cos(less), _HALF * math.sin(less), _HALF * math.sin(both)


@lru_cache(maxsize=32)
def flange(arm: Arm, joints: Joints) -> Pose:
    """Pose of the flange in the base frame. The newest are kept: a controller asks for the same ones in a cycle."""
    base, shoulder, elbow, wrist_1, wrist_2, wrist_3 = joints
    c, s = math.cos(base), math.sin(base)
    fore = shoulder + elbow
    total = fore + wrist_1
    out = arm.a2 * math.cos(shoulder) + arm.a3 * math.cos(fore) + arm.d5 * math.sin(total)
    up = arm.a2 * math.sin(shoulder) + arm.a3 * math.sin(fore) - arm.d5 * math.cos(total)
    turn = product(_of_wrist_1(base / 2.0, total / 2.0), _of_tool(wrist_2 / 2.0, wrist_3 / 2.0))
    w, x, y, z = turn
    tool = 2.0 * arm.d6  # along the last axis of the turn
    tx, ty, tz = tool * (x * z + w * y), tool * (y * z - w * x), arm.d6 - tool * (x * x + y * y)
    return Pose((out * c + arm.d4 * s + tx, out * s - arm.d4 * c + ty, arm.d1 + up + tz), turn)


def solutions(arm: Arm, pose: Pose, near: Joints) -> Iterator[Joints]:
    """Every way to hold the flange in a pose, up to eight; those with the signs of `near` come first.

    Of angles a whole turn apart it takes the one next to `near`.
    """
    turn = pose.quaternion
    tool = rotate(turn, (0.0, 0.0, 1.0))
    (x, y, z), (u, v, w) = pose.position, tool
    x, y, z = x - arm.d6 * u, y - arm.d6 * v, z - arm.d6 * w
    radius = math.hypot(x, y)
    if radius < abs(arm.d4) or radius == 0.0:
        return
    beside, bearing = math.asin(arm.d4 / radius), math.atan2(y, x)
    bases = bearing + beside, bearing + math.pi - beside
    for base in bases if math.cos(near[0] - bases[0]) >= math.cos(near[0] - bases[1]) else bases[::-1]:
        c, s = math.cos(base), math.sin(base)
        along = rotate(inverse(turn), (s, -c, 0.0))
        tilt = math.acos(max(-1.0, min(1.0, tool[0] * s - tool[1] * c)))
        for wrist_2 in (tilt, -tilt) if math.sin(near[4]) >= 0.0 else (-tilt, tilt):
            sine = math.sin(wrist_2)
            wrist_3 = near[5] if abs(sine) < _SINGULAR else math.atan2(-along[1] / sine, along[0] / sine)
            axis = rotate(turn, (-math.sin(wrist_3), -math.cos(wrist_3), 0.0))
            out = (x - arm.d5 * axis[0]) * c + (y - arm.d5 * axis[1]) * s
            up = z - arm.d5 * axis[2] - arm.d1
            total = math.atan2(axis[0] * c + axis[1] * s, -axis[2])
            square = out * out + up * up
            cosine = (square - arm.a2**2 - arm.a3**2) / (2.0 * arm.a2 * arm.a3)
            if not -1.0 <= cosine <= 1.0:
                continue
            bend = math.acos(cosine)
            for elbow in (bend, -bend) if math.sin(near[2]) >= 0.0 else (-bend, bend):
                fore = math.atan2(arm.a3 * math.sin(elbow), arm.a2 + arm.a3 * math.cos(elbow))
                shoulder = math.atan2(up, out) - fore
                angles = (base, shoulder, elbow, total - shoulder - elbow, wrist_2, wrist_3)
                a, b, d, e, f, g = map(_wound, angles, near)
                yield a, b, d, e, f, g


def nearest(arm: Arm, pose: Pose, near: Joints) -> Joints | None:
    """Return the solution with the least motion from `near`; None if no joints hold the pose."""
    best, least = None, math.inf
    for joints in solutions(arm, pose, near):
        distance = math.dist(joints, near)
        if distance < least:
            best, least = joints, distance
        if distance < _surely_nearest(arm, joints):
            break
    return best


def reachable_start(arm: Arm, start: Pose, tool: Pose) -> Vector | None:
    """Place for the tool, m, that the arm can hold in this orientation: towards the base at the same height, with room
    for a path around it. None if there is none. `tool` is the tool in the flange.
    """
    x, y, z = start.position
    radius = math.hypot(x, y)
    found: list[Vector] = []
    for step in range(1, int(radius / _STEP_M)):
        share = 1.0 - step * _STEP_M / radius
        pose = Pose((x * share, y * share, z), start.quaternion)
        if nearest(arm, compose(pose, invert(tool)), USUAL) is not None:
            found.append(pose.position)
        elif found:
            break
    return found[min(_ROOM_STEPS, len(found) - 1)] if found else None


def _surely_nearest(arm: Arm, joints: Joints) -> float:
    """Distance from these joints within which no other solution of the same pose is nearer, rad.

    Derived: half of the least way to another one. That mirrors elbow or wrist 2, or stands on the base's other side.
    """
    _, shoulder, elbow, wrist_1, wrist_2, _ = joints
    fore = shoulder + elbow
    out = arm.a2 * math.cos(shoulder) + arm.a3 * math.cos(fore) + arm.d5 * math.sin(fore + wrist_1)
    return min(abs(math.sin(elbow)), abs(math.sin(wrist_2)), math.atan2(abs(out), abs(arm.d4)))


def _wound(angle: float, near: float) -> float:
    """Return the angle, up to whole turns, next to `near` and inside the range."""
    angle += 2.0 * math.pi * round((near - angle) / (2.0 * math.pi))
    if angle > RANGE:
        return angle - 2.0 * math.pi
    return angle + 2.0 * math.pi if angle < -RANGE else angle
