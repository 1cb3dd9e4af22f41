"""Size of an arm, as its kinematics need it; every robot's profile that names these settings will do."""

from typing import Literal, Protocol

PerAxis = tuple[float, float, float, float, float, float]
"""One number for each of axes 1 to 6."""


class ArmSize(Protocol):
    """Lengths and joints of an arm with six axes and a spherical wrist."""

    @property
    def axis_2_height_mm(self) -> float:
        """Base to axis 2, mm."""

    @property
    def upper_arm_mm(self) -> float:
        """Axis 2 to axis 3, mm."""

    @property
    def elbow_offset_mm(self) -> float:
        """Axis 3 to the forearm's axis, mm."""

    @property
    def forearm_mm(self) -> float:
        """Elbow to wrist, mm."""

    @property
    def wrist_to_flange_mm(self) -> float:
        """Wrist to flange, mm."""

    @property
    def axis_ranges_deg(self) -> PerAxis:
        """Angle by which each axis turns to either side of the middle of its range, °."""

    @property
    def axis_middles_deg(self) -> PerAxis:
        """Middle of each range, °."""

    @property
    def axis_3_against(self) -> Literal["horizon", "upper_arm"]:
        """Reference of the forearm's angle."""

    @property
    def axis_speeds_deg_s(self) -> PerAxis:
        """The fastest that each axis turns, °/s."""
