"""Before the touch: what robot and sensor must show before a run trusts them, and the zero.

Nothing moves before the sensor reads the weight of the known tool. Then the tool moves a little away from the
surface, in small slow steps, and the zero is taken only if the force does not change on that way and the reported
position follows.
"""

import asyncio
import math
from collections.abc import Callable, Sequence
from dataclasses import replace

from hil_bridge.clock import Clock
from hil_bridge.config import Config
from hil_bridge.control import Wrist, quaternion_about, quaternion_product
from hil_bridge.control.frames import force_along
from hil_bridge.control.zero import Reading, lift_fault, reading, weight_fault, weight_reading
from hil_bridge.devices import ForceSensor, Motion, RobotLink
from hil_bridge.errors import ConfigError, DeviceError, SafetyStop
from protocol.arap import Quaternion, Status, Vector
from protocol.values import dataclass

STREAM_PATIENCE_S = 5.0
"""Chosen: how long a sensor that is ready may send no whole frame."""
STEADY_PATIENCE_S = 10.0
"""Chosen: how long the reading may take to come to rest, beside the time of the sensor's filter."""
WINDOW_S = 0.3
"""Chosen: frames of so long make a reading."""
FRAMES_MIN = 4
"""Chosen: fewest frames of a reading."""
TIME_CONSTANTS = 7.0
"""Of the sensor's filter, waited for after a step. Derived: after as many less than 0.1 % is left."""
LIFT_SPEED_M_S = 2e-3
"""Chosen: path velocity of the way to the zero; a robot that goes elsewhere is halted before it has gone far."""
STEP_PATIENCE_S = 2.0
"""Chosen: how long one step of that way may take until the robot reports to be there."""
FOLLOWS_M = 0.13e-3
"""Chosen: how near the reported position must come to each step, one resolution step of a coarse robot, m."""
STRAY_M = 0.5e-3
"""Chosen: distance from the ordered way at which the robot is halted, m."""


@dataclass(frozen=True, slots=True)
class Zero:
    """What was taken for zero, and where."""

    start: Status
    """After the way to the zero: the start point of the run."""
    contact: tuple[float, ...]
    """Contact wrench in the tool frame that was taken off, beside known weight and bias, N and N·m."""

    @property
    def force(self) -> float:
        """Its length, N."""
        return math.hypot(*self.contact[:3])


def wrist(config: Config) -> Wrist:
    """How this configuration says that the sensor sits, and what hangs below it."""
    sensor, tool = config.sensor, config.tool
    mounting = quaternion_about((0.0, 0.0, 1.0), math.radians(sensor.mounting_deg))
    return Wrist(
        quaternion_product(sensor.quaternion, mounting),
        _metres(sensor.position_mm),
        sensor.flip_fx_mx,
        (*sensor.bias_n, *sensor.bias_nm),
        tool.mass_kg or 0.0,
        _metres(tool.centre_of_gravity_mm),
    )


def known_wrist(config: Config) -> Wrist | None:
    """The wrist with a tool whose weight is known: that of the configuration, or of the emulated cell; None for a real
    sensor that a person lets run unchecked.

    Raises ConfigError for a real sensor whose tool is neither known nor left unchecked.
    """
    seen = wrist(config)
    if config.tool.mass_kg is not None:
        return seen
    if not config.sensor.url:
        tool = config.cell.tool
        return replace(seen, mass=tool.mass_kg, centre_of_gravity=_metres(tool.centre_of_gravity_mm))
    if config.sensor.unchecked:
        return None
    raise ConfigError(
        "the tool is not known, so the sensor cannot be checked before the robot moves: set tool.mass_kg "
        "(--tool-mass-kg; hil-bridge identify-tool measures it), or sensor.unchecked = true (--unchecked) to take "
        "that on yourself"
    )


def _metres(vector_mm: Vector) -> Vector:
    x, y, z = vector_mm
    return x * 1e-3, y * 1e-3, z * 1e-3


async def bring_up(robot: RobotLink, sensor: ForceSensor) -> Status:
    """Robot in operation, sensor streaming; where the robot stands. Raises DeviceError with what stands against it."""
    status = await robot.read_status()
    if not status.operation and not status.emergency_stop:
        await robot.to_operation()
        status = await robot.read_status()
    if fault := robot.fault(status):
        raise DeviceError(fault)
    await sensor.ready()
    try:
        async with asyncio.timeout(STREAM_PATIENCE_S):
            await sensor.frame()
    except TimeoutError:
        raise DeviceError(
            f"force sensor on {sensor.name} is ready but sent no whole frame in {STREAM_PATIENCE_S:g} s; "
            "look at its stream with hil-bridge probe sensor"
        ) from None
    return status


