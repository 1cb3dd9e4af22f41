"""A controller of Universal Robots, emulated: RTDE, dashboard and script port, with the arm behind them."""

from emulators.rtde.faults import RTDE_FAULTS
from emulators.rtde.profile import RtdeProfile
from emulators.rtde.robot import RtdeRobot, Server, make_robot

__all__ = ["RTDE_FAULTS", "RtdeProfile", "RtdeRobot", "Server", "make_robot"]
