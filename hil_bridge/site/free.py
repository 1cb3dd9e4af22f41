"""Lift a tool off from any state that a stop left it in, for an operator at the cell.

Nothing is taken for zero and no tool must be known: the force at the beginning is what is there, and it must not
rise. Steps are those of the way to a zero at first, later those of an approach.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

from hil_bridge.clock import Clock, run_real
from hil_bridge.control import Wrist, force_along
from hil_bridge.devices.device_log import CallbackLog
from hil_bridge.devices.robots.seam import MotionLimits, RobotLink
from hil_bridge.devices.sensors.stream import ForceSensor
from hil_bridge.errors import SafetyStop
from hil_bridge.runs.bounds import free_bounds
from hil_bridge.runs.compose import open_devices
from hil_bridge.runs.setup import Setup
from hil_bridge.runs.small_steps import LIFT_SPEED_M_S, SmallSteps, bring_up
from hil_bridge.runs.zeroing import known_wrist, wrist
from hil_bridge.settings.configuration import Config
from hil_bridge.site.return_path import ReturnPath, check_alive, check_goal, depth_between
from protocol.geometry import Pose, Quaternion, Vector, normalise


@dataclass(frozen=True, slots=True)
class Freed:
    """Result of lifting off."""

    moved_mm: float
    before: tuple[float, ...]
    """Force at the beginning: contact force where the tool is known, else what the sensor read, tool frame, N."""
    after: tuple[float, ...]
    """The same at the end."""
    known: bool
    """The tool's weight was known and has been taken off."""
    back_mm: float | None = None
    """Length of the path back to a recorded start; None without `back_to`."""

    @property
    def text(self) -> str:
        """The result in words, for the last line."""
        what = "contact force" if self.known else "force that the sensor reads, the tool's weight included,"
        before, after = math.hypot(*self.before), math.hypot(*self.after)
        back = "" if self.back_mm is None else f"; {self.back_mm:.1f} mm back to the start"
        return f"freed by {self.moved_mm:.1f} mm: {what} {before:.1f} N before, {after:.1f} N after{back}"


def free(
    config: Config, distance_mm: float, say: Callable[[str], None], back_to: Vector | None = None
) -> Freed:
    """Move the tool away from the surface, against `frame.approach`, by a distance. `say` is told how it goes.

    `back_to` is a place in the robot's base frame, m, to go to then. Raises SafetyStop when the force rises on the way,
    or the robot does not follow; BridgeError as a run does.
    """

    async def main() -> Freed:
        clock = Clock.running()
        try:
            # A stream that a dead run left counts from that run's zero; a stream that is stopped loses this zero.
            async with open_devices(Setup(config), clock, CallbackLog()) as devices:
                await bring_up(devices.robot, devices.sensor)
            async with open_devices(Setup(config), clock, CallbackLog()) as devices:
                return await Freeing(config, clock, devices.robot, devices.sensor, say)(distance_mm, back_to)
        finally:
            clock.close()

    return run_real(main)


