"""Before the touch: what robot and sensor must show before a run trusts them, and the zero.

Nothing moves before the sensor reads the weight of the known tool. Then the tool moves a little away from the surface,
in small slow steps. The zero is taken only if the force does not change on that way and the reported position follows.
"""

import asyncio
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from hil_bridge.clock import Clock
from hil_bridge.control import (
    Peaks,
    Reading,
    Wrist,
    lift_fault,
    weight_fault,
    weight_reading,
)
from hil_bridge.control.course.sideways import Lever, is_vouched
from hil_bridge.control.course.touch import Doubt
from hil_bridge.control.course.zero import AXES, doubtful_axes, lost_forces, unverified_axes
from hil_bridge.control.geometry.frames import STANDARD_GRAVITY
from hil_bridge.control.geometry.wrist import NO_WRENCH
from hil_bridge.devices.robots.seam import Motion, RobotLink, RobotReport
from hil_bridge.devices.sensors.stream import ForceSensor
from hil_bridge.errors import Cause, ConfigError, DeviceError, SafetyStop
from hil_bridge.record.ending import Check
from hil_bridge.runs.axis_evidence import AxisEvidence, lever_of
from hil_bridge.runs.pace import metres
from hil_bridge.runs.small_steps import LIFT_SPEED_M_S, SmallSteps, numbers
from hil_bridge.runs.witness import OwnForce
from hil_bridge.settings.configuration import Config
from protocol.geometry import Quaternion, Vector, normalise, product, turn_about

ZERO_PATIENCE_S = 20.0
"""Chosen: how long a zero may take; a UART gateway is deaf for a second after every command, and repeats some."""


_ALONG_Z = Lever((0.0, 0.0, 1.0), (0.0, 0.0, 0.0))


@dataclass(frozen=True, slots=True)
class Zero:
    """Reading that was taken for zero, and the pose of that moment."""

    start: RobotReport
    """After the way to the zero: the start point of the run."""
    contact: tuple[float, ...]
    """Contact wrench in the tool frame that was subtracted in addition to known weight and bias, N and N·m."""

    @property
    def force(self) -> float:
        """Length of the force, N."""
        return math.hypot(*self.contact[:3])


def wrist(config: Config) -> Wrist:
    """Mounting of the sensor by this configuration, and the load below it."""
    sensor, tool = config.sensor, config.tool
    mounting = turn_about((0.0, 0.0, 1.0), math.radians(sensor.mounting_deg))
    return Wrist(
        orientation=product(sensor.quaternion, mounting),
        position=metres(sensor.position_mm),
        flip=sensor.flip_fx_mx,
        bias=(*sensor.bias_n, *sensor.bias_nm),
        mass=tool.mass_kg or 0.0,
        centre_of_gravity=metres(tool.centre_of_gravity_mm),
    )


def known_wrist(config: Config) -> Wrist | None:
    """Return the wrist with a tool of known weight, of the configuration or of the emulated cell.

    None for a sensor that the user leaves unchecked.
    Raises ConfigError for a real sensor whose tool is neither known nor left unchecked.
    """
    seen = wrist(config)
    if config.tool.mass_kg:  # what weighs nothing shows nothing
        return seen
    if config.sensor.unchecked:
        return None
    if not config.sensor.url:
        tool = config.cell.tool
        return replace(seen, mass=tool.mass_kg, centre_of_gravity=metres(tool.centre_of_gravity_mm))
    raise ConfigError(
        "the tool is not known, so the sensor cannot be checked before the robot moves: set tool.mass_kg "
        "(--tool-mass-kg; hil-bridge identify tool measures it), or sensor.unchecked = true (--unchecked) to take "
        "that on yourself",
        cause=Cause.UNKNOWN_TOOL,
    )


