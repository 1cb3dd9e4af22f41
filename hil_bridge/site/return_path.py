"""Path of a lifted tool back to the start of a recorded run.

It leads across at the height of the lift, then down, in small slow steps. The tool must be known: its weight verifies
the sensor before anything moves, as before a run. The first contact ends it, and the tool stands still there.
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
"""Slack of a number of steps."""


class ReturnPath:
    """One return to a recorded start; call `follow` once."""

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
        """Go from where the tool is to a place in the base frame, m; return the length of the path, m.

        Raises DeviceError for a sensor that does not read the tool's weight, ConfigError for a direction that nothing
        verifies, and SafetyStop at a contact.
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
        """As in an approach: a step into a surface of the expected stiffness adds no more than task.force_n."""
        task = self._config.task
        step = task.force_n / task.expected_stiffness_n_m
        return min(max(step, task.zero_step_mm * 1e-3), task.single_step_mm * 1e-3)

    async def _check_free(self, quaternion: Quaternion, done: float) -> None:
        """Raise SafetyStop for a contact, also for one that only the moments show."""
        seen, frame, limits = known_wrist(self._config), self._config.frame, self._config.limits
        assert seen is not None, "check_goal has refused it"
        check_alive(self._sensor, self._config)
        fx, fy, fz, mx, my, mz = (await self._steps.quiet()).mean
        measured = fx, fy, fz, mx, my, mz
        at = seen.at_orientation(quaternion, None, frame.approach)
        hidden = self._zeroing.axes.hidden_at_rest(at, measured, limits.weight_tolerance_n)
        force, limit = (
            max(hidden, math.hypot(*at.contact_wrench(measured)[:3])),
            self._config.task.contact_threshold_n,
        )
        self._say(f"{done * 1e3:.3f} mm of the path back, force {force:.1f} N")
        if force > limit:
            raise SafetyStop(
                f"{force:.1f} N on the tool after {done * 1e3:.3f} mm of the path back, allowed are {limit:g} N "
                "(task.contact_threshold_n): it stands still; see what it touches, and lift it off with hil-bridge free"
            )


def start_of(recording: Recording, kind: str) -> Vector:
    """Return where a recorded run of a robot of this kind began, base frame, m.

    Raises ConfigError for a recording without a cycle, of an emulated robot, or of a robot of another kind.
    """
    robot = devices_of(recording).robot
    if robot.emulated:
        raise ConfigError(
            "the recording is of an emulated robot, whose start is not a place in this cell; "
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
    """Return how much deeper one place is than another, m."""
    return sum((b - a) * n for a, b, n in zip(begin, end, config.frame.approach, strict=True))


def check_goal(config: Config, goal: Vector) -> None:
    """Raise ConfigError where the tool is not known, or the goal lies outside the workspace."""
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
    """Raise SafetyStop for a sensor that cannot tell a force that rises."""
    sensor.check()
    newest = sensor.newest
    unchanged_ms = 0.0 if newest is None else (newest.at - sensor.unchanged_since) * 1e3
    if sensor.saturated or sensor.dead or unchanged_ms >= config.limits.frozen_after_ms:
        raise SafetyStop("the force sensor is stuck, dead or saturated: free the tool by hand")


def _direction(begin: Vector, end: Vector) -> Vector | None:
    """Return the unit vector; None for two places that are the same."""
    length = math.dist(begin, end)
    if length < _ROUNDING:
        return None
    x, y, z = ((b - a) / length for a, b in zip(begin, end, strict=True))
    return x, y, z


def _points(begin: Vector, end: Vector, step: float) -> Iterator[Vector]:
    """Places on a straight line behind its begin, no farther apart than a step, m."""
    count = math.ceil(math.dist(begin, end) / step - _ROUNDING)
    for number in range(1, count + 1):
        x, y, z = (a + (b - a) * number / count for a, b in zip(begin, end, strict=True))
        yield x, y, z
