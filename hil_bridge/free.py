"""Lifting a tool off from whatever state a stop left it in, for a person who stands at the cell.

Nothing is taken for zero and no tool must be known: the force at the beginning is what is there, and it must not
rise. Steps are those of the way to a zero at first, later those of an approach.
"""

import math
from dataclasses import dataclass

from hil_bridge.clock import Clock, run_real, run_virtual
from hil_bridge.compose import opened_devices
from hil_bridge.config import Config
from hil_bridge.control import Wrist, force_along
from hil_bridge.devices import ForceSensor, RobotLink
from hil_bridge.errors import SafetyStop
from hil_bridge.small_steps import LIFT_SPEED_M_S, SmallSteps, bring_up, unit
from hil_bridge.zeroing import known_wrist, wrist
from protocol.geometry import Quaternion


@dataclass(frozen=True, slots=True)
class Freed:
    """What came of it."""

    moved_mm: float
    before: tuple[float, ...]
    """Force at the beginning: contact force where the tool is known, else what the sensor read, tool frame, N."""
    after: tuple[float, ...]
    """The same at the end."""
    known: bool
    """The tool's weight was known and has been taken off."""

    @property
    def text(self) -> str:
        """In words, for the last line."""
        what = "contact force" if self.known else "force that the sensor reads, the tool's weight included,"
        before, after = math.hypot(*self.before), math.hypot(*self.after)
        return f"freed by {self.moved_mm:.1f} mm: {what} {before:.1f} N before, {after:.1f} N after"


def free(config: Config, virtual: bool, distance_mm: float) -> Freed:
    """Move the tool away from the surface, against `frame.approach`, by a distance.

    Raises SafetyStop when the force rises on the way, or the robot does not follow; BridgeError as a run does.
    """

    async def main() -> Freed:
        clock = Clock.running()
        try:
            async with opened_devices(config, clock, lambda frame: None, lambda kind, text: None) as devices:
                return await free_tool(config, clock, *devices, distance_mm)
        finally:
            clock.close()

    return (run_virtual if virtual else run_real)(main)


async def free_tool(
    config: Config, clock: Clock, robot: RobotLink, sensor: ForceSensor, distance_mm: float
) -> Freed:
    """The same over devices that have been started."""
    start = await bring_up(robot, sensor)
    await robot.close_sequence(start)
    known = known_wrist(config) if config.tool.mass_kg is not None or not config.sensor.url else None
    seen, orientation = known or wrist(config), start.quaternion
    steps, task = SmallSteps(clock, robot, sensor), config.task
    watch = _Watch(config, known is not None, orientation)
    before = after = _force(seen, orientation, (await steps.steady(task.zero_change_n)).mean)
    watch.see(before, 0.0)
    moved = 0.0
    async with robot.motion(LIFT_SPEED_M_S) as motion:
        while moved < distance_mm - 1e-9:
            careful = moved < task.zero_lift_mm - 1e-9
            step = min(task.zero_step_mm if careful else task.approach_step_mm, distance_mm - moved)
            x, y, z = (
                p - n * (moved + step) * 1e-3
                for p, n in zip(start.position, config.frame.approach, strict=True)
            )
            await steps.to(motion, (x, y, z), orientation, step * 1e-3)
            moved += step
            after = _force(seen, orientation, (await steps.quiet()).mean)
            watch.see(after, moved)
    return Freed(moved, before, after, known is not None)


class _Watch:
    """Whether the force rises on the way."""

    def __init__(self, config: Config, known: bool, orientation: Quaternion) -> None:
        """`known`: forces are contact forces; else the weight of a tool that is not known is part of them."""
        self._config, self._known, self._orientation = config, known, orientation
        self._lowest = self._most = math.inf

    def see(self, force: tuple[float, ...], moved_mm: float) -> None:
        """Take a force in the tool frame, N. Raises SafetyStop when it rose.

        With a tool that is known its length must not rise. With another one the part along the approach must not, and
        the length must not pass both the force limit and that of the beginning.
        """
        limits, length = self._config.limits, math.hypot(*force)
        pressed = length
        if not self._known:
            pressed = force_along(
                self._config.frame.approach, unit(self._orientation), (*force, 0.0, 0.0, 0.0)
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
    x, y, z = seen.contact_wrench(mean, unit(orientation), None)[:3].tolist()
    return x, y, z