class Zeroing:
    """The checks of one run over devices that have been brought up; `say` is told what is worth an event."""

    def __init__(
        self,
        config: Config,
        clock: Clock,
        robot: RobotLink,
        sensor: ForceSensor,
        say: Callable[[str, Check], None],
    ) -> None:
        self._config, self._clock, self._robot, self._sensor = config, clock, robot, sensor
        self._say = say
        self._known = known_wrist(config)
        self._wrist = wrist(config)
        self._steps = SmallSteps(clock, robot, sensor)
        self.own_force = OwnForce(config.frame.approach)
        """The force that the robot itself feels, from where the zero is taken."""
        self._first: Reading
        self._before: Reading
        self._quaternion: Quaternion
        self._taken_off: tuple[float, ...] | None = NO_WRENCH
        """Contact wrench in the tool frame that the device's zero took off, N and N·m; None while that is not known."""

        self.axes = AxisEvidence(lever_of(config))
        """Evidence on the force axes that the weight does not verify."""
        self._lost: tuple[float, ...] = ()
        """As `lost_forces`."""
        self._tared = False
        """The device counts from its own zero."""

    async def weigh(self, start: RobotReport, ways: Sequence[Vector]) -> None:
        """See that the sensor is at rest and reads the tool's weight, with nothing moving. `ways` are the directions in
        which the run goes across the approach, unit vectors, base frame.

        Raises DeviceError with the axis and what it looks like, and ConfigError for an axis that nothing verifies.
        """
        self._say(self._told_facts(), Check.FACTS)
        self._quaternion = normalise(start.pose.quaternion)
        self._first = self._before = await self._steps.steady(self._config.task.zero_change_n)
        limits, frame = self._config.limits, self._config.frame
        approach, quaternion = frame.approach, start.pose.quaternion
        unverified = unverified_axes(
            self._known, quaternion, limits.weight_tolerance_n, limits.weight_tolerance_nm
        )
        if unverified:
            names = " ".join(AXES[k] for k in unverified)
            self._say(f"not verified by the tool's weight: {names}", Check.UNVERIFIED)
        trusted = self._config.sensor.verified
        unverified = tuple(k for k in unverified if AXES[k].lower() not in trusted)
        self.axes.along = doubtful_axes(self._wrist, approach, quaternion, unverified)
        aside = [
            doubtful_axes(self._wrist, way, quaternion, unverified) for way in (frame.travel, frame.across)
        ]
        self.axes.across = tuple(sorted({k for axes in aside for k in axes}))
        self._lost = lost_forces(self._known, approach, quaternion)
        if self._known is None:
            self._say("sensor unchecked: the tool's weight is not known", Check.UNCHECKED)
            return
        expected = weight_reading(self._known, start.pose.quaternion)
        fault = weight_fault(
            self._before.mean, expected, limits.weight_tolerance_n, limits.weight_tolerance_nm
        )
        if fault:
            await self._robot.release(start)
            raise DeviceError(
                f"force sensor on {self._sensor.name}: {fault}",
                remedy=self._in_grams(start.pose.quaternion)
                or "nothing has moved, and hil-bridge free lifts off a tool that presses",
                cause=Cause.WEIGHT,
            )
        await self._refuse("the approach presses", self.axes.along, start, expected)
        open_ways = {
            k
            for way in ways
            if not self._is_vouched(way, quaternion)
            for k in doubtful_axes(self._wrist, way, quaternion, unverified)
        }
        await self._refuse("the run goes", sorted(open_ways), start, expected)

    def _is_vouched(self, way: Vector, quaternion: Quaternion) -> bool:
        """Whether moments tell a force in this direction, base frame. A tool whose end is not known is taken to point
        along its z axis.
        """
        (direction,) = self._wrist.at_orientation(quaternion, quaternion, way).directions
        x, y, z = direction
        return is_vouched(self.axes.lever or _ALONG_Z, (x, y, z))

    def _in_grams(self, quaternion: Quaternion) -> str:
        """Return a hint for a mass that seems to be in g; empty otherwise."""
        assert self._known is not None, "a weight is judged of a tool that is known"
        limits, lighter = self._config.limits, replace(self._known, mass=self._known.mass * 1e-3)
        expected = weight_reading(lighter, quaternion)
        shows = lighter.mass * STANDARD_GRAVITY > limits.weight_tolerance_n  # a dead sensor reads nothing too
        if not shows or weight_fault(
            self._before.mean, expected, limits.weight_tolerance_n, limits.weight_tolerance_nm
        ):
            return ""
        return f"nothing has moved; tool.mass_kg is in kg: did you mean {lighter.mass:g}?"

    async def _refuse(
        self, what: str, axes: Sequence[int], start: RobotReport, expected: Sequence[float]
    ) -> None:
        """Raise ConfigError for an axis that nothing has verified, unless the user accepts it. `what` says what goes
        along these axes.
        """
        sensor, limits = self._config.sensor, self._config.limits
        left = [AXES[k] for k in axes if AXES[k].lower() not in sensor.unverified]
        if not left or sensor.unchecked:
            return
        await self._robot.release(start)
        told = ", ".join(
            f"{AXES[k]} ({abs(expected[k] - self._wrist.bias[k]):.2f} N of weight)" for k in axes
        )
        names = ", ".join(f'"{name.lower()}"' for name in left)
        raise ConfigError(
            f"{what} on {told}, which the tool's weight does not verify: it takes more than "
            f"{limits.weight_tolerance_n:g} N (limits.weight_tolerance_n); correct tool.mass_kg, take a heavier tool, "
            "hold it so that its weight lies there, let `identify tool` verify the axes (sensor.verified), or take "
            f"it on with sensor.unverified = [{names}] (--unverified {left[0].lower()}): then each touch is tested, "
            f"and an approach goes at most {self._config.task.unverified_depth_mm:g} mm (task.unverified_depth_mm)",
            cause=Cause.UNVERIFIED_AXIS,
        )

    def doubt(self, force: float) -> Doubt:
        """Why a touch that shows with this force along the approach, N, must be proven."""
        if self.axes.along:
            return Doubt.AXIS
        threshold, near = self._config.task.contact_threshold_n, self._config.task.zero_change_n
        if any(lost > threshold and abs(force - lost) <= near for lost in self._lost):
            return Doubt.WEIGHT
        return Doubt.NONE

    def _told_facts(self) -> str:
        facts = self._sensor.facts
        told = "not told" if facts.full_scales is None else f"{numbers(facts.full_scales)} N, N·m"
        return f"full scales {told}{facts.model and f'; {facts.model}'}"

    def judge_at_rest(self) -> Peaks | None:
        """Return the reference for the contact force from here on, beside the zero; None if it cannot be known.

        It cannot be known without the tool's weight, and while the device may or may not have taken its zero.
        """
        if self._known is None or self._taken_off is None or not self._sensor.is_ready:
            return None
        frame, turned = self._config.frame, self._quaternion
        wrist = self._known.at_orientation(
            turned, turned if self._tared else None, frame.approach, frame.travel
        )
        peaks = Peaks(wrist, self._sensor.facts.scales)
        peaks.rezero([-value for value in self._taken_off])
        return peaks

    async def take(self, motion: Motion, start: RobotReport, interrupted: Callable[[], bool]) -> Zero | None:
        """Move away by `task.zero_lift_mm`, and take the zero there.

        Raises SafetyStop with what forbids it. None where `interrupted` has ended the way early.
        """
        lifted = await self._lift(motion, start, interrupted)
        if interrupted():
            return None
        before = self._before
        quaternion = normalise(start.pose.quaternion)
        contact = (0.0,) * 6
        if self._config.sensor.tare:
            reference = self._known or self._wrist
            contact = tuple(reference.contact_wrench(before.mean, quaternion, None).tolist())
            zero = Zero(lifted, contact)
            if zero.force > self._config.limits.zero_max_n:
                raise SafetyStop(
                    f"{zero.force:.1f} N would be taken for zero, allowed are {self._config.limits.zero_max_n:g} N "
                    "(limits.zero_max_n): free the tool, or let `identify tool` find its weight and the sensor's bias",
                    cause=Cause.ZERO,
                )
            self._taken_off = None
            try:
                async with asyncio.timeout(ZERO_PATIENCE_S):
                    await self._sensor.tare()
                    await self._sensor.frame()
                self._judge_zero()
                self._taken_off, self._tared = contact, True
            except TimeoutError:
                raise SafetyStop(
                    f"force sensor on {self._sensor.name} did not stream again within {ZERO_PATIENCE_S:g} s of its "
                    "zero",
                    cause=Cause.ZERO_SILENT,
                ) from None
            text = f"zero taken: {numbers(before.mean)} N, N·m; {zero.force:.2f} N of it unexplained"
            self._say(text, Check.ZERO)
        return Zero(lifted, contact)

    def _judge_zero(self) -> None:
        """Raise SafetyStop when the force changed between the reading and the zero."""
        frame, change_n = self._sensor.zeroed_from, self._config.task.zero_change_n
        if frame is None:
            return
        force = self._sensor.wrench(frame)[:3]
        # a receiver board tells of its zero when frames count from it already
        change = min(math.dist(force, self._before.mean[:3]), math.hypot(*force))
        if change > change_n:
            raise SafetyStop(
                f"the force changed by {change:.1f} N while the zero was taken: let nothing touch the tool",
                cause=Cause.ZERO_CHANGED,
            )

    async def _lift(self, motion: Motion, start: RobotReport, interrupted: Callable[[], bool]) -> RobotReport:
        """Move to the place of the zero, step by step; return where the robot is at its end."""
        task, approach = self._config.task, self._config.frame.approach
        step = min(task.zero_step_mm, task.single_step_mm)
        count = math.ceil(task.zero_lift_mm / step - 1e-9)
        report, orientation, speed = start, start.pose.quaternion, motion.speed
        motion.speed = min(speed, LIFT_SPEED_M_S)
        for number in range(1, count + 1):
            if interrupted():
                break
            away = min(number * step, task.zero_lift_mm) * 1e-3
            x, y, z = (s - away * n for s, n in zip(start.pose.position, approach, strict=True))
            report = await self._steps.to(motion, (x, y, z), orientation, step * 1e-3)
            after = await self._steps.quiet()
            self._judge(after, start, away)
            self._before = after
            self.own_force.add_zero_sample(report)
        motion.speed = speed
        return report

    def _judge(self, after: Reading, start: RobotReport, away: float) -> None:
        """Raise SafetyStop when the force has changed on the way."""
        quaternion, known = normalise(start.pose.quaternion), self._known
        forces = [
            (known or self._wrist).contact_wrench(seen.mean, quaternion, None)[:3].tolist()
            for seen in (self._first, after)
        ]
        before, later = (math.hypot(*force) if known else None for force in forces)
        change_n = self._config.task.zero_change_n
        text = lift_fault(math.dist(*forces), before, later, change_n, away * 1e3)
        if text:
            raise SafetyStop(text, cause=Cause.TOUCHING)
