"""Bounds of the last gate, of what a run, the freeing of a tool and the turning of one may order."""

import math

from hil_bridge.control.loop import LONGEST_SAMPLES
from hil_bridge.devices.facts import RobotFacts
from hil_bridge.devices.robots.gate import SLACK_M, Bounds, contradiction
from hil_bridge.errors import GateStop
from hil_bridge.runs.small_steps import LIFT_SPEED_M_S
from hil_bridge.settings.configuration import Config
from protocol.geometry import Pose, Vector

DECIDES_S = 0.1
"""Chosen: time that one decision may last longer than the next one; two orders come as much sooner one after the other.
The guard reports a computer that stalls for longer.
"""
WORDS = 2.0
"""Steps of a robot's words between an order and its pose. Derived: two places that are each a step off."""


def run_bounds(config: Config, facts: RobotFacts, sample_time: float, turns: bool, start: Pose) -> Bounds:
    """Bounds of a run that begins here, from the limits of its supervisor.

    `sample_time` is the controller's, s. A program turns the tool where `turns` is true.
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
    """Raise GateStop for a place, m, that has not the depth below the start that was decided, m."""
    if stopped := contradiction(position, start.position, config.frame.approach, depth):
        raise GateStop(stopped)


def free_bounds(config: Config, facts: RobotFacts, start: Pose) -> Bounds:
    """Bounds of freeing a tool: away from where it stands, and no deeper."""
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
    """Bounds of a return to a place, m, from where the tool is: no deeper than that place."""
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
    """Bounds of turning a tool by an angle, rad, away from where it stands. The robot has its own speed of turning."""
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
    return WORDS * (facts.order_step_m or 0.0) + SLACK_M


def _move(corner: Vector, by: float) -> Vector:
    x, y, z = corner
    return x + by, y + by, z + by
