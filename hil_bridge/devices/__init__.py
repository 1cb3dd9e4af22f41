"""Clients of the devices, over any transport: the robot's computer link and the force sensor."""

from hil_bridge.devices.force_sensor import ForceSensor
from hil_bridge.devices.robot_link import UNIT_TOLERANCE, Motion, RobotLink

__all__ = ["UNIT_TOLERANCE", "ForceSensor", "Motion", "RobotLink"]
