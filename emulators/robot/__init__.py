"""The emulated robot: an IRB 2000 moved by its S3 controller."""

from emulators.robot.controller import S3Controller
from emulators.robot.kinematics import Arm, Joints, Route
from emulators.robot.motion import Motion, ServoProfile, Waypoint
from emulators.robot.profile import S3Profile
from emulators.robot.site import EMPTY_SITE, S3Site, SiteOrders
from emulators.robot.work_area import OutsideWorkArea, WorkArea

__all__ = [
    "EMPTY_SITE",
    "Arm",
    "Joints",
    "Motion",
    "OutsideWorkArea",
    "Route",
    "S3Controller",
    "S3Profile",
    "S3Site",
    "ServoProfile",
    "SiteOrders",
    "Waypoint",
    "WorkArea",
]
