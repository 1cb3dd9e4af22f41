"""The emulated robot: an IRB 2000 moved by its S3 controller."""

from emulators.robot.controller import S3Controller
from emulators.robot.motion import Motion, ServoProfile, Waypoint
from emulators.robot.profile import S3Profile
from emulators.robot.work_area import WorkArea

__all__ = ["Motion", "S3Controller", "S3Profile", "ServoProfile", "Waypoint", "WorkArea"]