class Zeroing:
    """The checks of one run over devices that have been brought up; `say` is told what is worth an event."""

    def __init__(
        self,
        config: Config,
        clock: Clock,
        robot: RobotLink,
        sensor: ForceSensor,
        say: Callable[[str], None],
    ) -> None:
        self._config, self._clock, self._robot, self._sensor = config, clock, robot, sensor
        self._say = say
        self._known = known_wrist(config)
        self._wrist = wrist(config)
        self._before: Reading

    async def weigh(self, start: Status) -> None:
        """See that the sensor is at rest and reads the tool's weight, with nothing moving.

        Raises DeviceError with the axis and what it looks like.
        """
        self._say(f"full scales {_numbers(self._sensor.full_scales)} N, N·m{self._told_model()}")
        self._before = await self._steady()
        if self._known is None:
            self._say("sensor unchecked: the tool's weight is not known")
            return
        limits = self._config.limits
        expected = weight_reading(self._known, start.quaternion)
        fault = weight_fault(
            self._before.mean, expected, limits.weight_tolerance_n, limits.weight_tolerance_nm
        )
        if fault:
            await self._robot.close_sequence(start)
            raise DeviceError(f"force sensor on {self._sensor.name}: {fault}")

    def _told_model(self) -> str:
        return f"; {self._sensor.model}" if self._sensor.model else ""

    async def take(self, motion: Motion, start: Status, interrupted: Callable[[], bool]) -> Zero:
        """Move away by `task.zero_lift_mm`, and take the zero there.

        Raises SafetyStop with what forbids it. `interrupted` ends the way early, without a zero.
        """
        lifted = await self._lift(motion, start, interrupted)
        before = self._before
        quaternion = _unit(start.quaternion)
        contact = (0.0,) * 6
        if self._config.sensor.tare:
            reference = self._known or self._wrist
            contact = tuple(reference.contact_wrench(before.mean, quaternion, None).tolist())
            zero = Zero(lifted, contact)
            if zero.force > self._config.limits.zero_max_n:
                raise SafetyStop(
                    f"{zero.force:.1f} N would be taken for zero, allowed are {self._config.limits.zero_max_n:g} N "
                    "(limits.zero_max_n): free the tool, or let identify-tool find its weight and the sensor's bias"
                )
            await self._sensor.tare()
            await self._sensor.frame()
            self._say(f"zero taken: {_numbers(before.mean)} N, N·m; {zero.force:.2f} N beside what is known")
        return Zero(lifted, contact)

    async def _lift(self, motion: Motion, start: Status, interrupted: Callable[[], bool]) -> Status:
        """The way to the zero, step by step; the status at its end."""
        task, approach = self._config.task, self._config.frame.approach
        count = math.ceil(task.zero_lift_mm / task.zero_step_mm - 1e-9)
        status, orientation, velocity = start, start.quaternion, motion.velocity
        motion.velocity = min(velocity, LIFT_SPEED_M_S)
        for number in range(1, count + 1):
            if interrupted():
                break
            away = min(number * task.zero_step_mm, task.zero_lift_mm) * 1e-3
            x, y, z = (s - away * n for s, n in zip(start.position, approach, strict=True))
            await motion.to((x, y, z), orientation)
            status = await self._arrived(motion, (x, y, z))
            after = await self._quiet()
            self._judge(after, start, away)
            self._before = after
        motion.velocity = velocity
        return status

    async def _arrived(self, motion: Motion, target: Vector) -> Status:
        """Wait until the robot reports to be there. Raises SafetyStop when it does not come, and halts it when it goes
        elsewhere.
        """
        patience = self._clock.now() + STEP_PATIENCE_S
        while True:
            status = await self._robot.read_status()
            if fault := self._robot.fault(status):
                raise SafetyStop(fault)
            apart = math.dist(status.position, target)
            if apart <= FOLLOWS_M:
                return status
            if apart > STRAY_M + self._config.task.zero_step_mm * 1e-3 or self._clock.now() > patience:
                await motion.halt()
                raise SafetyStop(
                    f"the reported position does not follow: ordered {_mm(target)} mm, reported {_mm(status.position)} "
                    "mm; look at the robot's position before anything else moves it"
                )

    def _judge(self, after: Reading, start: Status, away: float) -> None:
        """Raise SafetyStop when the force has changed on the way."""
        wrist, quaternion = self._wrist, _unit(start.quaternion)
        change = [b - a for a, b in zip(self._first.mean, after.mean, strict=True)]
        turned = wrist.contact_wrench(change, quaternion, quaternion)
        along = force_along(self._config.frame.approach, quaternion, turned)
        length = math.hypot(*turned[:3].tolist())
        across = math.sqrt(max(length * length - along * along, 0.0))
        if text := lift_fault(along, across, self._config.task.zero_change_n, away * 1e3):
            raise SafetyStop(text)

    async def _quiet(self) -> Reading:
        """What the sensor reads once its filter has settled."""
        since = self._clock.now() + TIME_CONSTANTS * self._sensor.delay
        await self._clock.sleep_until(since)
        return await self._reading(since, FRAMES_MIN)

    async def _steady(self) -> Reading:
        """What the sensor reads at rest. Raises DeviceError when it does not come to rest."""
        sensor, change = self._sensor, self._config.task.zero_change_n
        patience = self._clock.now() + STEADY_PATIENCE_S + TIME_CONSTANTS * sensor.delay
        while True:
            since = self._clock.now()
            await self._clock.sleep_until(since + WINDOW_S)
            found = await self._reading(since, FRAMES_MIN)
            unrest = found.unsteady(change)
            if not unrest:
                self._first = found
                return found
            if self._clock.now() > patience:
                raise DeviceError(
                    f"force sensor on {sensor.name} does not come to rest: {unrest}; let nothing touch the tool"
                )

    async def _reading(self, since: float, count: int) -> Reading:
        """At least so many frames from this time on. Raises DeviceError when they do not come."""
        sensor, patience = self._sensor, self._clock.now() + STREAM_PATIENCE_S
        while len(frames := sensor.window(since)) < count:
            sensor.check()
            if self._clock.now() > patience:
                raise DeviceError(
                    f"force sensor on {sensor.name} sent {len(frames)} frames in {STREAM_PATIENCE_S:g} s, "
                    f"{count} are the least to take a zero from"
                )
            await self._clock.sleep_until(self._clock.now() + WINDOW_S / 10)
        return reading(frames)


def _unit(quaternion: Quaternion) -> Quaternion:
    length = math.hypot(*quaternion)
    w, x, y, z = (part / length for part in quaternion)
    return w, x, y, z


def _numbers(values: Sequence[float]) -> str:
    return " ".join(f"{value:.2f}" for value in values)


def _mm(position: Vector) -> str:
    return " ".join(f"{part * 1e3:.3f}" for part in position)
