"""Emulated controller of Universal Robots: RTDE, dashboard and script port, with the arm behind them."""

from emulators.devices.rtde.cable import Server
from emulators.devices.rtde.faults import RTDE_FAULTS
from emulators.devices.rtde.panel import RTDE_CONTROLS
from emulators.devices.rtde.profile import RtdeProfile
from emulators.devices.rtde.program_socket import ProgramSocket
from emulators.devices.rtde.robot import RtdeRobot, make_robot
from emulators.devices.rtde.running import ProgramMessage
from emulators.devices.rtde.urscript.limits import TEXT_MAX

__all__ = [
    "RTDE_CONTROLS",
    "RTDE_FAULTS",
    "TEXT_MAX",
    "ProgramMessage",
    "ProgramSocket",
    "RtdeProfile",
    "RtdeRobot",
    "Server",
    "make_robot",
]
