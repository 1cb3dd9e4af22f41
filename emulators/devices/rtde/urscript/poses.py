"""Functions on poses. A program represents a pose as x y z, m, and a rotation vector, rad."""

import math

from emulators.devices.rtde.kinematics import compose, invert
from emulators.devices.rtde.urscript.failures import ScriptError
from emulators.devices.rtde.urscript.table import Function, pure
from emulators.devices.rtde.urscript.values import PoseValue, Value, number, vector
from protocol.devices.rtde.rotation import pose_of, six_of
from protocol.geometry import Pose, Quaternion, inverse, product, rotate, rotation_vector, slerp, turn_by


def pose(value: Value) -> Pose:
    """Return a pose. A list of six numbers is also accepted. Raises ScriptError for anything else, and for invalid
    numbers.
    """
    six = vector(value, 6)
    if not all(map(math.isfinite, six)):
        raise ScriptError("a pose with a value that is not a number")
    return pose_of(six)


def value_of(pose: Pose) -> PoseValue:
    """Convert a pose to a value of a program."""
    return PoseValue(six_of(pose))


def inverse_pose(value: Value) -> Value:
    return value_of(invert(pose(value)))


def _trans(outer: Value, inner: Value) -> Value:
    return value_of(compose(pose(outer), pose(inner)))


def _add(first: Value, second: Value) -> Value:
    """Add the positions of two poses and compose their rotations, both in the base frame."""
    one, other = pose(first), pose(second)
    x, y, z = (a + b for a, b in zip(one.position, other.position, strict=True))
    return value_of(Pose((x, y, z), product(one.quaternion, other.quaternion)))


def _sub(to: Value, start: Value) -> Value:
    one, other = pose(to), pose(start)
    x, y, z = (a - b for a, b in zip(one.position, other.position, strict=True))
    return value_of(Pose((x, y, z), product(one.quaternion, inverse(other.quaternion))))


def _interpolate(start: Value, end: Value, share: Value) -> Value:
    one, other, part = pose(start), pose(end), number(share)
    x, y, z = (a + (b - a) * part for a, b in zip(one.position, other.position, strict=True))
    return value_of(Pose((x, y, z), slerp(one.quaternion, other.quaternion, part)))


def _point_distance(start: Value, end: Value) -> Value:
    return math.dist(pose(start).position, pose(end).position)


def _distance(start: Value, end: Value) -> Value:
    """Return the distance between two poses as one length.

    It combines position and rotation (assumed: as the manual says, of the pose between them).
    """
    return math.hypot(*vector(_sub(end, start), 6))


def _wrench_trans(frame: Value, wrench: Value) -> Value:
    """Transform a wrench from the outer frame to the inner one. The force is rotated, and the moment of its lever
    arm is removed.
    """
    at, (f1, f2, f3, m1, m2, m3) = pose(frame), vector(wrench, 6)
    (x, y, z), back = at.position, inverse(at.quaternion)
    moment = m1 - (y * f3 - z * f2), m2 - (z * f1 - x * f3), m3 - (x * f2 - y * f1)
    return (*rotate(back, (f1, f2, f3)), *rotate(back, moment))


def _to_rpy(value: Value) -> Value:
    w, x, y, z = turn_by(vector(value, 3))
    roll = math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    pitch = math.asin(max(-1.0, min(1.0, 2.0 * (w * y - z * x))))
    return roll, pitch, math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def _to_rotation_vector(value: Value) -> Value:
    roll, pitch, yaw = vector(value, 3)
    return rotation_vector(product(product(_about(2, yaw), _about(1, pitch)), _about(0, roll)))


def _about(axis: int, angle: float) -> Quaternion:
    sine = math.sin(angle / 2.0)
    x, y, z = (sine * (axis == at) for at in range(3))
    return math.cos(angle / 2.0), x, y, z


POSES: tuple[Function, ...] = (
    pure("pose_trans(p_from, p_from_to)", _trans),
    pure("pose_inv(p_from)", inverse_pose),
    pure("pose_add(p_1, p_2)", _add),
    pure("pose_sub(p_to, p_from)", _sub),
    pure("pose_dist(p_from, p_to)", _distance),
    pure("point_dist(p_from, p_to)", _point_distance),
    pure("interpolate_pose(p_from, p_to, alpha)", _interpolate),
    pure("wrench_trans(T_from_to, w_from)", _wrench_trans),
    pure("rotvec2rpy(rotation_vector)", _to_rpy),
    pure("rpy2rotvec(rpy_vector)", _to_rotation_vector),
)
