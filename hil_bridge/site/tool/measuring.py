"""Measurement of the load below the sensor: hold the tool in several orientations in free space, and average the
readings.

This is the device side of the pure function `identify_tool`. No zero is set, because it would hide the weight and
the sensor's bias.
"""

import math
import statistics
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

from hil_bridge.clock import Clock, run_real, run_virtual
from hil_bridge.control import (
    Observation,
    Request,
    Sample,
    Stop,
    Supervisor,
    SupervisorState,
    ToolPose,
    force_along,
)
from hil_bridge.devices.device_log import CallbackLog
from hil_bridge.devices.robots.seam import GIVE_UP_AFTER_S, Motion, MotionLimits, RobotReport
from hil_bridge.errors import BridgeError, ConfigError, DeviceError, SafetyStop
from hil_bridge.errors.causes import Cause, Reason
from hil_bridge.runs.bounds import turning_bounds
from hil_bridge.runs.compose import Devices, can_hold, open_devices
from hil_bridge.runs.setup import Setup
from hil_bridge.runs.small_steps import bring_up
from hil_bridge.runs.zeroing import wrist
from hil_bridge.settings.configuration import Config
from protocol.geometry import Pose, Quaternion, Vector, angle_between, normalise, product, towards, turn_about
from protocol.wrench import WrenchFrame

Tell = Callable[[str], None]

POSITION_TOLERANCE_M = 0.5e-3
"""Largest distance between the reported and the ordered position on arrival, m. Chosen: four steps of a coarse
robot.
"""
ANGLE_TOLERANCE = math.radians(0.1)
"""Largest angle between the reported and the ordered orientation on arrival, rad. Chosen: coarser than the rounding
of reports.
"""
ARRIVAL_S = 10.0
"""Time limit for the robot to report its arrival after the last order, s. Chosen."""
FRAMES_MIN = 10
"""Minimum number of frames to average. Chosen."""
TIME_CONSTANTS = 7.0
"""Waiting time in addition to the settling time, in time constants of the sensor's filter. Derived: the remainder
is then below 0.1 %.
"""
DEFAULT_DEG = 30.0
"""Default angle of a sweep, °. Chosen."""
_SMALLER_DEG = (25.0, 20.0, 15.0)
"""Smaller angles to try if the arm cannot reach the default, °. Chosen: the smallest one still resolves a centre of
gravity.
"""
_LIMIT_SHARE = 0.95
"""Share of the client's rotation limit that a sweep uses, so that noise does not exceed the limit. Chosen."""
_FORCE_CAUSES = frozenset({Cause.FORCE, Cause.RESULTANT_FORCE, Cause.PULL, Cause.SATURATED})
"""Causes of stops that the still unknown weight of a tool can trigger."""
_BY_WEIGHT = "free the tool, or raise the limit if its weight alone does this"


@dataclass(frozen=True, slots=True)
class Sweep:
    """Motion that turns the tool through several orientations. All default values are chosen."""

    angle_deg: float = DEFAULT_DEG
    """Rotation about each horizontal axis of the base, to either side of the start orientation, °."""
    lift_mm: float = 50.0
    """Distance of the lift before the first turn, against the approach direction, mm."""
    settle_s: float = 1.0
    """Wait at each pose before averaging, in addition to the settling time of the filter, s."""
    average_s: float = 1.0
    """Time over which readings are averaged, s."""
    lift_step_mm: ClassVar[float] = 1.0
    """Largest translation between two sensor checks, mm."""
    turn_step_deg: ClassVar[float] = 2.0
    """Largest rotation between two sensor checks, °. The speed is approximately 10° per second over a slow link."""

    def orientations(self, start: Quaternion) -> tuple[Quaternion, ...]:
        """Return the orientations of the sweep: the start, turns to either side about two horizontal axes, and the
        start again, to reveal drift.
        """
        tilts = [
            product(turn_about(axis, math.radians(angle)), start)
            for axis in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
            for angle in (self.angle_deg, -self.angle_deg)
        ]
        return (start, *tilts, start)


def choose_angle(setup: Setup, requested_deg: float | None, lift_mm: float) -> float:
    """Return the angle of the sweep, °: the requested angle, or otherwise the default or the largest angle that the
    robot can turn.

    The limit follows from the settings of the robot's client and, for an emulated robot, from the arm. Raises
    ConfigError if the robot cannot turn that far.
    """
    usual = DEFAULT_DEG
    turn = setup.robot.kind.largest_turn
    most = math.inf if turn is None else _LIMIT_SHARE * math.degrees(turn(setup.robot.settings))
    choices = [usual, *_SMALLER_DEG] if requested_deg is None else [requested_deg]
    if requested_deg is None and min(choices) <= most < usual:
        choices.append(most)
    for angle in sorted(choices, reverse=True):
        if angle <= most and _arm_reaches(setup, Sweep(angle, lift_mm)):
            return angle
    if min(choices) > most:
        raise ConfigError(
            f"the tool cannot be turned by {min(choices):g}° (--angle-deg): the robot's client turns it by less than "
            f"{most / _LIMIT_SHARE:g}°; raise that limit of [robot.{setup.robot.kind.name}]"
        )
    raise ConfigError(
        f"the tool cannot be turned by {min(choices):g}° (--angle-deg): the emulated arm cannot reach that far; turn "
        "it less, or start where it has more room (cell.start_position_mm, --lift-mm)"
    )


