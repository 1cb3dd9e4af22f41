"""Supervised small steps: move a little, wait until the robot reports arrival, and read the sensor while
stationary.

They are for a robot and a sensor that are not trusted yet: before a run, and to free a tool that was left in
contact.
"""

import asyncio
import math

from hil_bridge.clock import Clock
from hil_bridge.control import Reading, reading
from hil_bridge.devices.robots.seam import Motion, RobotLink, RobotReport
from hil_bridge.devices.sensors.stream import ForceSensor
from hil_bridge.errors import Cause, DeviceError, SafetyStop
from protocol.geometry import Pose, Quaternion, Vector

STREAM_PATIENCE_S = 5.0
"""Time limit for a ready sensor to send a complete frame, s. Chosen."""
STEADY_PATIENCE_S = 10.0
"""Time limit for the reading to settle, in addition to the settling time of the sensor's filter, s. Chosen."""
WINDOW_S = 0.3
"""Time span of the frames that are averaged to a reading, s. Chosen."""
FRAMES_MIN = 4
"""Minimum number of frames in a reading. Chosen."""
ERROR_N = 0.08
"""Largest standard error of a reading, N, which a noisy sensor reaches by more frames. Chosen: two readings then
differ by `task.zero_change_n`, 0.5 N by default, about once in 5000 times. With a noise of less than 0.16 N, four
frames are enough.
"""
ERROR_PATIENCE_S = 3.0
"""Time limit to reach this standard error, s. Chosen."""
TIME_CONSTANTS = 7.0
"""Number of time constants of the sensor's filter to wait after a step. Derived: less than 0.1 % then remains."""
LIFT_SPEED_M_S = 2e-3
"""Path velocity of the motion to the zero, m/s. Chosen: a robot that leaves its path is halted before it has moved
far.
"""
STEP_PATIENCE_S = 2.0
"""Time limit for one step of the motion to the zero, until the robot reports arrival, s. Chosen."""
FOLLOWS_M = 0.13e-3
"""Largest distance of the reported position from the target of each step, m. Chosen: one resolution step of a
coarse robot.
"""
STRAY_M = 0.5e-3
"""Distance from the ordered path beyond which the robot is halted, m. Chosen."""


async def bring_up(robot: RobotLink, sensor: ForceSensor) -> RobotReport:
    """Bring the robot into operation and start the sensor's stream. Return the robot's report. Raises DeviceError
    with the reason if this fails.
    """
    report = await robot.ready()
    await sensor.ready()
    try:
        async with asyncio.timeout(STREAM_PATIENCE_S):
            await sensor.frame()
    except TimeoutError:
        raise DeviceError(
            f"force sensor on {sensor.name} is ready but sent no complete frame in {STREAM_PATIENCE_S:g} s",
            remedy="check its stream with hil-bridge probe sensor",
            cause=Cause.STREAM,
        ) from None
    return report


class SmallSteps:
    """Robot that moves in small steps, and sensor that is read between the steps."""

    def __init__(self, clock: Clock, robot: RobotLink, sensor: ForceSensor) -> None:
        self._clock, self._robot, self._sensor = clock, robot, sensor

    async def to(self, motion: Motion, target: Vector, orientation: Quaternion, step: float) -> RobotReport:
        """Move to a point at a distance of `step`, m, and wait until the robot reports arrival.

        Raises SafetyStop if the robot does not arrive, and halts the robot if it leaves its path.
        """
        await motion.to(Pose(target, orientation))
        await motion.settled()
        patience = self._clock.now() + STEP_PATIENCE_S
        while True:
            report = await self._robot.report()
            if report.fault:
                raise SafetyStop(
                    report.fault, remedy=report.remedy, facts=report.facts, cause=Cause.LIFT_STATE
                )
            position = report.pose.position
            apart = math.dist(position, target)
            if apart <= FOLLOWS_M:
                return report
            if apart > STRAY_M + step or self._clock.now() > patience:
                await motion.halt()
                raise SafetyStop(
                    f"the reported position does not follow: ordered {_mm(target)} mm, reported {_mm(position)} mm",
                    remedy="check the robot's position before anything else moves it",
                    cause=Cause.LIFT_FOLLOW,
                )

    async def quiet(self) -> Reading:
        """Return a reading of the sensor before a zero, once its filter has settled."""
        since = self._clock.now() + TIME_CONSTANTS * self._sensor.delay
        await self._clock.sleep_until(since)
        return await self._mean_reading(since, FRAMES_MIN, Cause.ZERO_SILENT)

    async def steady(self, change_n: float) -> Reading:
        """Return a reading of the sensor once it drifts by less than `change_n`, N. Raises DeviceError if it does
        not settle.
        """
        sensor = self._sensor
        patience = self._clock.now() + STEADY_PATIENCE_S + TIME_CONSTANTS * sensor.delay
        while True:
            since = self._clock.now()
            await self._clock.sleep_until(since + WINDOW_S)
            mean = await self._mean_reading(since, FRAMES_MIN)
            unrest = mean.unsteady(change_n)
            if not unrest:
                return mean
            if self._clock.now() > patience:
                raise DeviceError(
                    f"force sensor on {sensor.name} does not settle: {unrest}",
                    remedy="make sure that nothing touches the tool",
                    cause=Cause.UNSTEADY,
                )

    async def _mean_reading(self, since: float, count: int, silent: Cause = Cause.STREAM) -> Reading:
        """Return the mean of frames from the given time on: at least the given number, and as many as their noise
        requires.

        Raises DeviceError with the cause `silent` if the frames do not arrive.
        """
        sensor, patience = self._sensor, self._clock.now() + STREAM_PATIENCE_S
        while len(frames := sensor.window(since)) < count:
            sensor.check()
            if self._clock.now() > patience:
                raise DeviceError(
                    f"force sensor on {sensor.name} sent {len(frames)} frames in {STREAM_PATIENCE_S:g} s, "
                    f"{count} are needed for a zero",
                    cause=silent,
                )
            await self._clock.sleep_until(self._clock.now() + WINDOW_S / 10)
        mean, patience = reading(frames), self._clock.now() + ERROR_PATIENCE_S
        while mean.error_n > ERROR_N and self._clock.now() < patience:
            sensor.check()
            await self._clock.sleep_until(self._clock.now() + WINDOW_S / 10)
            mean = reading(sensor.window(since))
        return mean


def _mm(position: Vector) -> str:
    return " ".join(f"{part * 1e3:.3f}" for part in position)
