"""The bound of the true force for one configuration and the facts of its devices."""

from hil_bridge.control.course.reaction import bound_n
from hil_bridge.control.types import SAMPLE_MS
from hil_bridge.devices.facts import Devices, RobotFacts
from hil_bridge.errors import ConfigError
from hil_bridge.runs.reaction_times import reaction
from hil_bridge.settings.configuration import Config

ANSWERED_SHARE = 1.2
"""Cycle of an asked robot over the time of its characters on the line. Derived: 187 ms, the longest of the paper's
chain, over 156 ms.
"""


def usual_cycle_s(config: Config, robot: RobotFacts) -> float:
    """Return the longest usual cycle: the run's period, or that of the robot if its own is longer, s."""
    floor = (robot.line_floor_s or 0.0) * ANSWERED_SHARE
    return max(config.run.period_ms * 1e-3, robot.cycle_s or 0.0, floor) or SAMPLE_MS * 1e-3


def deepest_speed(config: Config, robot: RobotFacts, cycle_s: float) -> float:
    """Fastest speed at which a run may order its tool into what it does not know, m/s.

    A robot that moves in whole steps is given whole ones, so that a cycle's way may be rounded up by half of one.
    """
    approach, correction = config.task.approach_speed_mm_s * 1e-3, config.limits.correction_mm_s * 1e-3
    rounded = 0.0 if robot.order_step_m is None else robot.order_step_m / 2.0 / cycle_s
    return max(approach + min(rounded, approach), correction)


def force_bound_n(
    config: Config, devices: Devices, stiffness_n_m: float, cycle_s: float | None = None
) -> float:
    """Largest true force along the approach of a run whose tool alone moves, N.

    `stiffness_n_m` is that of the hardest thing touched. `cycle_s` is the longest cycle of the run, s, by default the
    longest that is usual. Infinite where the servo of the robot is not known. Raises ConfigError where the facts of
    the sensor are not.
    """
    robot, sensor = devices.robot, devices.sensor.facts
    if sensor is None:
        raise ConfigError("the facts of the sensor are not known: no bound of the force follows")
    cycle = cycle_s or usual_cycle_s(config, robot)
    return bound_n(
        config.limits.force_limit_n,
        stiffness_n_m,
        deepest_speed(config, robot, cycle),
        reaction(robot, sensor, cycle).total_s,
        robot.position_step_m or 0.0,
    )
