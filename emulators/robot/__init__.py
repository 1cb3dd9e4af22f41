"""The emulated robot: an IRB 2000 moved by its S3 controller."""

from emulators.robot.controller import S3Controller
from emulators.robot.faults import S3_FAULTS
from emulators.robot.kinematics import Arm, Joints, Route
from emulators.robot.motion import Motion
from emulators.robot.panel import Panel, PanelState
from emulators.robot.profile import S3Profile
from emulators.robot.programs import MoveStep, Step, WaitStep, read_steps
from emulators.robot.servo import ServoProfile, Waypoint
from emulators.robot.site import EMPTY_SITE, S3Site, SiteOrders
from emulators.robot.state import CHANGES, REFUSALS, Activity, State, Stimulus, refusal
from emulators.robot.work_area import OutsideWorkArea, WorkArea

__all__ = [
    "CHANGES",
    "EMPTY_SITE",
    "REFUSALS",
    "S3_FAULTS",
    "Activity",
    "Arm",
    "Joints",
    "Motion",
    "MoveStep",
    "OutsideWorkArea",
    "Panel",
    "PanelState",
    "Route",
    "S3Controller",
    "S3Profile",
    "S3Site",
    "ServoProfile",
    "SiteOrders",
    "State",
    "Step",
    "Stimulus",
    "WaitStep",
    "Waypoint",
    "WorkArea",
    "read_steps",
    "refusal",
]
