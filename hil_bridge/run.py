"""One run of the closed loop: connect, tare, then cycle by cycle status → force → decision → move → record.

The shell around the pure `ControlLoop`: it stamps the hops, hands data one way along them, and waits for
nothing but the robot's answers.
"""

import math
from collections.abc import AsyncIterator
from typing import Any, Protocol

from hil_bridge.clock import Clock
from hil_bridge.config import Config
from hil_bridge.control import (
    Command,
    ControlLoop,
    Decision,
    Facing,
    Phase,
    Sample,
    Supervisor,
    Task,
    Wrist,
    in_numbers,
    make_controller,
    quaternion_about,
    quaternion_product,
)
from hil_bridge.devices import ForceSensor, Motion, RobotLink
from hil_bridge.errors import BridgeError, DeviceError
from hil_bridge.line_time import answer_time
from hil_bridge.recording import PHASE_EVENT, STOP_EVENT, CycleRecord, EventRecord, Outcome
from protocol.arap import Quaternion, Status, Vector
from protocol.jr3 import AXES, SensorFrame
from protocol.values import dataclass

TIME_IS_UP = "time is up"
"""Why a run ends that went as it was meant to."""
MAIN_SHARE = 0.5
"""Of the approach direction on an axis of the sensor, from which that axis matters. Chosen: tilted by less than 60°."""


_APPROACH, _TRAVEL = 0, 1
"""Directions in which the contact force is taken, by their place in `Facing.directions`."""


class Log(Protocol):
    """Where a run puts what it knows; must not block."""

    def cycle(self, record: CycleRecord) -> None:
        """A cycle has ended."""

    def event(self, record: EventRecord) -> None:
        """Something happened beside the cycles."""


@dataclass(frozen=True, slots=True)
class RunResult:
    """How a run ended."""

    outcome: Outcome
    cause: str = ""
    left: str = ""
    """Where the tool was left, in words; empty when it never moved."""
    followed: tuple[str, ...] = ()
    """What happened after the cause, in order."""


def control_loop(config: Config) -> ControlLoop:
    """All that decides in a run with this configuration. Raises ConfigError for an unfit parameter."""
    controller = make_controller(config.controller.name, **config.controller.parameters)
    return ControlLoop(
        Task(config.task, controller, config.limits.force_limit_n),
        Supervisor(config.limits),
        config.frame.approach,
        config.frame.travel,
        config.oscillation if config.limits.oscillation_guard else None,
        config.frame.contour if config.frame.follow_normal else None,
    )


def wrist(config: Config) -> Wrist:
    """How this configuration says that the sensor sits, and what hangs below it."""
    sensor, tool = config.sensor, config.tool
    mounting = quaternion_about((0.0, 0.0, 1.0), math.radians(sensor.mounting_deg))
    return Wrist(
        quaternion_product(sensor.quaternion, mounting),
        _metres(sensor.position_mm),
        sensor.flip_fx_mx,
        (*sensor.bias_n, *sensor.bias_nm),
        tool.mass_kg,
        _metres(tool.centre_of_gravity_mm),
    )


def _metres(vector_mm: Vector) -> Vector:
    x, y, z = vector_mm
    return x * 1e-3, y * 1e-3, z * 1e-3


async def bring_up(robot: RobotLink, sensor: ForceSensor) -> None:
    """Robot in operation, sensor streaming. Raises DeviceError with what stands against it."""
    status = await robot.read_status()
    if status.emergency_stop:
        raise DeviceError(f"robot on {robot.name} is in emergency stop; release it at the controller's panel")
    if not status.operation:
        await robot.to_operation()
    await sensor.ready()


