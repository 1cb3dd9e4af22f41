"""A controller of Universal Robots, emulated: RTDE, dashboard and script port, with the arm behind them."""

from emulators.devices.rtde.cable import Server
from emulators.devices.rtde.faults import RTDE_FAULTS
from emulators.devices.rtde.panel import RTDE_CONTROLS
from emulators.devices.rtde.profile import RtdeProfile
from emulators.devices.rtde.robot import RtdeRobot, make_robot
from emulators.devices.rtde.urscript import make_parser

__all__ = ["RTDE_CONTROLS", "RTDE_FAULTS", "RtdeProfile", "RtdeRobot", "Server", "make_parser", "make_robot"]
