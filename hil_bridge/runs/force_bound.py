"""Bound of the true force, from a configuration and the facts of its devices."""

from hil_bridge.control.course.reaction import bound_n
from hil_bridge.control.types import SAMPLE_MS
from hil_bridge.devices.facts import Devices, RobotFacts
from hil_bridge.errors import ConfigError
from hil_bridge.runs.reaction_times import reaction
from hil_bridge.settings.configuration import Config

ANSWERED_SHARE = 1.2
"""Ratio of a polled robot's cycle to the transmission time of its characters. Derived: 187 ms, the longest cycle of
the paper's setup, over 156 ms.
"""


def usual_cycle_s(config: Config, robot: RobotFacts) -> float:
    """Return the longest usual cycle, s: the period of the run, or the cycle of the robot if that is longer."""
    floor = (robot.line_floor_s or 0.0) * ANSWERED_SHARE
    return max(config.run.period_ms * 1e-3, robot.cycle_s or 0.0, floor) or SAMPLE_MS * 1e-3


def deepest_speed(config: Config, robot: RobotFacts, cycle_s: float) -> float:
    """Return the largest speed at which a run may order its tool into unexplored space, m/s.

    For a robot that moves in discrete position steps, the distance of a cycle may be rounded up by half a step.
    """
    approach, correction = config.task.approach_speed_mm_s * 1e-3, config.limits.correction_mm_s * 1e-3
    rounded = 0.0 if robot.order_step_m is None else robot.order_step_m / 2.0 / cycle_s
    return max(approach + min(rounded, approach), correction)


def force_bound_n(
    config: Config, devices: Devices, stiffness_n_m: float, cycle_s: float | None = None
) -> float:
    """Return the largest true force along the approach in a run in which only the tool moves, N.

    `stiffness_n_m` is the stiffness of the hardest object that is touched. `cycle_s` is the longest cycle of the
    run, s; by default, the longest usual cycle. The bound is infinite if the servo of the robot is unknown. Raises
    ConfigError if the facts of the sensor are unknown.
    """
    robot, sensor = devices.robot, devices.sensor.facts
    if sensor is None:
        raise ConfigError("the facts of the sensor are not known, so there is no bound of the force")
    cycle = cycle_s or usual_cycle_s(config, robot)
    return bound_n(
        config.limits.force_limit_n,
        stiffness_n_m,
        deepest_speed(config, robot, cycle),
        reaction(robot, sensor, cycle).total_s,
        robot.position_step_m or 0.0,
    )
