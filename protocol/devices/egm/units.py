"""Poses of the bridge, in m, and of the wire, in mm."""

from protocol.devices.egm.messages import PoseMm
from protocol.geometry import Pose


def from_wire(pose: PoseMm) -> Pose:
    """Return the pose with its position in m."""
    x, y, z = pose.position_mm
    return Pose((x / 1e3, y / 1e3, z / 1e3), pose.quaternion)


def to_wire(pose: Pose) -> PoseMm:
    """Return the pose with its position in mm."""
    x, y, z = pose.position
    return PoseMm((x * 1e3, y * 1e3, z * 1e3), pose.quaternion)
