"""Path of a lifted tool back to the start of a recorded run.

The path leads across at the height of the lift, then down, in small slow steps. The tool must be known: as before a
run, its weight verifies the sensor before anything moves. The first contact ends the path, and the tool stops
there.
"""

import math
from collections.abc import Callable, Iterator

from hil_bridge.clock import Clock
from hil_bridge.devices.robots.seam import MotionLimits, RobotLink, RobotReport
from hil_bridge.devices.sensors.stream import ForceSensor
from hil_bridge.errors import ConfigError, SafetyStop
from hil_bridge.record import Recording
from hil_bridge.record.device_facts import devices_of
from hil_bridge.runs.bounds import return_bounds
from hil_bridge.runs.small_steps import LIFT_SPEED_M_S, SmallSteps
from hil_bridge.runs.zeroing import Zeroing, known_wrist
from hil_bridge.settings.configuration import Config
from protocol.geometry import Pose, Quaternion, Vector, normalise

_ROUNDING = 1e-9
"""Tolerance of a number of steps, for rounding errors."""


class ReturnPath:
    """Return to a recorded start. `follow` can be called once."""

    def __init__(
        self,
        config: Config,
        clock: Clock,
        robot: RobotLink,
        sensor: ForceSensor,
        say: Callable[[str], None],
    ) -> None:
        self._config, self._robot, self._sensor, self._say = config, robot, sensor, say
        self._steps = SmallSteps(clock, robot, sensor)
        self._zeroing = Zeroing(config, clock, robot, sensor, lambda text, check: say(text))

    async def follow(self, goal: Vector, start: RobotReport) -> float:
        """Move the tool from its present position to a position in the base frame, m. Return the length of the
        path, m.

        Raises DeviceError if the sensor does not measure the tool's weight, ConfigError if the direction cannot be
        verified, and SafetyStop at a contact.
        """
        pose = Pose(start.pose.position, normalise(start.pose.quaternion))
        depth = depth_between(self._config, pose.position, goal)
        x, y, z = (g - n * depth for g, n in zip(goal, self._config.frame.approach, strict=True))
        corners = (x, y, z), goal
        across = _direction(pose.position, corners[0])
        await self._zeroing.weigh(start, () if across is None else (across,))
        done, place = 0.0, pose.position
        bounds = return_bounds(self._config, self._robot.facts, goal, pose)
        async with self._robot.motion(MotionLimits(LIFT_SPEED_M_S, bounds=bounds)) as motion:
            await self._check_free(pose.quaternion, done)
            for corner in corners:
                for point in _points(place, corner, self._step_m):
                    length = math.dist(place, point)
                    await self._steps.to(motion, point, pose.quaternion, length)
                    done, place = done + length, point
                    await self._check_free(pose.quaternion, done)
        return done

    @property
    def _step_m(self) -> float:
        """Return the step size of an approach, m: a step into a surface of the expected stiffness adds at most
        task.force_n.
        """
        task = self._config.task
        step = task.force_n / task.expected_stiffness_n_m
        return min(max(step, task.zero_step_mm * 1e-3), task.single_step_mm * 1e-3)

    async def _check_free(self, quaternion: Quaternion, done: float) -> None:
        """Raise SafetyStop for a contact, including a contact that only the moments indicate."""
        sensor_wrist, frame, limits = known_wrist(self._config), self._config.frame, self._config.limits
        assert sensor_wrist is not None, "check_goal has refused it"
        check_alive(self._sensor, self._config)
        fx, fy, fz, mx, my, mz = (await self._steps.quiet()).mean
        measured = fx, fy, fz, mx, my, mz
        at = sensor_wrist.at_orientation(quaternion, None, frame.approach)
        hidden = self._zeroing.axes.hidden_at_rest(at, measured, limits.weight_tolerance_n)
        force, limit = (
            max(hidden, math.hypot(*at.contact_wrench(measured)[:3])),
            self._config.task.contact_threshold_n,
        )
        self._say(f"{done * 1e3:.3f} mm of the path back, force {force:.1f} N")
        if force > limit:
            raise SafetyStop(
                f"{force:.1f} N on the tool after {done * 1e3:.3f} mm of the path back; allowed: at most {limit:g} N "
                "(task.contact_threshold_n). The tool has stopped; find the obstacle, then run hil-bridge free"
            )


def start_of(recording: Recording, kind: str) -> Vector:
    """Return the start position of a recorded run of this kind of robot, base frame, m.

    Raises ConfigError if the recording contains no cycle, or is a recording of an emulated robot or of another kind
    of robot.
    """
    robot = devices_of(recording).robot
    if robot.emulated:
        raise ConfigError(
            "the recording is of an emulated robot, whose start is not a position in this cell; "
            "name one of a run on this robot"
        )
    if robot.kind not in ("", kind):
        raise ConfigError(
            f"the recording is of a robot of kind {robot.kind}, and this one is of kind {kind}; name one of a run on it"
        )
    if not recording.cycles:
        raise ConfigError("the recording has no cycle, so the start of its run is unknown; name another")
    x, y, z = recording.cycles[0].start
    return x, y, z


def depth_between(config: Config, begin: Vector, end: Vector) -> float:
    """Return how much deeper one position is than another, m."""
    return sum((b - a) * n for a, b, n in zip(begin, end, config.frame.approach, strict=True))


def check_goal(config: Config, goal: Vector) -> None:
    """Raise ConfigError if the tool is unknown or the goal is outside the workspace."""
    limits = config.limits
    if known_wrist(config) is None or (config.sensor.url and not config.tool.mass_kg):
        raise ConfigError("the path back needs the mass of the tool: set tool.mass_kg (--tool-mass-kg)")
    box = zip(limits.workspace_min_m, goal, limits.workspace_max_m, strict=True)
    if not all(low <= part <= high for low, part, high in box):
        place = " ".join(f"{part * 1e3:.1f}" for part in goal)
        raise ConfigError(
            f"the recorded start, {place} mm, is outside limits.workspace_min_m … workspace_max_m"
        )


def check_alive(sensor: ForceSensor, config: Config) -> None:
    """Raise SafetyStop if the sensor cannot detect a rising force."""
    sensor.check()
    newest = sensor.newest
    unchanged_ms = 0.0 if newest is None else (newest.at - sensor.unchanged_since) * 1e3
    if sensor.saturated or sensor.dead or unchanged_ms >= config.limits.frozen_after_ms:
        raise SafetyStop("the force sensor is stuck, dead or saturated: free the tool by hand")


def _direction(begin: Vector, end: Vector) -> Vector | None:
    """Return the unit vector from one position to another, or None if they are equal."""
    length = math.dist(begin, end)
    if length < _ROUNDING:
        return None
    x, y, z = ((b - a) / length for a, b in zip(begin, end, strict=True))
    return x, y, z


def _points(begin: Vector, end: Vector, step: float) -> Iterator[Vector]:
    """Return points on a straight line, without the start point, at most one step apart, m."""
    count = math.ceil(math.dist(begin, end) / step - _ROUNDING)
    for number in range(1, count + 1):
        x, y, z = (a + (b - a) * number / count for a, b in zip(begin, end, strict=True))
        yield x, y, z
