"""Conversion of poses to and from the controller's notation: x y z, m, and a rotation vector, rad.

For a tool that points down, a rotation vector and its opposite both have a length of about π and describe almost
the same orientation. Rotation vectors are therefore never compared.
"""

from collections.abc import Sequence

from protocol.geometry import Pose, rotation_vector, turn_by


def pose_of(six: Sequence[float]) -> Pose:
    """Convert x y z, m, and a rotation vector, rad, to a pose."""
    x, y, z, *vector = six
    return Pose((x, y, z), turn_by(vector))


def six_of(pose: Pose) -> tuple[float, float, float, float, float, float]:
    """Convert a pose to x y z, m, and a rotation vector, rad."""
    return (*pose.position, *rotation_vector(pose.quaternion))
