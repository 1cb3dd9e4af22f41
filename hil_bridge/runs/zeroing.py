"""Checks of robot and sensor before a run relies on them, and the zero.

The robot does not move before the sensor reads the weight of the known tool. Then the tool moves a little away from
the surface, in small slow steps. The zero is taken only if the force does not change during this motion and the
reported position follows it.
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
from hil_bridge.control.course.sideways import Lever, is_confirmed_by_moments
from hil_bridge.control.course.touch import Doubt
from hil_bridge.control.course.zero import AXES, doubtful_axes, lost_forces, unverified_axes
from hil_bridge.control.geometry.frames import STANDARD_GRAVITY
from hil_bridge.control.geometry.wrist import NO_WRENCH
from hil_bridge.devices.robots.seam import Motion, RobotLink, RobotReport
from hil_bridge.devices.sensors.stream import ForceSensor
from hil_bridge.errors import Cause, ConfigError, DeviceError, SafetyStop
from hil_bridge.record.analysis.definition import concise
from hil_bridge.record.ending import Check
from hil_bridge.runs.axis_evidence import AxisEvidence, lever_of
from hil_bridge.runs.pace import metres
from hil_bridge.runs.small_steps import LIFT_SPEED_M_S, SmallSteps
from hil_bridge.runs.witness import OwnForce
from hil_bridge.settings.configuration import Config
from protocol.geometry import Quaternion, Vector, normalise, product, turn_about

ZERO_PATIENCE_S = 20.0
"""Time limit for the device to take a zero, s. Chosen: a UART gateway is unresponsive for a second after every
command, and repeats some commands.
"""


_ALONG_Z = Lever((0.0, 0.0, 1.0), (0.0, 0.0, 0.0))


@dataclass(frozen=True, slots=True)
class Zero:
    """Reading used as the zero, and the pose at which it was taken."""

    start: RobotReport
    """Start point of the run, after the motion to the zero."""
    contact: tuple[float, ...]
    """Contact wrench in the tool frame that was subtracted in addition to the known weight and bias, N and N·m."""

    @property
    def force(self) -> float:
        """Magnitude of the force, N."""
        return math.hypot(*self.contact[:3])


def wrist(config: Config) -> Wrist:
    """Return the mounting of the sensor, and the load below it, from the configuration."""
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
    """Return the wrist with a tool of known weight, from the configuration or the emulated cell.

    Returns None for a sensor that the user leaves unchecked. Raises ConfigError for a real sensor whose tool is
    neither known nor left unchecked.
    """
    mounting = wrist(config)
    if config.tool.mass_kg:  # a tool without weight verifies nothing
        return mounting
    if config.sensor.unchecked:
        return None
    if not config.sensor.url:
        tool = config.cell.tool
        return replace(mounting, mass=tool.mass_kg, centre_of_gravity=metres(tool.centre_of_gravity_mm))
    raise ConfigError(
        "the tool load is not known, so the sensor cannot be checked before the robot moves: set tool.mass_kg "
        "(--tool-mass-kg; hil-bridge identify tool measures it), or sensor.unchecked = true (--unchecked) to "
        "accept that risk",
        cause=Cause.UNKNOWN_TOOL,
    )


class Zeroing:
    """Checks of one run on devices that have been brought up. `say` is called with each event."""

    def __init__(
        self,
        config: Config,
        clock: Clock,
        robot: RobotLink,
        sensor: ForceSensor,
        say: Callable[[str, Check], None],
    ) -> None:
        self._config, self._clock, self._robot, self._sensor = config, clock, robot, sensor
        self._report = say
        self._known_wrist = known_wrist(config)
        self._wrist = wrist(config)
        self._steps = SmallSteps(clock, robot, sensor)
        self.own_force = OwnForce(config.frame.approach)
        """Force measured by the robot itself, relative to the position where the zero is taken."""
        self._first: Reading
        self._before: Reading
        self._quaternion: Quaternion
        self._zero_offset: tuple[float, ...] | None = NO_WRENCH
        """Contact wrench in the tool frame that the device's zero removed, N and N·m; None if unknown."""

        self.axes = AxisEvidence(lever_of(config))
        """Evidence on the force axes that the weight does not verify."""
        self._lost: tuple[float, ...] = ()
        """Forces along the approach that the sensor would report after losing the tool's weight, N; see
        `lost_forces`.
        """
        self._tared = False
        """Whether the device measures relative to its own zero."""

    async def weigh(self, start: RobotReport, ways: Sequence[Vector]) -> None:
        """Check that the sensor is steady and reads the tool's weight, without motion.

        `ways` holds the directions in which the run moves across the approach, as unit vectors in the base frame.
        Raises DeviceError with the axis and its likely fault, and ConfigError for an axis that nothing verifies.
        """
        self._report(self._facts_text(), Check.FACTS)
        self._quaternion = normalise(start.pose.quaternion)
        self._first = self._before = await self._steps.steady(self._config.task.zero_change_n)
        limits, frame = self._config.limits, self._config.frame
        approach, quaternion = frame.approach, start.pose.quaternion
        unverified = unverified_axes(
            self._known_wrist, quaternion, limits.weight_tolerance_n, limits.weight_tolerance_nm
        )
        if unverified:
            names = " ".join(AXES[k] for k in unverified)
            self._report(f"not verified by the tool's weight: {names}", Check.UNVERIFIED)
        trusted = self._config.sensor.verified
        unverified = tuple(k for k in unverified if AXES[k].lower() not in trusted)
        self.axes.along = doubtful_axes(self._wrist, approach, quaternion, unverified)
        aside = {
            direction: doubtful_axes(self._wrist, direction, quaternion, unverified)
            for direction in (frame.travel, frame.across)
        }
        confirmable = {one for one in (*aside, *ways) if self._is_confirmed_by_moments(one, quaternion)}
        self.axes.across = tuple(sorted({k for axes in aside.values() for k in axes}))
        self.axes.unconfirmable = tuple(
            sorted({k for one, axes in aside.items() if one not in confirmable for k in axes})
        )
        self._lost = lost_forces(self._known_wrist, approach, quaternion)
        if self._known_wrist is None:
            self._report("sensor unchecked: the tool's weight is not known", Check.UNCHECKED)
            return
        expected = weight_reading(self._known_wrist, start.pose.quaternion)
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
        unconfirmed = {
            k
            for direction in ways
            if direction not in confirmable
            for k in doubtful_axes(self._wrist, direction, quaternion, unverified)
        }
        await self._refuse("the run goes", sorted(unconfirmed), start, expected)

    def _is_confirmed_by_moments(self, axis: Vector, quaternion: Quaternion) -> bool:
        """Return whether moments show a force in the given direction, base frame. A tool whose end is unknown is
        assumed to point along its z axis.
        """
        (direction,) = self._wrist.at_orientation(quaternion, quaternion, axis).directions
        x, y, z = direction
        return is_confirmed_by_moments(self.axes.lever or _ALONG_Z, (x, y, z))

    def _in_grams(self, quaternion: Quaternion) -> str:
        """Return a hint for a mass that seems to be in g; otherwise an empty text."""
        assert self._known_wrist is not None, "a weight is judged of a tool that is known"
        limits, lighter = self._config.limits, replace(self._known_wrist, mass=self._known_wrist.mass * 1e-3)
        expected = weight_reading(lighter, quaternion)
        shows = lighter.mass * STANDARD_GRAVITY > limits.weight_tolerance_n  # a dead sensor also reads 0
        if not shows or weight_fault(
            self._before.mean, expected, limits.weight_tolerance_n, limits.weight_tolerance_nm
        ):
            return ""
        return f"nothing has moved; tool.mass_kg is in kg: did you mean {lighter.mass:g}?"

    async def _refuse(
        self, what: str, axes: Sequence[int], start: RobotReport, expected: Sequence[float]
    ) -> None:
        """Raise ConfigError for an axis that nothing has verified, unless the user accepts it. `what` describes the
        use of the axes.
        """
        sensor, limits = self._config.sensor, self._config.limits
        left = [AXES[k] for k in axes if AXES[k].lower() not in sensor.unverified]
        if not left or sensor.unchecked:
            return
        await self._robot.release(start)
        axes_text = ", ".join(
            f"{AXES[k]} ({abs(expected[k] - self._wrist.bias[k]):.2f} N of weight)" for k in axes
        )
        names = ", ".join(f'"{name.lower()}"' for name in left)
        raise ConfigError(
            f"{what} on {axes_text}, which the tool's weight does not verify: it takes more than "
            f"{limits.weight_tolerance_n:g} N (limits.weight_tolerance_n); correct tool.mass_kg, use a heavier tool, "
            "orient it so that its weight acts there, let `identify tool` verify the axes (sensor.verified), or "
            f"accept it with sensor.unverified = [{names}] (--unverified {left[0].lower()}): each touch is then "
            f"confirmed, and an approach moves at most {self._config.task.unverified_depth_mm:g} mm "
            "(task.unverified_depth_mm)",
            cause=Cause.UNVERIFIED_AXIS,
        )

    def doubt(self, force: float) -> Doubt:
        """Return the reason why a touch with the given force along the approach, N, must be confirmed."""
        if self.axes.along:
            return Doubt.AXIS
        threshold, near = self._config.task.contact_threshold_n, self._config.task.zero_change_n
        if any(lost > threshold and abs(force - lost) <= near for lost in self._lost):
            return Doubt.WEIGHT
        return Doubt.NONE

    def _facts_text(self) -> str:
        facts = self._sensor.facts
        scales = "not told" if facts.full_scales is None else _wrench_text(facts.full_scales)
        return f"full scales {scales}{facts.model and f'; {facts.model}'}"

    def judge_at_rest(self) -> Peaks | None:
        """Return the reference for the contact force from now on, in addition to the zero; None if it is unknown.

        It is unknown if the tool's weight is unknown, or while the device may or may not have taken its zero.
        """
        if self._known_wrist is None or self._zero_offset is None or not self._sensor.is_ready:
            return None
        frame, turned = self._config.frame, self._quaternion
        wrist = self._known_wrist.at_orientation(
            turned, turned if self._tared else None, frame.approach, frame.travel
        )
        peaks = Peaks(wrist, self._sensor.facts.scales)
        peaks.rezero([-value for value in self._zero_offset])
        return peaks

    async def take(self, motion: Motion, start: RobotReport, interrupted: Callable[[], bool]) -> Zero | None:
        """Move away by `task.zero_lift_mm`, and take the zero there.

        Raises SafetyStop with the reason if the zero must not be taken. Returns None if `interrupted` has ended the
        motion early.
        """
        lifted = await self._lift(motion, start, interrupted)
        if interrupted():
            return None
        before = self._before
        quaternion = normalise(start.pose.quaternion)
        contact = (0.0,) * 6
        if self._config.sensor.tare:
            reference = self._known_wrist or self._wrist
            contact = tuple(reference.contact_wrench(before.mean, quaternion, None).tolist())
            zero = Zero(lifted, contact)
            if zero.force > self._config.limits.zero_max_n:
                raise SafetyStop(
                    f"{zero.force:.1f} N would be used as the zero, allowed: at most "
                    f"{self._config.limits.zero_max_n:g} N (limits.zero_max_n): "
                    "free the tool, or let `identify tool` find its weight and the sensor's bias",
                    cause=Cause.ZERO,
                )
            self._zero_offset = None
            try:
                async with asyncio.timeout(ZERO_PATIENCE_S):
                    await self._sensor.tare()
                    await self._sensor.frame()
                self._judge_zero()
                self._zero_offset, self._tared = contact, True
            except TimeoutError:
                raise SafetyStop(
                    f"force sensor on {self._sensor.name} did not stream again within {ZERO_PATIENCE_S:g} s of its "
                    "zero",
                    cause=Cause.ZERO_SILENT,
                ) from None
            force, moment = (
                concise(math.hypot(*part), 1, ".2f", "") for part in (before.mean[:3], before.mean[3:])
            )
            text = f"zero taken: {force} N, {moment} N·m; {zero.force:.2f} N unexplained"
            self._report(text, Check.ZERO)
        return Zero(lifted, contact)

    def _judge_zero(self) -> None:
        """Raise SafetyStop if the force changed between the reading and the zero."""
        frame, change_n = self._sensor.zeroed_from, self._config.task.zero_change_n
        if frame is None:
            return
        force = self._sensor.wrench(frame)[:3]
        # a receiver board reports its zero after frames are already relative to it
        change = min(math.dist(force, self._before.mean[:3]), math.hypot(*force))
        if change > change_n:
            raise SafetyStop(
                f"the force changed by {change:.1f} N while the zero was taken: keep the tool free of contact",
                cause=Cause.ZERO_CHANGED,
            )

    async def _lift(self, motion: Motion, start: RobotReport, interrupted: Callable[[], bool]) -> RobotReport:
        """Move to the position of the zero in small steps, and return the robot's final position."""
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
        """Raise SafetyStop if the force has changed during the motion."""
        quaternion, known = normalise(start.pose.quaternion), self._known_wrist
        forces = [
            (known or self._wrist).contact_wrench(reading_after.mean, quaternion, None)[:3].tolist()
            for reading_after in (self._first, after)
        ]
        before, later = (math.hypot(*force) if known else None for force in forces)
        change_n = self._config.task.zero_change_n
        text = lift_fault(math.dist(*forces), before, later, change_n, away * 1e3)
        if text:
            raise SafetyStop(text, cause=Cause.TOUCHING)


def _wrench_text(values: Sequence[float]) -> str:
    """Return forces, N, and moments, N·m, as text for operators, with at most three significant digits."""
    parts = [concise(value, 1, "z.2f", "") for value in values]
    return f"{' '.join(parts[:3])} N, {' '.join(parts[3:])} N·m"
