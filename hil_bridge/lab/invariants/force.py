"""Bounds of the true force, along the approach and laterally, including the additions by injected faults."""

import math
from collections.abc import Iterator

import numpy as np

from hil_bridge.control.course.reaction import bound_n
from hil_bridge.errors import ConfigError
from hil_bridge.lab.invariants.evidence import Evidence, Floats, Promise, Trace, Violation
from hil_bridge.lab.invariants.voids import World, added_n
from hil_bridge.record.device_facts import devices_of
from hil_bridge.runs.force_bound import deepest_speed, force_bound_n, usual_cycle_s
from hil_bridge.runs.reaction_times import reaction
from hil_bridge.settings.configuration import Config
from protocol.geometry import Vector


def stated_bound_n(evidence: Evidence) -> float:
    """Return the bound of the true force along the approach, N; infinite if it is unknown."""
    try:
        return force_bound_n(evidence.config, devices_of(evidence.recording), _max_stiffness(evidence.config))
    except ConfigError:  # the sensor was never ready, so nothing has moved
        return math.inf


def side_bound_n(evidence: Evidence) -> float:
    """Return the bound of the resultant force, N, from `limits.resultant_limit_n` and the fastest lateral motion."""
    world, robot = world_of(evidence, evidence.config.frame.travel), devices_of(evidence.recording).robot
    limit_n = evidence.config.limits.resultant_limit_n
    return bound_n(
        limit_n, world.stiffness_n_m, world.speed_m_s, world.reaction_s, robot.position_step_m or 0.0
    )


def world_of(evidence: Evidence, direction: Vector) -> World:
    """Return the data that determine the additions by the faults of a run, for a tool that presses in this
    direction.
    """
    config, devices = evidence.config, devices_of(evidence.recording)
    cycle_s = usual_cycle_s(config, devices.robot)
    sensor = devices.sensor.facts
    events = evidence.recording.events
    speeds = [deepest_speed(config, devices.robot, cycle_s), *_speeds(config)]
    return World(
        config,
        _max_stiffness(config),
        max(speeds),
        math.inf if sensor is None else reaction(devices.robot, sensor, cycle_s).total_s,
        events[-1].at - events[0].at if events else 0.0,
        direction,
    )


def beyond_bound(evidence: Evidence) -> Iterator[Violation]:
    """Yield the largest true force along the approach, or else the largest resultant, if it exceeds its bound."""
    truth = evidence.truth
    if truth is None or not len(truth.forces) or not math.isfinite(stated_bound_n(evidence)):
        return
    for forces, allowed_n in bounded_forces(evidence, truth):
        place = int(np.argmax(forces))
        true_n = float(forces[place])
        if true_n > allowed_n:
            figures = {"true_n": true_n, "bound_n": allowed_n}
            yield Violation(Promise.BOUND, float(truth.times[place]), figures)
            return


def bounded_forces(evidence: Evidence, truth: Trace) -> Iterator[tuple[Floats, float]]:
    """Yield true forces with their bound, N, including the additions by faults: along the approach, then as
    magnitudes.
    """
    config = evidence.config
    along_n = stated_bound_n(evidence) + added_n(config.faults, world_of(evidence, config.frame.approach))
    if truth.vectors is None or config.frame.follow_normal:
        yield truth.forces, along_n
        return
    yield np.abs(truth.vectors @ np.array(config.frame.approach)), along_n
    directions = config.frame.approach, config.frame.travel, config.frame.across
    added = max(added_n(config.faults, world_of(evidence, direction)) for direction in directions)
    yield truth.forces, side_bound_n(evidence) + added


def _max_stiffness(config: Config) -> float:
    """Return the stiffness of the hardest object in the cell, N/m."""
    surface = config.cell.surface
    wall = surface.wall_stiffness_n_m if surface.wall_at_mm is not None else 0.0
    return float(max(surface.stiffness_n_m, wall))


def _speeds(config: Config) -> Iterator[float]:
    """Yield the speeds of all lateral motions of the task, m/s."""
    yield config.task.speed_mm_s * 1e-3
    for step in config.task.step:
        yield (getattr(step, "speed_mm_s", None) or 0.0) * 1e-3