def _arm_reaches(setup: Setup, sweep: Sweep) -> bool:
    """Return whether an emulated arm reaches each pose of the sweep. Return True for a real arm, for which this is
    unknown.
    """
    if not setup.robot.is_emulated:
        return True
    cell, away = setup.config.cell, sweep.lift_mm * 1e-3
    start = zip(cell.start_position_mm, setup.config.frame.approach, strict=True)
    x, y, z = (p * 1e-3 - away * n for p, n in start)
    return all(can_hold(setup, (x, y, z), turned) for turned in sweep.orientations(cell.start_quaternion))


def measure(config: Config, virtual: bool, sweep: Sweep, tell: Tell) -> list[ToolPose]:
    """Measure at the poses of the sweep, on the configured devices or in the emulated cell, and move back to the
    start.

    `tell` receives progress messages. Raises SafetyStop if a limit is exceeded, and the errors of a run
    (BridgeError).
    """
    frames: list[WrenchFrame] = []

    async def main() -> list[ToolPose]:
        clock = Clock.running()
        try:
            log = CallbackLog(frames.append, lambda kind, text: tell(f"{kind}: {text}"))
            async with open_devices(Setup(config), clock, log) as devices:
                return await _Measuring(config, clock, _Cell(devices, frames), sweep, tell)()
        finally:
            clock.close()

    return (run_virtual if virtual else run_real)(main)


class _Cell(NamedTuple):
    """Devices of the cell that have been started."""

    devices: Devices
    frames: list[WrenchFrame]
    """Sensor frames received since the sweep last cleared this list."""


