"""Conversion of poses between metres, as used by the bridge, and millimetres, as sent on the wire."""

from protocol.devices.egm.messages import PoseMm
from protocol.geometry import Pose


def from_wire(pose: PoseMm) -> Pose:
    """Convert a pose with its position in mm to one in m."""
    x, y, z = pose.position_mm
    return Pose((x / 1e3, y / 1e3, z / 1e3), pose.quaternion)


def to_wire(pose: Pose) -> PoseMm:
    """Convert a pose with its position in m to one in mm."""
    x, y, z = pose.position
    return PoseMm((x * 1e3, y * 1e3, z * 1e3), pose.quaternion)
