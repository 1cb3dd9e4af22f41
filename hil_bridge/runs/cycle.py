"""One run of the closed loop: connect, check, zero, then cycle by cycle report → force → decision → move → record.

The shell around the pure `ControlLoop`: it stamps the hops, hands data one way along them, and waits for
nothing but the robot.
"""

import asyncio
import math

from msgspec.structs import replace

from hil_bridge.clock import Clock, Heartbeat
from hil_bridge.control import LoopState, Peaks, Phase, Sample, WristAtOrientation
from hil_bridge.control.course.intent import CONNECT, TARE
from hil_bridge.control.program.leg import Leg
from hil_bridge.control.program.reach import ways_across
from hil_bridge.devices.robots.seam import (
    Motion,
    MotionLimits,
    RobotLink,
    RobotReport,
    fault_reason,
    orientation_fault,
)
from hil_bridge.devices.sensors.stream import ForceSensor
from hil_bridge.errors import BridgeError, Cause, DeviceError, Reason
from hil_bridge.errors.cancelling import is_asked
from hil_bridge.errors.failures import (
    TRACEBACK_EVENT,
    CodeFailed,
    explain_exception,
    failure_event,
    of_others,
    traceback_of,
)
from hil_bridge.record import CHECK_EVENT, PHASE_EVENT, STOP_EVENT, EventRecord, Outcome
from hil_bridge.record.ending import Check
from hil_bridge.runs.axis_evidence import dead_axis_text
from hil_bridge.runs.bounds import check_depth, run_bounds
from hil_bridge.runs.cycle_record import Course, cycle_record
from hil_bridge.runs.leaving import ARRIVED_M, Left, WayOut, in_words, not_away, stand_still
from hil_bridge.runs.pace import cycle_starts
from hil_bridge.runs.reaction_times import usual_gap
from hil_bridge.runs.result import RunResult
from hil_bridge.runs.setup import Setup
from hil_bridge.runs.slow_cycles import SlowCycles
from hil_bridge.runs.small_steps import bring_up
from hil_bridge.runs.starting import check_start
from hil_bridge.runs.steps_told import StepTeller
from hil_bridge.runs.watching import Log
from hil_bridge.runs.zeroing import Zeroing, known_wrist, wrist
from protocol.geometry import Pose, Quaternion, Vector, angle_between
from protocol.wrench import WrenchFrame

THEN_EVENT = "then"
"""Kind of the events whose text is what followed the cause of a stop."""
FOLLOWED_MAX = 5
"""Chosen: things told that followed the cause of a stop."""
UNKNOWN_SERVO = (
    "the robot's servo is not known: it is not held against its orders, and no bound of the force is known"
)
TURNED_RAD = math.radians(0.05)
"""Chosen: turn of a tool that a program turns, below which its wrist counts as the same: 0.01 N of 10 N."""

_APPROACH, _TRAVEL, _ACROSS = 0, 1, 2
"""Directions in which the contact force is taken, by their place in `WristAtOrientation.directions`."""