class Run:
    """A run over a robot link and a force sensor that have been started; call it once."""

    def __init__(self, config: Config, clock: Clock, robot: RobotLink, sensor: ForceSensor, log: Log) -> None:
        self._config = config
        self._clock = clock
        self._robot = robot
        self._sensor = sensor
        self._log = log
        self._wrist = wrist(config)
        self._loop = control_loop(config)
        self._answer_time = answer_time(robot.profile)
        self._filter_delay = sensor.delay
        self._quaternion_tare: Quaternion | None = None
        self._faced: tuple[tuple[int, ...], Facing] | None = None
        self._interrupted = False
        self._phase = ""
        self.moving = False
        """A movement sequence is under way: only `interrupt` may end it, not cancellation."""

    def interrupt(self) -> None:
        """Retract from the next cycle on, and end."""
        self._interrupted = True

    async def __call__(self) -> RunResult:
        """The whole run. Raises BridgeError when a device fails before the movement has begun."""
        self._enter("connect")
        await bring_up(self._robot, self._sensor)
        tare = self._config.sensor.tare
        if tare:
            self._enter("tare")
            await self._sensor.tare()
        start = await self._robot.read_status()
        await self._sensor.frame()
        self._quaternion_tare = start.quaternion if tare else None
        self.moving = True
        try:
            async with self._robot.motion(self._config.robot.velocity_mm_s * 1e-3) as motion:
                result = await self._cycles(motion, start)
        except BridgeError as error:
            result = self._stopped(str(error))
        self.moving = False
        self._enter("end")
        return result

    async def _cycles(self, motion: Motion, start: Status) -> RunResult:
        """The cycles between the start and the end of the movement sequence."""
        state = self._loop.initial(start.position)
        result = RunResult(Outcome.COMPLETED)
        track_ends = math.inf
        unpaced = not self._config.run.period_ms  # then an order is always followed by another at once
        async for cycle, started_at in self._beats():
            commanded_before = state.supervisor.depth
            status = await self._robot.read_status(announce=True)
            status_transmitted_at = self._robot.transmitted_at
            frame, decoded_at = self._frame(), self._sensor.decoded_at
            sample = self._sample(status, frame)
            asked = ""
            if self._interrupted and result.outcome is Outcome.COMPLETED:
                result = RunResult(Outcome.INTERRUPTED)
                asked = "interrupted"
            elif sample.now >= track_ends:
                asked = TIME_IS_UP
            if asked:
                state = self._loop.finish(state, asked)
            proposal = self._loop.propose(state, sample)
            proposed_at = self._clock.now()
            state, decision = self._loop.judge(state, sample, proposal)
            controlled_at = self._clock.now()
            self._enter(decision.output.phase)
            if decision.output.phase is Phase.TRACK and track_ends == math.inf:
                track_ends = sample.now + self._config.run.duration_s
            if decision.output.failed and result.outcome is not Outcome.STOPPED:
                result = self._stopped(decision.output.cause)
            await motion.to(decision.position, status.quaternion, announce=unpaced)
            self._log.cycle(
                self._record(
                    status,
                    sample,
                    decision,
                    cycle=cycle,
                    started_at=started_at,
                    status_transmitted_at=status_transmitted_at,
                    decoded_at=decoded_at,
                    proposed_at=proposed_at,
                    controlled_at=controlled_at,
                    sent_at=self._robot.begun_at,
                    transmitted_at=self._robot.transmitted_at,
                    sensor_counter=frame.counter,
                    start=start.position,
                    asked=asked,
                    correction=decision.target.depth - commanded_before,
                )
            )
            if decision.ended:
                break
        if result.outcome is Outcome.COMPLETED and state.task.cause != TIME_IS_UP:
            return RunResult(Outcome.COMPLETED, state.task.cause)
        return result

    async def _beats(self) -> AsyncIterator[tuple[int, float]]:
        """Number and begin of each cycle: as fast as the link answers, or on the period's absolute beats.

        After an overrun the beats missed are skipped, never caught up.
        """
        period = self._config.run.period_ms * 1e-3
        anchor, beat, cycle = self._clock.now(), 0, 0
        while True:
            yield cycle, self._clock.now()
            cycle += 1
            if not period:
                continue
            next_beat = max(beat + 1, math.ceil((self._clock.now() - anchor) / period))
            if (skipped := next_beat - beat - 1) > 0:
                self._event("overrun", f"{skipped} beats of {period * 1e3:g} ms skipped")
            beat = next_beat
            await self._clock.sleep_until(anchor + beat * period)

    def _sample(self, status: Status, frame: SensorFrame) -> Sample:
        """The newest of everything, now that the robot has answered."""
        sensor = self._sensor
        fault = ""
        try:
            sensor.check()
        except BridgeError as error:
            fault = str(error)
        if status.emergency_stop:
            fault = f"robot on {self._robot.name} is in emergency stop"
        now = self._clock.now()
        composed_at = now - self._answer_time
        facing = self._facing(status)
        wrench = facing.contact_wrench(sensor.wrench(frame))
        paired = sensor.wrench_at(composed_at + self._filter_delay)
        # by place, in the order of the fields: by name every one costs as much as to read it
        return Sample(
            now,
            status.position,
            facing.force_along(_APPROACH, wrench),
            math.hypot(wrench[0], wrench[1], wrench[2]),
            frame.at,
            frame.sequence,
            sensor.repeated,
            bool(sensor.saturated),
            self._dead_axis(status),
            fault,
            facing.force_along(_TRAVEL, wrench),
            wrench,
            composed_at,
            None if paired is None else facing.force_along(_APPROACH, facing.contact_force(paired)),
        )

    def _frame(self) -> SensorFrame:
        """The newest frame of the sensor."""
        frame = self._sensor.newest
        assert frame is not None, "the tare waited for a frame"
        return frame

    def _dead_axis(self, status: Status) -> str:
        """What is wrong with a force axis that the controlled force mainly lies on; empty while nothing is."""
        if not self._sensor.dead:
            return ""
        shares = self._wrist.seen_by_sensor(self._config.frame.approach, status.quaternion).tolist()
        dead = [
            AXES[k] for k, share in enumerate(shares) if k in self._sensor.dead and abs(share) >= MAIN_SHARE
        ]
        if not dead:
            return ""
        return (
            f"{' and '.join(dead)} of the force sensor did not change since the zero while other axes moved"
        )

    def _facing(self, status: Status) -> Facing:
        """The wrist at this orientation, made anew only when the tool has turned."""
        words = status.quaternion_words
        if self._faced is None or self._faced[0] != words:
            frame = self._config.frame
            facing = self._wrist.facing(
                status.quaternion, self._quaternion_tare, frame.approach, frame.travel
            )
            self._faced = words, facing
        return self._faced[1]

    def _record(self, status: Status, sample: Sample, decision: Decision, **known: Any) -> CycleRecord:
        """What the cycle came to; `known` is what only its course knows, by the record's names."""
        output = decision.output
        command = output.command or Command(decision.target.depth, 0.0)
        return CycleRecord(
            **known,
            phase=output.phase,
            status_at=sample.now,
            sensor_at=sample.sensor_at,
            answered_at=self._clock.now(),
            sensor_sequence=sample.sensor_sequence,
            force=decision.force,
            force_reference=self._config.task.force_n,
            wrench=sample.wrench,
            position=status.position,
            quaternion=status.quaternion,
            depth=decision.depth,
            depth_commanded=decision.target.depth,
            travel_commanded=decision.target.travel,
            stiffness=command.stiffness,
            gain=command.gain,
            held=command.held,
            in_contact=output.in_contact,
            verdict=decision.verdict.kind,
            reasons=decision.reasons,
            explanation={
                **in_numbers(command.explanation),
                "feedback_m": command.correction,
                **({"surface_deg": math.degrees(decision.angle)} if decision.angle else {}),
            },
            target=decision.position,
            sample=sample,
        )

    def _stopped(self, cause: str) -> RunResult:
        self._event(STOP_EVENT, cause)
        return RunResult(Outcome.STOPPED, cause)

    def _enter(self, phase: str) -> None:
        if phase != self._phase:
            self._phase = phase
            self._event(PHASE_EVENT, phase)

    def _event(self, kind: str, text: str) -> None:
        self._log.event(EventRecord(self._clock.now(), kind, text))
