"""Kinematics of Universal Robots' arms: forward, and every inverse solution.

Denavit-Hartenberg lengths: Universal Robots' page on them. A real arm adds its own calibration. Lengths are in m,
angles in rad. With all joints at zero, the arm lies along base -x and the tool points along base -y.

The axes of joints 2, 3 and 4 are parallel, so these joints move in one plane. The plane is at a distance of d4 from
the base axis.
"""

import math
from collections import deque
from collections.abc import Iterator, Mapping
from functools import lru_cache
from typing import NamedTuple, TypeAlias

from protocol.geometry import Pose, Quaternion, Vector, inverse, product, rotate

Joints: TypeAlias = tuple[float, float, float, float, float, float]
"""Angles of base, shoulder, elbow and wrist 1 to 3, rad."""

RANGE = 2.0 * math.pi
"""Range of each joint in either direction, rad. Source: Universal Robots' user manuals."""
_STEP_M, _ROOM_STEPS = 0.05, 3
"""Step of the search for a reachable position, m, and margin from the limit of reach, in steps. Chosen."""
_SINGULAR = 1e-6
"""Sine below which an angle is undetermined. The angle is then left unchanged."""
_HALF = math.sqrt(0.5)


class Arm(NamedTuple):
    """Link lengths of an arm, m."""

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
"""Arms by name. Names with an e are e-Series arms; the others are CB3 arms."""
USUAL: Joints = (0.0, -math.pi / 2, -math.pi / 2, -math.pi / 2, math.pi / 2, 0.0)
"""Joint angles nearest to which the start is searched. Chosen: elbow up and tool down."""


def compose(first: Pose, second: Pose) -> Pose:
    """Return the second pose, which is given in the frame of the first, in the reference frame of the first."""
    (x, y, z), quaternion = first
    (a, b, c), turned = second
    u, v, t = rotate(quaternion, (a, b, c))
    return Pose((x + u, y + v, z + t), product(quaternion, turned))


class ToolPoses:
    """Poses of tools at the flange. The newest poses are cached, because the next two cycles request them again."""

    def __init__(self) -> None:
        self._newest: deque[tuple[Pose, Pose, Pose]] = deque(maxlen=2)

    def at(self, flange_pose: Pose, tool: Pose) -> Pose:
        """Return the pose of a tool in the base frame, given the pose of the flange and the tool in the flange
        frame.
        """
        for known, in_it, pose in self._newest:
            if known is flange_pose and in_it is tool:
                return pose
        pose = compose(flange_pose, tool)
        self._newest.append((flange_pose, tool, pose))
        return pose


def invert(pose: Pose) -> Pose:
    """Return the inverse pose."""
    back = inverse(pose.quaternion)
    x, y, z = rotate(back, pose.position)
    return Pose((-x, -y, -z), back)


def _of_wrist_1(base: float, total: float) -> Quaternion:
    """Multiply two rotations about z, each followed by a quarter turn about x. The arguments are half angles, rad."""
    c, s, u, v = math.cos(base), math.sin(base), math.cos(total), math.sin(total)
    return -s * v, c * u, s * u, c * v


def _of_tool(wrist_2: float, wrist_3: float) -> Quaternion:
    """Multiply two rotations about z, with a quarter turn back about x between them. The arguments are half angles,
    rad.
    """
    both, less = wrist_2 + wrist_3, wrist_3 - wrist_2
    return _HALF * math.cos(both), -_HALF * math.cos(less), _HALF * math.sin(less), _HALF * math.sin(both)


@lru_cache(maxsize=32)
def flange(arm: Arm, joints: Joints) -> Pose:
    """Return the pose of the flange in the base frame.

    The newest results are cached, because a controller requests them repeatedly in a cycle.
    """
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
    """Yield every inverse solution for a flange pose, up to eight. Solutions with the same signs as `near` come
    first.

    Each angle is the one nearest to `near` of those that differ by full turns.
    """
    turn = pose.quaternion
    tool = rotate(turn, (0.0, 0.0, 1.0))
    (x, y, z), (u, v, w) = pose.position, tool
    x, y, z = x - arm.d6 * u, y - arm.d6 * v, z - arm.d6 * w
    radius = math.hypot(x, y)
    if radius < abs(arm.d4) or radius == 0.0:
        return
    offset, bearing = math.asin(arm.d4 / radius), math.atan2(y, x)
    bases = bearing + offset, bearing + math.pi - offset
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
    """Return the solution with the least motion from `near`; None if no joint angles hold the pose."""
    best, least = None, math.inf
    for joints in solutions(arm, pose, near):
        distance = math.dist(joints, near)
        if distance < least:
            best, least = joints, distance
        if distance < _unambiguous_distance(arm, joints):
            break
    return best


def reachable_start(arm: Arm, start: Pose, tool: Pose) -> Vector | None:
    """Return a position for the tool, m, that the arm can hold in this orientation, or None.

    The position is towards the base at the same height, with room for a path around it. `tool` is the tool in the
    flange frame.
    """
    x, y, z = start.position
    radius = math.hypot(x, y)
    reachable: list[Vector] = []
    for step in range(1, int(radius / _STEP_M)):
        share = 1.0 - step * _STEP_M / radius
        pose = Pose((x * share, y * share, z), start.quaternion)
        if nearest(arm, compose(pose, invert(tool)), USUAL) is not None:
            reachable.append(pose.position)
        elif reachable:
            break
    return reachable[min(_ROOM_STEPS, len(reachable) - 1)] if reachable else None


def _unambiguous_distance(arm: Arm, joints: Joints) -> float:
    """Return the distance from these joint angles, rad, within which no other solution of the same pose is nearer.

    Derived: half of the shortest distance to another solution, which mirrors the elbow or wrist 2, or is on the
    other side of the base.
    """
    _, shoulder, elbow, wrist_1, wrist_2, _ = joints
    fore = shoulder + elbow
    out = arm.a2 * math.cos(shoulder) + arm.a3 * math.cos(fore) + arm.d5 * math.sin(fore + wrist_1)
    return min(abs(math.sin(elbow)), abs(math.sin(wrist_2)), math.atan2(abs(out), abs(arm.d4)))


def _wound(angle: float, near: float) -> float:
    """Return the equivalent angle, modulo full turns, that is nearest to `near` and within the range."""
    turns = (near - angle) / (2.0 * math.pi)
    if not -0.5 <= turns <= 0.5:
        angle += 2.0 * math.pi * round(turns)
    if angle > RANGE:
        return angle - 2.0 * math.pi
    return angle + 2.0 * math.pi if angle < -RANGE else angle
