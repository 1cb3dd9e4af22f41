"""Retraction of a tool from any state in which a stop left it, for an operator at the cell.

The retraction sets no zero, and the tool need not be known: the initial force is the reference, and it must not
rise. The steps are initially those of the motion before a zero, later those of an approach.
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
class FreeResult:
    """Result of the retraction of a tool."""

    moved_mm: float
    before: tuple[float, ...]
    """Force at the start, tool frame, N: the contact force if the tool is known, otherwise the sensor reading."""
    after: tuple[float, ...]
    """Force at the end, tool frame, N: the contact force if the tool is known, otherwise the sensor reading."""
    known: bool
    """Whether the tool's weight was known and subtracted."""
    back_mm: float | None = None
    """Length of the path back to a recorded start, mm; None without `back_to`."""

    @property
    def text(self) -> str:
        """Result as text for the last line of the output."""
        what = "contact force" if self.known else "force that the sensor reads, the tool's weight included,"
        before, after = math.hypot(*self.before), math.hypot(*self.after)
        back = "" if self.back_mm is None else f"; {self.back_mm:.1f} mm back to the start"
        return f"freed by {self.moved_mm:.1f} mm: {what} {before:.1f} N before, {after:.1f} N after{back}"


def free(
    config: Config, distance_mm: float, say: Callable[[str], None], back_to: Vector | None = None
) -> FreeResult:
    """Move the tool away from the surface by a distance, against `frame.approach`. `say` receives progress
    messages.

    `back_to` is the position in the robot base frame to which the tool moves afterwards, m. Raises SafetyStop if
    the force rises or the robot does not follow, and the errors of a run (BridgeError).
    """

    async def main() -> FreeResult:
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
    """Retraction with devices that have been started. It can be called once."""

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

    async def __call__(self, distance_mm: float, back_to: Vector | None = None) -> FreeResult:
        """Move away by this distance, then to a position, if one is given. Errors as for `free`."""
        config, task = self._config, self._config.task
        if back_to is not None:
            check_goal(config, back_to)
        start = await bring_up(self._robot, self._sensor)
        await self._robot.release(start)
        known = known_wrist(config) if config.tool.mass_kg or not config.sensor.url else None
        sensor_wrist, orientation = known or wrist(config), start.pose.quaternion
        watch = _ForceWatch(config, known is not None, orientation)
        reading = await self._steps.steady(task.zero_change_n)
        before = after = _force(sensor_wrist, orientation, reading.mean)
        watch.see(before, 0.0)
        if back_to is not None:  # the path across is no lower than the start
            if math.hypot(*before) <= task.contact_threshold_n:
                distance_mm = min(distance_mm, 1.0)
            distance_mm = max(distance_mm, depth_between(config, back_to, start.pose.position) * 1e3)
        self._say(f"force {math.hypot(*before):.1f} N; moving away by {distance_mm:g} mm")
        distance = 0.0
        bounds = free_bounds(config, self._robot.facts, start.pose)
        async with self._robot.motion(MotionLimits(LIFT_SPEED_M_S, bounds=bounds)) as motion:
            while distance < distance_mm - 1e-9:
                careful = distance < task.zero_lift_mm - 1e-9
                step = min(task.zero_step_mm if careful else task.single_step_mm, distance_mm - distance)
                await self._steps.to(
                    motion, _moved(start.pose, config, distance + step), orientation, step * 1e-3
                )
                distance += step
                check_alive(self._sensor, config)
                after = _force(sensor_wrist, orientation, (await self._steps.quiet()).mean)
                watch.see(after, distance)
                self._say(f"moved {distance:.3f} mm, force {math.hypot(*after):.1f} N")
        if back_to is None:
            return FreeResult(distance, before, after, known is not None)
        path = ReturnPath(config, self._clock, self._robot, self._sensor, self._say)
        length = await path.follow(back_to, await self._robot.report())
        return FreeResult(distance, before, after, True, length * 1e3)


def _moved(pose: Pose, config: Config, by_mm: float) -> Vector:
    x, y, z = (p - n * by_mm * 1e-3 for p, n in zip(pose.position, config.frame.approach, strict=True))
    return x, y, z


class _ForceWatch:
    """Supervision of the force during the motion."""

    def __init__(self, config: Config, known: bool, orientation: Quaternion) -> None:
        """Create a supervision. `known` means that the forces are contact forces; otherwise they include the weight
        of an unknown tool.
        """
        self._config, self._known, self._orientation = config, known, orientation
        self._lowest = self._most = math.inf
        self._first = -1.0

    def see(self, force: tuple[float, ...], moved_mm: float) -> None:
        """Add a force in the tool frame, N. Raises SafetyStop if the force has risen.

        With a known tool, the magnitude of the force must not rise. With an unknown tool, the component along the
        approach must not rise, and the magnitude must not exceed both the force limit and its initial value.
        """
        limits, length, change_n = self._config.limits, math.hypot(*force), self._config.task.zero_change_n
        unchanged = abs(length - self._first) < change_n / 2
        if self._known and length > change_n and unchanged and moved_mm > limits.unanswered_mm:
            raise SafetyStop(
                f"the force stayed at {length:.1f} N while the tool moved {moved_mm:.3f} mm away: the tool has "
                "stopped; free it by hand, or check the sensor"
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
                f"the force rose to {length:.1f} N while the tool moved {moved_mm:.3f} mm away: the tool has "
                "stopped; free it by hand, or correct frame.approach"
            )


def _force(sensor_wrist: Wrist, orientation: Quaternion, mean: tuple[float, ...]) -> tuple[float, ...]:
    """Return the contact force of a reading in the tool frame, N, with weight and bias subtracted as far as they
    are known.
    """
    x, y, z = sensor_wrist.contact_wrench(mean, normalise(orientation), None)[:3].tolist()
    return x, y, z