class Freeing:
    """Lifts a tool off over devices that have been started; call it once."""

    def __init__(
        self,
        config: Config,
        clock: Clock,
        robot: RobotLink,
        sensor: ForceSensor,
        say: Callable[[str], None],
    ) -> None:
        self._config, self._clock, self._robot, self._sensor, self._say = config, clock, robot, sensor, say
        self._steps = SmallSteps(clock, robot, sensor)

    async def __call__(self, distance_mm: float, back_to: Vector | None = None) -> Freed:
        """Move away by so much, then back to a place. Raises as `free` does."""
        config, task = self._config, self._config.task
        if back_to is not None:
            check_goal(config, back_to)
        start = await bring_up(self._robot, self._sensor)
        await self._robot.release(start)
        known = known_wrist(config) if config.tool.mass_kg or not config.sensor.url else None
        seen, orientation = known or wrist(config), start.pose.quaternion
        watch = _Watch(config, known is not None, orientation)
        reading = await self._steps.steady(task.zero_change_n)
        before = after = _force(seen, orientation, reading.mean)
        watch.see(before, 0.0)
        if back_to is not None:  # the path across is no lower than the start
            if math.hypot(*before) <= task.contact_threshold_n:
                distance_mm = min(distance_mm, 1.0)
            distance_mm = max(distance_mm, depth_between(config, back_to, start.pose.position) * 1e3)
        self._say(f"force {math.hypot(*before):.1f} N; moving away by {distance_mm:g} mm")
        moved = 0.0
        bounds = free_bounds(config, self._robot.facts, start.pose)
        async with self._robot.motion(MotionLimits(LIFT_SPEED_M_S, bounds=bounds)) as motion:
            while moved < distance_mm - 1e-9:
                careful = moved < task.zero_lift_mm - 1e-9
                step = min(task.zero_step_mm if careful else task.single_step_mm, distance_mm - moved)
                await self._steps.to(
                    motion, _moved(start.pose, config, moved + step), orientation, step * 1e-3
                )
                moved += step
                check_alive(self._sensor, config)
                after = _force(seen, orientation, (await self._steps.quiet()).mean)
                watch.see(after, moved)
                self._say(f"moved {moved:.3f} mm, force {math.hypot(*after):.1f} N")
        if back_to is None:
            return Freed(moved, before, after, known is not None)
        path = ReturnPath(config, self._clock, self._robot, self._sensor, self._say)
        length = await path.follow(back_to, await self._robot.report())
        return Freed(moved, before, after, True, length * 1e3)


def _moved(pose: Pose, config: Config, by_mm: float) -> Vector:
    x, y, z = (p - n * by_mm * 1e-3 for p, n in zip(pose.position, config.frame.approach, strict=True))
    return x, y, z


class _Watch:
    """Watch on the force during the motion."""

    def __init__(self, config: Config, known: bool, orientation: Quaternion) -> None:
        """`known`: forces are contact forces; else the weight of a tool that is not known is part of them."""
        self._config, self._known, self._orientation = config, known, orientation
        self._lowest = self._most = math.inf
        self._first = -1.0

    def see(self, force: tuple[float, ...], moved_mm: float) -> None:
        """Take a force in the tool frame, N. Raises SafetyStop when it rose.

        With a tool that is known its length must not rise. With another one the part along the approach must not, and
        the length must not pass both the force limit and that of the beginning.
        """
        limits, length, change_n = self._config.limits, math.hypot(*force), self._config.task.zero_change_n
        unchanged = abs(length - self._first) < change_n / 2
        if self._known and length > change_n and unchanged and moved_mm > limits.unanswered_mm:
            raise SafetyStop(
                f"the force stayed at {length:.1f} N while the tool moved {moved_mm:.3f} mm away: it stands still; "
                "free it by hand, or look at the sensor"
            )
        if self._first < 0.0:
            self._first = length
        pressed = length
        if not self._known:
            pressed = force_along(
                self._config.frame.approach, normalise(self._orientation), (*force, 0.0, 0.0, 0.0)
            )
        if self._lowest == math.inf:
            self._lowest, self._most = pressed, max(length, limits.force_limit_n)
        tolerance = max(self._config.task.zero_change_n, min(limits.retract_rise_n, 0.1 * abs(self._lowest)))
        rise = max(pressed - self._lowest - tolerance, length - self._most)
        self._lowest = min(self._lowest, pressed)
        if rise > 0.0:
            raise SafetyStop(
                f"the force rose to {length:.1f} N while the tool moved {moved_mm:.3f} mm away: it stands still; "
                "free it by hand, or correct frame.approach"
            )


def _force(seen: Wrist, orientation: Quaternion, mean: tuple[float, ...]) -> tuple[float, ...]:
    """Contact force of a reading in the tool frame, N, as far as weight and bias are known."""
    x, y, z = seen.contact_wrench(mean, normalise(orientation), None)[:3].tolist()
    return x, y, z