class Run:
    """A run over a robot link and a force sensor that have been started; call it once."""

    def __init__(self, setup: Setup, clock: Clock, robot: RobotLink, sensor: ForceSensor, log: Log) -> None:
        """Raises ConfigError for what cannot be run."""
        self._config = config = setup.config
        self._clock = clock
        self._robot = robot
        self._sensor = sensor
        self._log = log
        self._loop = setup.loop_for(robot.facts)
        self._turns = self._loop.program.turns
        """A program turns the tool."""
        self._wrist = (known_wrist(config) if self._turns else None) or wrist(config)
        self._zeroing = Zeroing(config, clock, robot, sensor, self._check)
        self._steps = StepTeller(self._loop.program, clock, log, self._event)
        self._way_out = WayOut(config, clock, robot, sensor, self._loop)
        self._heart = Heartbeat(clock)
        self._cycle_s = robot.facts.cycle_s or math.inf
        self._filter_delay = math.nan
        self._due_after = math.inf
        """Age of the newest frame from which the next one is late, s."""
        self._start: RobotReport
        self._orientation: Quaternion
        """Orientation of the last order that was taken; that of the start where no program turns the tool."""
        self._quaternion_tare: Quaternion | None = None
        self._state: LoopState | None = None
        self._peaks: Peaks | None = None
        """After the last order that the robot took; None before the first cycle."""
        frame = config.frame
        self._directions = frame.approach, frame.travel, frame.across
        self._turned_wrist: tuple[Quaternion, WristAtOrientation] | None = None
        self._interrupted: Cause | None = None
        """Cause by which the end was asked for; None while the run goes on."""
        self._held = False
        self._phase = ""
        self._outcome = Outcome.COMPLETED
        self._reason: Reason | None = None
        self._followed: list[Reason] = []
        self._stopped_at: float | None = None
        """When the run stopped, s on the run's clock; None while it has not."""
        self._pause = 0.0
        self._log_error: Exception | None = None
        """Error that the log raised for an event."""
        self._failed: Reason | None = None
        """Failure beside the cycles that no cycle has answered yet."""
        self._traced: BaseException | None = None
        """Failure whose traceback has been told."""
        self.moving = False
        """A movement sequence is under way: only `interrupt` may end it, not cancellation."""
        self.result: RunResult | None = None
        """Result of a run that has ended, also where its task was cancelled while the tool moved."""

    @property
    def legs(self) -> tuple[Leg, ...]:
        """A program's steps, passes counted; empty without one."""
        return self._steps.legs

    def interrupt(self, by: Cause = Cause.INTERRUPTED) -> None:
        """Retract from the next cycle on, and end; `by` is the row of the table of causes. The first one stays."""
        self._interrupted = self._interrupted or by

    def fail(self, reason: Reason | None) -> None:
        """Retract from the next cycle on, and end, because of a failure beside the cycles; nothing without a reason."""
        self._failed = self._failed or reason

    def hold(self) -> bool:
        """Hold the tool in its place while it tracks, its force controlled, or let it go on; whether it is held."""
        self._held = not self._held and self._phase == Phase.TRACK
        return self._held

    def stand_still(self, seconds: float) -> None:
        """Let the next decision last so much longer, s: a computer that stands still, in virtual time."""
        self._pause = seconds

    async def __call__(self) -> RunResult:
        """The whole run. Raises BridgeError when a device fails before the movement has begun.

        Once the tool moves, every end but this task's own cancellation is a result, and each of them tries to retract.
        """
        try:
            return await self._whole()
        except BridgeError as error:
            self._trace(error)
            error.late_s = self._heart.recent(self._cycle_s)
            if self._failed and not self.moving:
                first = self._failed
                remedy = "; ".join(filter(None, (first.remedy, f"then {error}")))
                raise DeviceError(first.fact, remedy=remedy, cause=first.cause) from error
            raise
        finally:
            self._heart.stop()

    async def _whole(self) -> RunResult:
        self._enter(CONNECT)
        self._heart.start()
        start = await bring_up(self._robot, self._sensor)
        self._filter_delay = self._sensor.delay
        self._due_after = usual_gap(self._sensor.facts)
        self._loop.initial(start.pose.position)  # refuses a start outside the workspace
        check_start(self._config, self._loop, start)
        self._enter(TARE)
        await self._zeroing.weigh(start, ways_across(self._loop.program))
        self._orientation = start.pose.quaternion
        self.moving, moved, answers = True, False, True
        commanded = start.pose.position
        cancelled: asyncio.CancelledError | None = None
        self._heart.take()  # a pause before this movement is no gap of it
        try:
            async with self._robot.motion(self._limits(start)) as motion:
                try:
                    await self._guarded(motion, start)
                finally:
                    moved, commanded, answers = self._read_end(motion, commanded)
        except BridgeError as error:
            self._blame(error.reason(Cause.ROBOT_FAILED))
        except asyncio.CancelledError as error:
            cancelled = error
        finally:
            self.moving = False
        rest = await self._left(start, commanded, answers) if moved else None
        if self._state is not None and self._outcome is not Outcome.COMPLETED:
            self._steps.cut(self._state.program, self._reason, self._stopped_at)
        self._enter("end")
        left = "" if rest is None else rest.text
        self.result = RunResult(self._outcome, self._reason, left, tuple(self._followed), rest)
        if cancelled is not None:
            raise cancelled
        return self.result

    def _read_end(self, motion: Motion, start: Vector) -> tuple[bool, Vector, bool]:
        """Whether the movement took a point, the last one, and whether the robot answers, as far as it tells that."""
        try:
            return motion.ordered, motion.commanded or start, not motion.abandoned
        except BridgeError as error:
            self._trace(error)
            self._blame(error.reason(Cause.ROBOT_FAILED))
            return True, start, False

    def _limits(self, start: RobotReport) -> MotionLimits:
        """Limits of the movement from here: a stream holds when no decision comes for longer than one may last."""
        robot, limits, run = self._config.robot, self._config.limits, self._config.run
        hold_after, gain = (limits.cycle_deadline_ms + run.period_ms) * 1e-3, robot.acceleration_mm_s2 * 1e-3
        bounds = run_bounds(self._config, self._robot.facts, self._loop.sample_time, self._turns, start.pose)
        return MotionLimits(robot.velocity_mm_s * 1e-3, hold_after, acceleration=gain, bounds=bounds)

    async def _guarded(self, motion: Motion, start: RobotReport) -> None:
        """All between the start and the end of the movement sequence. Whatever ends it, the tool is retracted as far
        as the robot takes orders.
        """
        try:
            zero = await self._zeroing.take(motion, start, lambda: self._interrupted is not None)
            if zero is None:
                self._end_as_asked()
                return
            self._start = zero.start
            if self._robot.facts.servo is None:
                self._event("motion", UNKNOWN_SERVO)
            self._quaternion_tare = self._orientation if self._config.sensor.tare else None
            wrist = self._wrist_at(zero.start.pose.quaternion)
            self._sensor.peaks = self._peaks = Peaks(wrist, self._sensor.facts.scales, zero.contact)
            self._state = self._loop.initial(zero.start.pose.position)
            await self._cycles(motion)
        except BridgeError as error:
            self._trace(error)
            self._blame(self._in_step(error.reason(Cause.ROBOT_FAILED)))
            await self._retract(motion)
        except BaseException as error:
            if asked := is_asked(error):
                self._blame(Reason(Cause.CANCELLED, "the run was cancelled"))
            else:
                self._event(*failure_event(error))
                self._blame(self._in_step(explain_exception(error)))
            await self._retract(motion)
            if asked or not (isinstance(error, (Exception, SystemExit)) or of_others(error)):
                raise

    def _end_as_asked(self) -> None:
        """The run ends because a person, or a program, has asked for it."""
        assert self._interrupted is not None
        self._outcome, self._reason = Outcome.INTERRUPTED, Reason(self._interrupted)

    def _in_step(self, reason: Reason) -> Reason:
        """Why the run stops, with the step of a program in which it does."""
        return reason if self._state is None else self._loop.program.where(self._state.program, reason)

    async def _retract(self, motion: Motion) -> None:
        """Back to the depth of the start by orders alone."""
        if self._state is None or motion.halted:
            return
        self._enter(Phase.RETRACT)
        await self._way_out.retract(motion, self._state, self._orientation, self._blame)

    async def _left(self, start: RobotReport, commanded: Vector, answers: bool) -> Left:
        """Where the tool was left; a tool that is left pressing has not completed."""
        origin = (start if self._state is None else self._start).pose.position
        zero = () if self._state is None else self._state.program.course.zero
        if zero and self._sensor.peaks is not None:
            self._sensor.peaks.rezero(zero)
        if self._state is None:  # it has come no farther than the way to the zero
            self._sensor.peaks = self._zeroing.judge_at_rest()
        depth, force = await self._way_out.rest(origin, commanded, answers)
        limits = self._config.limits
        away = depth <= ARRIVED_M
        saturated, newest, hidden = bool(self._sensor.saturated), self._sensor.newest, 0.0
        unverified: tuple[str, ...] = ()
        if self._state is not None:
            axes, wrist = self._zeroing.axes, self._wrist_at(self._orientation)
            if newest is not None and math.isfinite(force):
                hidden = axes.hidden_at_rest(wrist, self._sensor.wrench(newest), limits.weight_tolerance_n)
            unverified = axes.unverified(aside=math.hypot(*self._state.program.step.at) > ARRIVED_M)
        pressing = saturated or not force <= limits.weight_tolerance_n or hidden > 0.0
        own = math.nan
        if answers and self._loop.supervisor.witness is not None:
            own = await self._zeroing.own_force.beside(force, self._loop.supervisor.witness, self._robot)
        told = in_words(force, saturated)
        if self._outcome is not Outcome.STOPPED and not away:
            self._blame(not_away(depth, told))
        elif self._outcome is not Outcome.STOPPED and pressing:
            text = (
                f"{told} after the retraction: the tool touches something, or the sensor's zero has changed"
            )
            self._blame(
                Reason(Cause.LEFT_PRESSING, text)
                if math.isfinite(force)
                else Reason(Cause.LEFT_UNKNOWN, "the sensor tells no force after the retraction")
            )
        elif self._outcome is not Outcome.STOPPED and math.isfinite(own):
            text = f"the force sensor tells {told} after the retraction, the robot itself feels {own:.0f} N"
            self._blame(Reason(Cause.LEFT_DISAGREEING, text))
        last = self._followed[-1] if self._followed else self._reason
        because = "" if last is None else last.fact
        free = away and not pressing and math.isnan(own)
        return Left(free, depth, force, because, saturated, own, hidden, unverified)

    async def _cycles(self, motion: Motion) -> None:
        """The cycles from the start point to the end of the retraction."""
        state = self._state
        assert state is not None
        unpaced = not self._config.run.period_ms  # then an order is always followed by another at once
        period = self._config.run.period_ms * 1e-3
        slow = SlowCycles(self._config)
        async for cycle, started_at in cycle_starts(self._clock, period, self._event):
            self.fail(slow.cycle(started_at))
            if self._log_error is not None:
                raise self._log_error
            commanded_before = state.supervisor.depth
            report = await self._robot.report(soon=True)
            frame, decoded_at = self._frame(), self._sensor.decoded_at
            sample = self._sample(report, frame)
            asked: Reason | None = None
            if self._interrupted and self._outcome is Outcome.COMPLETED:
                self._end_as_asked()
                asked = Reason(self._interrupted, "interrupted")
            elif self._failed is not None:
                asked = self._failed
                self._blame(asked)
            before = state if asked is None else self._loop.finish(state, asked)
            proposal = self._loop.propose(before, sample)
            if self._pause:
                pause, self._pause = self._pause, 0.0
                await self._clock.sleep_until(self._clock.now() + pause)
            proposed_at = self._clock.now()
            gap = max(self._heart.take(), proposed_at - sample.now)
            if gap * 1e3 > self._config.limits.cycle_deadline_ms:
                sample = replace(sample, gap=gap)
                self._event("gap", f"no decision for {gap * 1e3:.0f} ms")
            after, decision = self._loop.judge(before, sample, proposal)
            controlled_at = self._clock.now()
            if proposal.trace:
                self._event(TRACEBACK_EVENT, proposal.trace)
            self._enter(decision.intent.phase)
            if decision.intent.phase is Phase.TRACK:
                self._zeroing.axes.tracked = True
            if decision.intent.failed and decision.intent.reason is not None:
                failed = self._loop.program.where(after.program, decision.intent.reason)
                remedy = "; ".join(filter(None, (failed.remedy, self._sensor.stands)))
                self._blame(replace(failed, remedy=remedy))
            if decision.stands:
                sent = await stand_still(motion)
            else:
                orientation = decision.quaternion or self._orientation
                check_depth(decision.position, self._start.pose, self._config, decision.target.depth)
                sent = await motion.to(Pose(decision.position, orientation), soon=unpaced)
                self._orientation = orientation  # an order that was refused turns no way out
            state = self._state = after
            self._log.cycle(
                cycle_record(
                    report,
                    sample,
                    decision,
                    Course(
                        cycle=cycle,
                        started_at=started_at,
                        decoded_at=decoded_at,
                        proposed_at=proposed_at,
                        controlled_at=controlled_at,
                        answered_at=self._clock.now(),
                        sensor_counter=frame.counter,
                        start=self._start.pose.position,
                        asked="" if asked is None else str(asked),
                        asked_cause=None if asked is None else asked.cause,
                        step=self._steps.number(decision.intent.leg),
                        correction=decision.target.depth - commanded_before,
                        sent_at=sent.begun_at,
                        transmitted_at=sent.left_at,
                    ),
                    self._config.task,
                )
            )
            self._steps.ended(state.program)
            if decision.ended:
                break
        if self._outcome is Outcome.COMPLETED:
            self._reason = self._loop.program.completed(state.program)

    def _sample(self, report: RobotReport, frame: WrenchFrame) -> Sample:
        """The newest of everything, now that the robot has told where it is."""
        sensor, (position, quaternion), fault = self._sensor, report.pose, fault_reason(report)
        try:
            sensor.check()
        except BridgeError as error:
            self._trace(error)
            fault = fault or error.reason(Cause.SENSOR_FAILED)
        assert sensor.peaks is not None
        peak_force, peak_resultant, peak_moment, saturated = sensor.peaks.take()
        if orientation_fault(quaternion):
            quaternion = self._start.pose.quaternion  # the fault says so
        ordered = self._orientation
        tilt = 0.0 if quaternion == ordered else angle_between(ordered, quaternion)
        now = self._clock.now()
        wrist = self._wrist_at(quaternion)
        wrench = wrist.contact_wrench(sensor.wrench(frame))
        force = wrist.force_along(_APPROACH, wrench)
        paired = sensor.wrench_at(report.pose_at + self._filter_delay + sensor.late)
        # by place, in the order of the fields: by name every one costs as much as to read it
        return Sample(
            now,
            position,
            force,
            math.hypot(wrench[0], wrench[1], wrench[2]),
            sensor.newest_at,
            frame.sequence,
            sensor.repeated,
            saturated or bool(sensor.saturated),
            dead_axis_text(self._wrist, self._config.frame.approach, quaternion, sensor.dead),
            "" if fault is None else fault.text,
            wrist.force_along(_TRAVEL, wrench),
            wrench,
            report.pose_at,
            None if paired is None else wrist.force_along(_APPROACH, wrist.contact_force(paired)),
            peak_force,
            peak_resultant,
            peak_moment,
            tilt,
            unchanged=frame.at - sensor.unchanged_since,
            quaternion=quaternion,
            held=self._held,
            witness=self._zeroing.own_force.along(report),
            doubt=int(self._zeroing.doubt(force)),
            overdue=max(now - frame.at - self._due_after, 0.0),
            fault_cause=None if fault is None else fault.cause,
            fault_remedy="" if fault is None else fault.remedy,
            force_across=wrist.force_along(_ACROSS, wrench),
            hidden=self._zeroing.axes.hidden(wrist, wrench, force),
        )

    def _frame(self) -> WrenchFrame:
        """The newest frame of the sensor."""
        frame = self._sensor.newest
        assert frame is not None, "the tare waited for a frame"
        return frame

    def _wrist_at(self, quaternion: Quaternion) -> WristAtOrientation:
        """The wrist at this orientation, made again only when the tool has turned."""
        if self._turned_wrist is None or self._is_another(self._turned_wrist[0], quaternion):
            wrist = self._wrist.at_orientation(quaternion, self._quaternion_tare, *self._directions)
            self._turned_wrist = quaternion, wrist
            if self._turns and self._peaks is not None:
                self._peaks.turn(wrist, self._sensor.facts.scales)
        return self._turned_wrist[1]

    def _is_another(self, known: Quaternion, quaternion: Quaternion) -> bool:
        """Whether the wrist is to be made again: while a program turns the tool, not for every hair."""
        near = self._turns and angle_between(known, quaternion) <= TURNED_RAD
        return known != quaternion and not near

    def _blame(self, reason: Reason) -> None:
        """Stop for this reason, or note what followed the first one. A failure that is not answered yet goes first."""
        failed, self._failed = self._failed, None
        if failed is not None and failed != reason:
            self._blame(failed)
        if self._outcome is not Outcome.STOPPED:
            self._outcome, self._reason = Outcome.STOPPED, reason
            self._stopped_at = self._clock.now()
            reason = self._reason = replace(reason, late_s=self._heart.recent(self._cycle_s))
            self._event(STOP_EVENT, str(reason), reason.cause)
        elif len(self._followed) < FOLLOWED_MAX and not self._is_blamed(reason):
            self._followed.append(reason)
            self._event(THEN_EVENT, str(reason), reason.cause)

    def _is_blamed(self, reason: Reason) -> bool:
        """Whether the same fact, whatever else is known of it, has been told."""
        return any(told is not None and told.text == reason.text for told in (self._reason, *self._followed))

    def _trace(self, error: BridgeError) -> None:
        """Tell the traceback of code that has failed, once."""
        cause = error.__cause__ if isinstance(error, CodeFailed) else None
        if cause is not None and cause is not self._traced:
            self._traced = cause
            self._event(TRACEBACK_EVENT, traceback_of(cause))

    def _enter(self, phase: str) -> None:
        if phase != self._phase:
            self._phase = phase
            self._event(PHASE_EVENT, phase)

    def _check(self, text: str, check: Check) -> None:
        self._event(CHECK_EVENT, text, check=check)

    def _event(self, kind: str, text: str, cause: Cause | None = None, *, check: Check | None = None) -> None:
        try:
            self._log.event(EventRecord(self._clock.now(), kind, text, cause, check))
        except (
            Exception
        ) as error:  # the next cycle tells it: nothing comes between a failure and its retraction
            self._log_error = error
