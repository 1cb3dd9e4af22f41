"""Small steps under watch: move a little, wait until the robot reports to be there, read the sensor at rest.

For a robot and a sensor that are not trusted yet: before a run, and to free a tool that was left in contact.
"""

import asyncio
import math
from collections.abc import Sequence

from hil_bridge.clock import Clock
from hil_bridge.control import Reading, reading
from hil_bridge.devices.robots.seam import Motion, RobotLink, RobotReport
from hil_bridge.devices.sensors.stream import ForceSensor
from hil_bridge.errors import Cause, DeviceError, SafetyStop
from protocol.geometry import Pose, Quaternion, Vector

STREAM_PATIENCE_S = 5.0
"""Chosen: how long a sensor that is ready may send no whole frame."""
STEADY_PATIENCE_S = 10.0
"""Chosen: time for the reading to settle, in addition to that of the sensor's filter."""
WINDOW_S = 0.3
"""Chosen: frames of so long make a reading."""
FRAMES_MIN = 4
"""Chosen: fewest frames of a reading."""
ERROR_N = 0.08
"""Chosen: standard error of a reading, N, down to which a noisy sensor is read on. Two readings at rest then differ by
`task.zero_change_n`, 0.5 N by default, about once in 5000 times; with a sensor of less than 0.16 N four frames do.
"""
ERROR_PATIENCE_S = 3.0
"""Chosen: how long it is read on for that."""
TIME_CONSTANTS = 7.0
"""Time constants of the sensor's filter, waited for after a step. Derived: after as many less than 0.1 % is left."""
LIFT_SPEED_M_S = 2e-3
"""Chosen: path velocity of the way to the zero; a robot that goes elsewhere is halted before it has gone far."""
STEP_PATIENCE_S = 2.0
"""Chosen: how long one step of that way may take until the robot reports to be there."""
FOLLOWS_M = 0.13e-3
"""Chosen: how near the reported position must come to each step, one resolution step of a coarse robot, m."""
STRAY_M = 0.5e-3
"""Chosen: distance from the ordered way at which the robot is halted, m."""


async def bring_up(robot: RobotLink, sensor: ForceSensor) -> RobotReport:
    """Robot in operation, sensor streaming; where the robot stands. Raises DeviceError with what stands against it."""
    report = await robot.ready()
    await sensor.ready()
    try:
        async with asyncio.timeout(STREAM_PATIENCE_S):
            await sensor.frame()
    except TimeoutError:
        raise DeviceError(
            f"force sensor on {sensor.name} is ready but sent no whole frame in {STREAM_PATIENCE_S:g} s",
            remedy="look at its stream with hil-bridge probe sensor",
            cause=Cause.STREAM,
        ) from None
    return report


class SmallSteps:
    """A robot that moves in small steps, and a sensor that is read between them."""

    def __init__(self, clock: Clock, robot: RobotLink, sensor: ForceSensor) -> None:
        self._clock, self._robot, self._sensor = clock, robot, sensor

    async def to(self, motion: Motion, target: Vector, orientation: Quaternion, step: float) -> RobotReport:
        """Go to a point that is `step` away, m, and wait until the robot reports to be there.

        Raises SafetyStop when it does not come, and halts it when it goes elsewhere.
        """
        await motion.to(Pose(target, orientation))
        await motion.settled()
        patience = self._clock.now() + STEP_PATIENCE_S
        while True:
            report = await self._robot.report()
            if report.fault:
                raise SafetyStop(report.fault, remedy=report.remedy, cause=Cause.LIFT_STATE)
            position = report.pose.position
            apart = math.dist(position, target)
            if apart <= FOLLOWS_M:
                return report
            if apart > STRAY_M + step or self._clock.now() > patience:
                await motion.halt()
                raise SafetyStop(
                    f"the reported position does not follow: ordered {_mm(target)} mm, reported {_mm(position)} mm",
                    remedy="look at the robot's position before anything else moves it",
                    cause=Cause.LIFT_FOLLOW,
                )

    async def quiet(self) -> Reading:
        """Read the sensor before a zero, once its filter has settled."""
        since = self._clock.now() + TIME_CONSTANTS * self._sensor.delay
        await self._clock.sleep_until(since)
        return await self._reading(since, FRAMES_MIN, Cause.ZERO_SILENT)

    async def steady(self, change_n: float) -> Reading:
        """Read the sensor once it drifts by less than `change_n`, N. Raises DeviceError if it does not."""
        sensor = self._sensor
        patience = self._clock.now() + STEADY_PATIENCE_S + TIME_CONSTANTS * sensor.delay
        while True:
            since = self._clock.now()
            await self._clock.sleep_until(since + WINDOW_S)
            found = await self._reading(since, FRAMES_MIN)
            unrest = found.unsteady(change_n)
            if not unrest:
                return found
            if self._clock.now() > patience:
                raise DeviceError(
                    f"force sensor on {sensor.name} does not come to rest: {unrest}",
                    remedy="let nothing touch the tool",
                    cause=Cause.UNSTEADY,
                )

    async def _reading(self, since: float, count: int, silent: Cause = Cause.STREAM) -> Reading:
        """Average at least this many frames from this time on, and as many as their noise requires.

        Raises DeviceError with the cause `silent` when they do not come.
        """
        sensor, patience = self._sensor, self._clock.now() + STREAM_PATIENCE_S
        while len(frames := sensor.window(since)) < count:
            sensor.check()
            if self._clock.now() > patience:
                raise DeviceError(
                    f"force sensor on {sensor.name} sent {len(frames)} frames in {STREAM_PATIENCE_S:g} s, "
                    f"{count} are the least to take a zero from",
                    cause=silent,
                )
            await self._clock.sleep_until(self._clock.now() + WINDOW_S / 10)
        found, patience = reading(frames), self._clock.now() + ERROR_PATIENCE_S
        while found.error_n > ERROR_N and self._clock.now() < patience:
            sensor.check()
            await self._clock.sleep_until(self._clock.now() + WINDOW_S / 10)
            found = reading(sensor.window(since))
        return found


def numbers(values: Sequence[float]) -> str:
    """Values for people to read, with two digits."""
    return " ".join(f"{value:z.2f}" for value in values)


def _mm(position: Vector) -> str:
    return " ".join(f"{part * 1e3:.3f}" for part in position)
