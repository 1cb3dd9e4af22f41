"""Arm of an xArm 6: dimensions, ranges, limits and stiffness, and poses as the control box writes them.

Dimensions: the maker's page "Kinematic and Dynamic Parameters", xArm 6, standard D-H parameters
(docs.ufactory.cc, support_articles/developer): d1 267, a2 √(284.5² + 53.5²), a3 77.5, d4 342.5, a5 76, d6 97 mm. With
all joints at zero the flange is at 207, 0, 112 mm and points down. The wrist is not spherical: axes 5 and 6 are 76 mm
apart. Ranges: xArm-Developer/xArm-Python-SDK d911319c, `x_config.py`, type 6. Angles are in degrees, lengths in m.
"""

import math
from collections.abc import Iterator

from emulators.arm.chain import ArmShape, Chain, Link
from emulators.arm.mode import Mode
from protocol.arm_size import PerAxis
from protocol.geometry import Pose, Vector, angles_of, from_angles, normalise

_UP, _LEFT, _DOWN = (0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (0.0, 0.0, -1.0)
XARM_6 = ArmShape(
    (
        Link((0.0, 0.0, 267.0), _UP),
        Link((0.0, 0.0, 0.0), _LEFT),
        Link((53.5, 0.0, 284.5), _LEFT),
        Link((77.5, 0.0, 0.0), _DOWN),
        Link((0.0, 0.0, -342.5), _LEFT),
        Link((76.0, 0.0, 0.0), _DOWN),
    ),
    (0.0, 0.0, -97.0),
    (0.0, 1.0, 0.0, 0.0),
    (-360.0, -118.0, -225.0, -360.0, -97.0, -360.0),
    (360.0, 120.0, 11.0, 360.0, 180.0, 360.0),
)
AXES, TYPE = 6, 6
"""Number of axes and type of the arm, as the control box reports them."""
JOINT_STIFFNESS: PerAxis = (5.6e3, 5.6e3, 3.2e3, 3.2e3, 3.2e3, 2.0e3)
"""Stiffness of the joints, N·m/rad. Derived from their largest torques, 50, 50, 32, 32, 32 and 20 N·m (xarm_description
in xArm-Developer/xarm_ros2): a strain-wave gear of 54 and 28 N·m has 1.0e4 and 4.7e3 N·m/rad (catalogue of Harmonic
Drive's CSF series), scaled to these torques, times 0.6 as for a UR10e. No measurement is public; right to a factor of
2.
"""
MODE = Mode(10.0, 0.10)
"""First mode. Assumed: this stiffness with 3 kg at the tool, damping as of an arm of UR; right to a factor of 1.5."""
_ELBOWS = (0.0, 0.0), (0.0, -60.0), (-40.0, -30.0), (30.0, -90.0), (-30.0, -90.0), (45.0, -140.0)
_WRISTS = (0.0, 0.0), (0.0, 60.0), (0.0, 100.0), (180.0, -45.0)
"""Angles of joints 2 and 3, and of joints 4 and 5, from which a posture is sought. Chosen."""


def seeds(pose: Pose) -> Iterator[PerAxis]:
    """Yield the postures from which the joints of a pose are sought."""
    x, y, _ = pose.position
    ahead = math.degrees(math.atan2(y, x))
    for lean, bend in _ELBOWS:
        for forearm, wrist in _WRISTS:
            yield ahead, lean, bend, forearm, wrist, 0.0


def holding(arm: Chain, pose: Pose) -> PerAxis | None:
    """Return the joints that hold the tool in a pose, in the posture nearest to zero; None if none do."""
    return arm.holding(pose, seeds(pose))


def to_box(pose: Pose) -> tuple[float, float, float, float, float, float]:
    """Return a pose as x y z, mm, and roll, pitch, yaw, rad."""
    x, y, z = pose.position
    yaw, pitch, roll = angles_of(pose.quaternion)
    return 1e3 * x, 1e3 * y, 1e3 * z, math.radians(roll), math.radians(pitch), math.radians(yaw)


def from_box(six: tuple[float, ...]) -> Pose:
    """Return the pose of x y z, mm, and roll, pitch, yaw, rad. Numbers that are not finite give a pose that is not."""
    x, y, z, roll, pitch, yaw = six[:6]
    position: Vector = x / 1e3, y / 1e3, z / 1e3
    if not all(map(math.isfinite, (roll, pitch, yaw))):
        return Pose(position, (math.nan,) * 4)
    quaternion = from_angles(math.degrees(yaw), math.degrees(pitch), math.degrees(roll))
    return Pose(position, normalise(quaternion))
