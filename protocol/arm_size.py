"""Dimensions of an arm that its kinematics need. Any robot profile with these settings implements the protocol."""

from typing import Literal, Protocol

PerAxis = tuple[float, float, float, float, float, float]
"""One value for each of axes 1 to 6."""


class ArmSize(Protocol):
    """Dimensions of a six-axis arm with a spherical wrist."""

    @property
    def axis_2_height_mm(self) -> float:
        """Height of axis 2 above the base, mm."""

    @property
    def upper_arm_mm(self) -> float:
        """Distance from axis 2 to axis 3, mm."""

    @property
    def elbow_offset_mm(self) -> float:
        """Distance from axis 3 to the axis of the forearm, mm."""

    @property
    def forearm_mm(self) -> float:
        """Distance from the elbow to the wrist, mm."""

    @property
    def wrist_to_flange_mm(self) -> float:
        """Distance from the wrist to the flange, mm."""

    @property
    def axis_ranges_deg(self) -> PerAxis:
        """Half range of each axis, °: the largest angle to either side of the middle of its range."""

    @property
    def axis_middles_deg(self) -> PerAxis:
        """Middle of the range of each axis, °."""

    @property
    def axis_3_against(self) -> Literal["horizon", "upper_arm"]:
        """Reference for the angle of axis 3: the horizontal or the upper arm."""

    @property
    def axis_speeds_deg_s(self) -> PerAxis:
        """Maximum speed of each axis, °/s."""
