"""Poses as the controller writes them: x y z, m, and a rotation vector, rad.

A tool that points down lives where a rotation vector and its opposite have the length π: they are never compared.
"""

from collections.abc import Sequence

from protocol.geometry import Pose, rotation_vector, turn_by


def pose_of(six: Sequence[float]) -> Pose:
    """Return the pose of x y z, m, and a rotation vector, rad."""
    x, y, z, *vector = six
    return Pose((x, y, z), turn_by(vector))


def six_of(pose: Pose) -> tuple[float, float, float, float, float, float]:
    """x y z, m, and the rotation vector, rad, of a pose."""
    return (*pose.position, *rotation_vector(pose.quaternion))
