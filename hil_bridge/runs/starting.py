"""Check, before the movement, that a program can be carried out from the robot's position."""

import math

from hil_bridge.control import ControlLoop
from hil_bridge.control.program.reach import check_workspace
from hil_bridge.devices.robots.seam import RobotReport
from hil_bridge.errors import Cause, ConfigError
from hil_bridge.settings.configuration import Config
from protocol.geometry import angle_between


def check_start(config: Config, loop: ControlLoop, start: RobotReport) -> None:
    """Raise ConfigError for a path that leaves the workspace, or for a resumed run with another orientation."""
    check_workspace(loop.program.row, loop.program.frame, start.pose.position, config.limits)
    point = config.task.resume
    if point is None:
        return
    turned = math.degrees(angle_between(start.pose.quaternion, point.quaternion))
    if turned > config.limits.tilt_deg:
        raise ConfigError(
            f"the tool is turned by {turned:.1f}° from the start of the recorded run, allowed: at most "
            f"{config.limits.tilt_deg:g}°: turn it back, then resume",
            cause=Cause.START_TURNED,
        )
