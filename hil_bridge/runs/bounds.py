"""Bounds of the gate, which is the last check of every order, for a run, for freeing a tool and for turning a tool."""

import math

from hil_bridge.control.loop import LONGEST_SAMPLES
from hil_bridge.devices.facts import RobotFacts
from hil_bridge.devices.robots.gate import SLACK_M, Bounds, contradiction
from hil_bridge.errors import GateStop
from hil_bridge.runs.small_steps import LIFT_SPEED_M_S
from hil_bridge.settings.configuration import Config
from protocol.geometry import Pose, Vector

DECIDES_S = 0.1
"""Largest difference between the durations of two consecutive decisions, s. It shortens the interval between two
orders. Chosen. The supervisor reports a computer that stalls for longer.
"""
RESOLUTION_STEPS = 2.0
"""Largest distance between an order and the reported pose, in resolution steps of the robot. Derived: two
positions, each off by one step.
"""


def run_bounds(config: Config, facts: RobotFacts, sample_time: float, turns: bool, start: Pose) -> Bounds:
    """Return the bounds of a run that begins at `start`, from the limits of its supervisor.

    `sample_time` is the sample time of the controller, s. `turns` states whether a program turns the tool.
    """
    limits, lift = config.limits, config.task.zero_lift_mm * 1e-3
    return Bounds(
        start=start,
        approach=config.frame.approach,
        deepest=limits.correction_total_mm * 1e-3,
        low=_move(limits.workspace_min_m, -lift),
        high=_move(limits.workspace_max_m, lift),
        tilt=math.radians(limits.turn_total_deg) if turns else 0.0,
        deeper=limits.correction_mm_s * 1e-3,
        across=limits.travel_mm_s * 1e-3,
        turn=math.radians(limits.turn_deg_s) if turns else 0.0,
        time=LONGEST_SAMPLES * sample_time + DECIDES_S,
        slack=_slack(facts),
    )


def check_depth(position: Vector, start: Pose, config: Config, depth: float) -> None:
    """Raise GateStop if the depth of a position (m) below the start differs from the decided depth, m."""
    if stopped := contradiction(position, start.position, config.frame.approach, depth):
        raise GateStop(stopped)


def free_bounds(config: Config, facts: RobotFacts, start: Pose) -> Bounds:
    """Return the bounds for freeing a tool, which may move away from its position, and no deeper."""
    return Bounds(
        start,
        config.frame.approach,
        0.0,
        tilt=0.0,
        deeper=LIFT_SPEED_M_S,
        across=LIFT_SPEED_M_S,
        turn=0.0,
        slack=_slack(facts),
    )


def return_bounds(config: Config, facts: RobotFacts, goal: Vector, start: Pose) -> Bounds:
    """Return the bounds for a return from the current position of the tool to another position, m, and no deeper
    than it.
    """
    limits = config.limits
    deeper = sum((b - a) * n for a, b, n in zip(start.position, goal, config.frame.approach, strict=True))
    return Bounds(
        start=start,
        approach=config.frame.approach,
        deepest=max(deeper, 0.0),
        low=limits.workspace_min_m,
        high=limits.workspace_max_m,
        tilt=0.0,
        deeper=LIFT_SPEED_M_S,
        across=LIFT_SPEED_M_S,
        turn=0.0,
        slack=_slack(facts),
    )


def turning_bounds(config: Config, facts: RobotFacts, angle: float, start: Pose) -> Bounds:
    """Return the bounds for turning a tool by an angle, rad, from its current orientation. The angular speed is the
    robot's own.
    """
    limits = config.limits
    return Bounds(
        start=start,
        approach=config.frame.approach,
        deepest=0.0,
        low=limits.workspace_min_m,
        high=limits.workspace_max_m,
        tilt=angle,
        across=LIFT_SPEED_M_S,
        slack=_slack(facts),
    )


def _slack(facts: RobotFacts) -> float:
    return RESOLUTION_STEPS * (facts.order_step_m or 0.0) + SLACK_M


def _move(corner: Vector, by: float) -> Vector:
    x, y, z = corner
    return x + by, y + by, z + by
