"""Measuring what hangs below the sensor: hold the tool in several ways, free in space, and average the readings.

The shell around the pure `identify_tool`. No zero is taken: it would hide the weight and the sensor's bias.
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
"""Reported position this near to the ordered one counts as there. Chosen: four steps of a coarse robot."""
ANGLE_TOLERANCE = math.radians(0.1)
"""The same for the orientation, rad. Chosen: coarser than a robot rounds what it reports."""
ARRIVAL_S = 10.0
"""Chosen: how long after the last order the robot may take to report to be there."""
FRAMES_MIN = 10
"""Fewest frames to average. Chosen."""
TIME_CONSTANTS = 7.0
"""Time constants of the sensor's filter, beside the settling. Derived: after as many less than 0.1 % is left."""
USUAL_DEG = 30.0
"""Chosen: turn of a sweep where an operator asks for none."""
_LESS_DEG = (25.0, 20.0, 15.0)
"""Chosen: turns that are tried where the arm does not reach the usual one; the least tells a centre of gravity."""
_BELOW_LIMIT = 0.95
"""Chosen: share of a client's limit that a sweep uses, so that it is not met by noise."""
_OF_FORCE = frozenset({Cause.FORCE, Cause.RESULTANT_FORCE, Cause.PULL, Cause.SATURATED})
"""Stops that the weight of a tool can bring about, which is not known yet."""
_BY_WEIGHT = "free the tool, or raise the limit if its weight alone does this"


@dataclass(frozen=True, slots=True)
class Sweep:
    """How the tool is turned. All of it is chosen."""

    angle_deg: float = USUAL_DEG
    """Turn about each level axis of the base, to either side of the start orientation."""
    lift_mm: float = 50.0
    """Way back from the surface, against the approach direction, before the first turn."""
    settle_s: float = 1.0
    """Wait at each pose before averaging, beside the filter's own time."""
    average_s: float = 1.0
    """Time over which readings are averaged."""
    lift_step_mm: ClassVar[float] = 1.0
    """Farthest move between two looks at the sensor."""
    turn_step_deg: ClassVar[float] = 2.0
    """Largest turn between two: about 10° a second over a slow link."""

    def orientations(self, start: Quaternion) -> tuple[Quaternion, ...]:
        """Return the start orientation, to either side about two level axes, and the start again, which shows drift."""
        tilts = [
            product(turn_about(axis, math.radians(angle)), start)
            for axis in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
            for angle in (self.angle_deg, -self.angle_deg)
        ]
        return (start, *tilts, start)


def choose_angle(setup: Setup, asked_deg: float | None, lift_mm: float) -> float:
    """Angle of the sweep, degrees: the one that an operator asks for, else the usual one, or as much as the robot can.

    What a robot can is known of its client's limit, and of the arm of an emulated one. Raises ConfigError where it
    cannot turn so far.
    """
    usual = USUAL_DEG
    turn = setup.robot.kind.largest_turn
    most = math.inf if turn is None else _BELOW_LIMIT * math.degrees(turn(setup.robot.settings))
    choices = [usual, *_LESS_DEG] if asked_deg is None else [asked_deg]
    if asked_deg is None and min(choices) <= most < usual:
        choices.append(most)
    for angle in sorted(choices, reverse=True):
        if angle <= most and _arm_holds(setup, Sweep(angle, lift_mm)):
            return angle
    if min(choices) > most:
        raise ConfigError(
            f"the tool cannot be turned by {min(choices):g}° (--angle-deg): the robot's client turns it by less than "
            f"{most / _BELOW_LIMIT:g}°; raise that limit of [robot.{setup.robot.kind.name}]"
        )
    raise ConfigError(
        f"the tool cannot be turned by {min(choices):g}° (--angle-deg): the emulated arm does not reach so far; turn "
        "it less, or begin where it has more room (cell.start_position_mm, --lift-mm)"
    )


def _arm_holds(setup: Setup, sweep: Sweep) -> bool:
    """Whether an emulated arm holds each pose of the sweep; of a real one that is not known, and taken for true."""
    if not setup.robot.is_emulated:
        return True
    cell, away = setup.config.cell, sweep.lift_mm * 1e-3
    start = zip(cell.start_position_mm, setup.config.frame.approach, strict=True)
    x, y, z = (p * 1e-3 - away * n for p, n in start)
    return all(can_hold(setup, (x, y, z), turned) for turned in sweep.orientations(cell.start_quaternion))


