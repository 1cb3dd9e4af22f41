"""Positions, orientations and wrenches as plain values: the one place for all devices, emulators and the bridge.

SI units inside: m, N, N·m. The base frame is the robot's own. The tool frame lies in the tool centre point.
"""

from typing import NamedTuple, TypeAlias

Vector: TypeAlias = tuple[float, float, float]
"""x y z. Field and argument say the frame and the unit; a position without a word is the tool in the base frame, m."""
Quaternion: TypeAlias = tuple[float, float, float, float]
"""w x y z. It turns vectors of the tool frame into vectors of the base frame unless its field says otherwise."""
Wrench: TypeAlias = tuple[float, float, float, float, float, float]
"""fx fy fz mx my mz, N and N·m, about the origin of the frame that its field names."""


class Pose(NamedTuple):
    """Where the tool is and how it stands."""

    position: Vector
    """Tool centre point in the base frame, m."""
    quaternion: Quaternion
    """Tool frame in the base frame, w x y z."""
