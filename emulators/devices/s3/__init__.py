"""Emulated robot: an IRB 2000 moved by its S3 controller."""

from emulators.devices.s3.controller import S3Controller
from emulators.devices.s3.faults import S3_FAULTS
from emulators.devices.s3.making import make_robot
from emulators.devices.s3.panel import S3_CONTROLS, read_state
from emulators.devices.s3.profile import S3Profile, S3Profiles
from emulators.devices.s3.programs import MoveStep, Step, WaitStep, read_steps
from emulators.devices.s3.site import EMPTY_SITE, S3Site, SiteOrders
from emulators.devices.s3.state import CHANGES, Activity, State, Stimulus, refusal

__all__ = [
    "CHANGES",
    "EMPTY_SITE",
    "S3_CONTROLS",
    "S3_FAULTS",
    "Activity",
    "MoveStep",
    "S3Controller",
    "S3Profile",
    "S3Profiles",
    "S3Site",
    "SiteOrders",
    "State",
    "Step",
    "Stimulus",
    "WaitStep",
    "make_robot",
    "read_state",
    "read_steps",
    "refusal",
]