def measure(config: Config, virtual: bool, sweep: Sweep, tell: Tell) -> list[ToolPose]:
    """Move through the sweep's poses, on the configuration's ports or on the emulated cell, and back to the start.

    `tell` is given a line of progress now and then. Raises SafetyStop when a limit was met, and BridgeError as a
    run does.
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
    """Devices that have been started."""

    devices: Devices
    frames: list[WrenchFrame]
    """Frames of the sensor so far; the sweep empties it."""


class _Measuring:
    """One sweep over a robot link and a force sensor that have been started; call it once."""

    def __init__(self, config: Config, clock: Clock, cell: _Cell, sweep: Sweep, tell: Tell) -> None:
        self._config, self._clock = config, clock
        self._robot, self._sensor = cell.devices.robot, cell.devices.sensor
        self._frames = cell.frames
        self._sweep = sweep
        self._tell = tell
        self._supervisor = Supervisor(config.limits)
        self._wrist = wrist(config)
        self._decided_at: float | None = None
        """Time of the newest decision, s; None before the first."""
        self._state: SupervisorState
        self._start: RobotReport
        self._at_start: tuple[float, ...]

    async def __call__(self) -> list[ToolPose]:
        await bring_up(self._robot, self._sensor)
        self._start = start = await self._robot.report()
        upright = _unit(start.pose.quaternion)
        self._state = self._supervisor.initial(start.pose.position)
        lifted = self._lifted()
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
                await self._go(motion, lifted, upright)
                orientations = self._sweep.orientations(upright)
                for number, orientation in enumerate(orientations, 1):
                    await self._go(motion, lifted, orientation)
                    mean, spread = await self._average()
                    rests = (
                        await self._robot.report()
                    )  # on arrival it was still on the last tenth of a degree
                    poses.append(ToolPose(rests.pose.quaternion, mean, spread))
                    self._tell(f"pose {number} of {len(orientations)} measured")
                await self._go(motion, start.pose.position, upright)
        except BridgeError:
            self._tell(
                f"left: where it stopped, up to {self._sweep.lift_mm:g} mm above its start and turned by up to "
                f"{self._sweep.angle_deg:g}°; jog the tool back before the next try"
            )
            raise
        return poses

    def _lifted(self) -> Vector:
        """Where the tool is turned. Raises ConfigError when that is outside the workspace."""
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

    async def _go(self, motion: Motion, position: Vector, orientation: Quaternion) -> RobotReport:
        """Move and turn in small steps, each supervised, until the robot reports to be there.

        Raises SafetyStop for a limit, DeviceError when the robot does not come.
        """
        report = await self._robot.report()
        turned, began = _unit(report.pose.quaternion), self._clock.now()
        patience = began + ARRIVAL_S
        while not _is_there(report.pose, position, orientation):
            before = self._state.position, turned
            # A tool that only moves keeps its weight on the same axes, so its counts may well repeat.
            judged_from = max(self._sensor.unchanged_since, began) if turned != orientation else math.inf
            at = self._supervised(report, _step_to(self._state.position, position), judged_from)
            turned = _turn_to(turned, orientation)
            if (at, turned) != before:
                await motion.to(Pose(at, turned))
                await motion.settled()
                patience = self._clock.now() + ARRIVAL_S
            elif self._clock.now() > patience:
                way = math.dist(report.pose.position, position) * 1e3
                turn = math.degrees(angle_between(_unit(report.pose.quaternion), orientation))
                raise DeviceError(
                    f"robot on {self._robot.name} does not reach the ordered pose: it stands {way:.1f} mm and "
                    f"{turn:.1f}° from it",
                    remedy="look at its controller, or turn the tool less (--angle-deg)",
                )
            report = await self._robot.report()
        return report

    def _supervised(self, report: RobotReport, target: Vector, judged_from: float) -> Vector:
        """Return the target after the supervisor's clamps, m. Raises SafetyStop for its stop.

        Counts that repeat are judged from that moment on, s. Forces are those that came since the start; what the
        weight adds by turning is not known yet and part of them.
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
                remedy=reason.remedy or (_BY_WEIGHT if reason.cause in _OF_FORCE else ""),
                cause=reason.cause,
            )
        return verdict.position

    async def _average(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Mean reading and standard deviation of its frames, sensor frame, N and N·m, once all has come to rest."""
        settled = self._clock.now() + self._sweep.settle_s + TIME_CONSTANTS * self._sensor.delay
        await self._clock.sleep_until(settled)
        self._frames.clear()
        await self._clock.sleep_until(settled + self._sweep.average_s)
        self._sensor.check()
        if len(self._frames) < FRAMES_MIN:
            raise DeviceError(
                f"force sensor on {self._sensor.name} sent {len(self._frames)} frames in {self._sweep.average_s:g} s, "
                f"{FRAMES_MIN} are the least to average; average for longer (--average-s)"
            )
        axes = list(zip(*map(self._sensor.wrench, self._frames), strict=True))
        return tuple(map(statistics.fmean, axes)), tuple(map(statistics.pstdev, axes))


def _unit(quaternion: Quaternion) -> Quaternion:
    """Device words are rounded; turns are calculated with unit length."""
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
