"""Contact law of a flat surface with a linear material."""

from typing import NamedTuple

from protocol.geometry import Vector


class PlaneLaw(NamedTuple):
    """Flat surface with a linear spring and damper, and Coulomb friction that is smoothed near zero velocity."""

    depth_of_origin: float
    """Depth of the base frame's origin below the surface, m."""
    normal: Vector
    """Outward unit normal, base frame."""
    stiffness: float
    """Stiffness, N/m."""
    damping: float
    """Damping, N·s/m."""
    friction: float
    """Coulomb coefficient."""
    smoothing: float
    """Speed at which friction has 71 % of its full value, m/s."""