class _Measuring:
    """Sweep with a robot link and a force sensor that have been started. It can be called once."""

    def __init__(self, config: Config, clock: Clock, cell: _Cell, sweep: Sweep, tell: Tell) -> None:
        self._config, self._clock = config, clock
        self._robot, self._sensor = cell.devices.robot, cell.devices.sensor
        self._frames = cell.frames
        self._sweep = sweep
        self._tell = tell
        self._supervisor = Supervisor(config.limits)
        self._wrist = wrist(config)
        self._decided_at: float | None = None
        """Time of the newest decision, s; None before the first decision."""
        self._state: SupervisorState
        self._start: RobotReport
        self._at_start: tuple[float, ...]

    async def __call__(self) -> list[ToolPose]:
        await bring_up(self._robot, self._sensor)
        self._start = start = await self._robot.report()
        upright = _unit(start.pose.quaternion)
        self._state = self._supervisor.initial(start.pose.position)
        lifted = self._lift_position()
        self._at_start, _ = await self._average()
        poses = []
        still = self._sweep.settle_s + self._sweep.average_s + TIME_CONSTANTS * self._sensor.delay
        speed = self._config.robot.velocity_mm_s * 1e-3
        bounds = turning_bounds(
            self._config, self._robot.facts, math.radians(self._sweep.angle_deg), start.pose
        )
        limits = MotionLimits(speed, give_up_after=GIVE_UP_AFTER_S + still, bounds=bounds)
        try:
            async with self._robot.motion(limits) as motion:
                await self._move(motion, lifted, upright)
                orientations = self._sweep.orientations(upright)
                for number, orientation in enumerate(orientations, 1):
                    await self._move(motion, lifted, orientation)
                    mean, spread = await self._average()
                    rests = (
                        await self._robot.report()
                    )  # on arrival, the robot was still moving through the last tenth of a degree
                    poses.append(ToolPose(rests.pose.quaternion, mean, spread))
                    self._tell(f"pose {number} of {len(orientations)} measured")
                await self._move(motion, start.pose.position, upright)
        except BridgeError:
            self._tell(
                f"left: where it stopped, up to {self._sweep.lift_mm:g} mm above its start and turned by up to "
                f"{self._sweep.angle_deg:g}°; jog the tool back before the next attempt"
            )
            raise
        return poses

    def _lift_position(self) -> Vector:
        """Return the position at which the tool turns. Raises ConfigError if it is outside the workspace."""
        away = self._sweep.lift_mm * 1e-3
        x, y, z = (
            p - away * n for p, n in zip(self._start.pose.position, self._config.frame.approach, strict=True)
        )
        if not self._supervisor.allows((x, y, z)):
            raise ConfigError(
                f"the tool cannot be lifted by {self._sweep.lift_mm:g} mm (--lift-mm): {x:.3f} {y:.3f} {z:.3f} m is "
                "outside the box of limits.workspace_…_m",
                cause=Cause.START,
            )
        return x, y, z

    async def _move(self, motion: Motion, position: Vector, orientation: Quaternion) -> RobotReport:
        """Move and turn in small supervised steps until the robot reports its arrival.

        Raises SafetyStop if a limit is exceeded, DeviceError if the robot does not arrive.
        """
        report = await self._robot.report()
        turned, began = _unit(report.pose.quaternion), self._clock.now()
        patience = began + ARRIVAL_S
        while not _is_there(report.pose, position, orientation):
            before = self._state.position, turned
            # A tool that only moves keeps its weight on the same axes, so its counts may well repeat.
            judged_from = max(self._sensor.unchanged_since, began) if turned != orientation else math.inf
            at = self._supervise(report, _step_to(self._state.position, position), judged_from)
            turned = _turn_to(turned, orientation)
            if (at, turned) != before:
                await motion.to(Pose(at, turned))
                await motion.settled()
                patience = self._clock.now() + ARRIVAL_S
            elif self._clock.now() > patience:
                distance_mm = math.dist(report.pose.position, position) * 1e3
                turn = math.degrees(angle_between(_unit(report.pose.quaternion), orientation))
                raise DeviceError(
                    f"robot on {self._robot.name} does not reach the ordered pose: it is {distance_mm:.1f} mm and "
                    f"{turn:.1f}° away",
                    remedy="check its controller, or turn the tool less (--angle-deg)",
                )
            report = await self._robot.report()
        return report

    def _supervise(self, report: RobotReport, target: Vector, judged_from: float) -> Vector:
        """Return the target after the supervisor's clamps, m. Raises SafetyStop if the supervisor stops.

        Repeated counts are judged from `judged_from` on, s. Forces are relative to the start. They include the
        effect of the still unknown weight during a turn.
        """
        frame, approach = self._sensor.newest, self._config.frame.approach
        quaternion = report.pose.quaternion
        assert frame is not None, "bringing up waits for the stream"
        self._sensor.check()
        change = [a - b for a, b in zip(self._sensor.wrench(frame), self._at_start, strict=True)]
        wrench = self._wrist.contact_wrench(change, quaternion, self._start.pose.quaternion)
        depth = sum((t - s) * n for t, s, n in zip(target, self._start.pose.position, approach, strict=True))
        now = self._clock.now()
        since, self._decided_at = now - (now if self._decided_at is None else self._decided_at), now
        sample = Sample(
            now=now,
            position=report.pose.position,
            force=force_along(approach, quaternion, wrench),
            resultant=math.hypot(*wrench[:3]),
            sensor_at=frame.at,
            sensor_sequence=frame.sequence,
            unchanged=max(frame.at - judged_from, 0.0),
            saturated=bool(self._sensor.saturated),
            fault=Reason(Cause.ROBOT_STATE, report.fault, report.remedy) if report.fault else None,
        )
        observation = Observation(sample, dt=since)
        self._state, verdict = self._supervisor.step(
            self._state, observation, Request(depth, target, approach)
        )
        if isinstance(verdict, Stop):
            reason = verdict.reason
            raise SafetyStop(
                f"stopped: {reason.text}",
                remedy=reason.remedy or (_BY_WEIGHT if reason.cause in _FORCE_CAUSES else ""),
                cause=reason.cause,
            )
        return verdict.position

    async def _average(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Return mean and standard deviation of the readings in the sensor frame, N and N·m, after the motion has
        settled.
        """
        settled_at = self._clock.now() + self._sweep.settle_s + TIME_CONSTANTS * self._sensor.delay
        await self._clock.sleep_until(settled_at)
        self._frames.clear()
        await self._clock.sleep_until(settled_at + self._sweep.average_s)
        self._sensor.check()
        if len(self._frames) < FRAMES_MIN:
            raise DeviceError(
                f"force sensor on {self._sensor.name} sent {len(self._frames)} frames in {self._sweep.average_s:g} s, "
                f"at least {FRAMES_MIN} are needed; average for longer (--average-s)"
            )
        axes = list(zip(*map(self._sensor.wrench, self._frames), strict=True))
        return tuple(map(statistics.fmean, axes)), tuple(map(statistics.pstdev, axes))


def _unit(quaternion: Quaternion) -> Quaternion:
    """Normalise an orientation, which is not exact because devices round it."""
    if math.hypot(*quaternion) < 0.5:
        raise DeviceError(f"the robot reports the orientation {quaternion}, which is invalid")
    return normalise(quaternion)


def _is_there(pose: Pose, position: Vector, orientation: Quaternion) -> bool:
    angle = angle_between(_unit(pose.quaternion), orientation)
    return angle <= ANGLE_TOLERANCE and math.dist(pose.position, position) <= POSITION_TOLERANCE_M


def _step_to(at: Vector, position: Vector) -> Vector:
    """Return the next point on the straight path to `position`, m."""
    distance, step = math.dist(at, position), Sweep.lift_step_mm * 1e-3
    if distance <= step:
        return position
    x, y, z = (a + (p - a) * step / distance for a, p in zip(at, position, strict=True))
    return x, y, z


def _turn_to(at: Quaternion, orientation: Quaternion) -> Quaternion:
    """Return the next orientation on the shortest turn to `orientation`."""
    here, there = Pose((0.0, 0.0, 0.0), at), Pose((0.0, 0.0, 0.0), orientation)
    return towards(here, there, 0.0, math.radians(Sweep.turn_step_deg)).quaternion
