"""One run of the closed loop: connect, check and zero, then in each cycle report → force → decision → motion →
recording.

This is the shell around the pure `ControlLoop`: it timestamps the stages, passes data in one direction, and waits
only for the robot.
"""

import asyncio
import math
from dataclasses import replace as altered

from msgspec.structs import replace

from hil_bridge.control import LoopState, Phase
from hil_bridge.control.course.intent import CONNECT, TARE
from hil_bridge.control.program.leg import Leg
from hil_bridge.control.program.reach import directions_across
from hil_bridge.devices.robots.seam import Motion, MotionLimits, RobotLink, RobotReport
from hil_bridge.devices.sensors.stream import ForceSensor
from hil_bridge.errors import BridgeError, Cause, DeviceError, Reason
from hil_bridge.errors.cancelling import is_interrupt
from hil_bridge.errors.failures import explain_exception, failure_event, involves_plugin
from hil_bridge.record import EventKind, Outcome
from hil_bridge.runs.bounds import check_depth, run_bounds
from hil_bridge.runs.cycle_record import Course, cycle_record
from hil_bridge.runs.ending import Act, Ending, Stimulus
from hil_bridge.runs.journal import Journal
from hil_bridge.runs.pace import cycle_starts
from hil_bridge.runs.result import RunResult
from hil_bridge.runs.retreat import ARRIVED_M, FallbackRetraction, FinalState, cancel_orders
from hil_bridge.runs.run_log import RunLog
from hil_bridge.runs.sampling import Sampler
from hil_bridge.runs.setup import Setup
from hil_bridge.runs.slow_cycles import SlowCycles
from hil_bridge.runs.small_steps import bring_up
from hil_bridge.runs.starting import check_start
from hil_bridge.runs.step_reports import StepReporter
from hil_bridge.runs.zeroing import Zeroing
from protocol.geometry import Pose, Quaternion, Vector
from protocol.wrench import WrenchFrame

UNKNOWN_SERVO = (
    "the robot's servo is unknown: its motion is not compared with its orders, and the force has no bound"
)


class Run:
    """Run with a started robot link and force sensor. Call it once."""

    def __init__(
        self, setup: Setup, robot: RobotLink, sensor: ForceSensor, log: RunLog, ending: Ending
    ) -> None:
        """Create a run. Raises ConfigError for an invalid configuration."""
        self._config = config = setup.config
        self._clock = clock = log.clock
        self._robot, self._sensor, self._log = robot, sensor, log
        self.ending = ending
        """End of the run, shared with everything that may end the run from outside."""
        self._loop = setup.loop_for(robot.facts)
        self._journal = Journal(clock, log, ending, robot.facts.cycle_s or math.inf)
        self._zeroing = Zeroing(config, clock, robot, sensor, self._journal.check)
        self._sampler = Sampler(config, clock, self._zeroing, sensor, self._journal)
        if self._loop.program.turns:
            self._sampler.expect_turns()
        self._steps = StepReporter(self._loop.program, clock, log, self._journal.event)
        self._fallback = FallbackRetraction(config, clock, robot, sensor, self._loop)
        self._start: RobotReport
        self._orientation: Quaternion
        """Orientation in the last accepted order; the orientation at the start if no program turns the tool."""
        self._state: LoopState | None = None
        self._held = False
        self._pause = 0.0

    @property
    def legs(self) -> tuple[Leg, ...]:
        """Steps of the program, counting all passes; empty without a program."""
        return self._steps.legs

    @property
    def moving(self) -> bool:
        """Whether a movement sequence is in progress. Only `interrupt` may end it, not cancellation."""
        return self.ending.is_moving

    def interrupt(self, by: Cause = Cause.INTERRUPTED) -> Act:
        """Retract from the next cycle on, and then end the run. `by` is the cause from the table of causes. The
        first cause is kept.

        Returns the effect: a run that has not moved is ended by cancelling its task.
        """
        return self.ending.ask(by)

    def fail(self, reason: Reason | None) -> None:
        """Retract from the next cycle on, and then end the run, because of a failure outside the cycles. None
        stands for no failure.
        """
        if reason is not None:
            self.ending.fail_outside_cycles(reason)

    def hold(self) -> bool:
        """Hold the tool at its position while it tracks, with its force controlled, or let it continue. Return
        whether the tool is held.
        """
        self._held = not self._held and self._journal.phase == Phase.TRACK
        return self._held

    def stall(self, seconds: float) -> None:
        """Delay the next decision by `seconds`, which simulates a stalled computer in virtual time."""
        self._pause = seconds

    async def __call__(self) -> RunResult:
        """Carry out the complete run. Raises BridgeError if a device fails before the movement has begun.

        Once the tool moves, every end except cancellation of this task returns a result, and the run always tries
        to retract.
        """
        try:
            return await self._carry_out()
        except BridgeError as error:
            self._journal.trace(error)
            error.late_s = self._journal.late_s
            first = self.ending.failed
            if first and not self.moving:
                facts = "; ".join(filter(None, (first.facts, f"then {error}")))
                raise DeviceError(first.fact, remedy=first.remedy, facts=facts, cause=first.cause) from error
            raise
        finally:
            self._journal.heart.stop()

    async def _carry_out(self) -> RunResult:
        start = await self._make_ready()
        self._orientation = start.pose.quaternion
        self.ending.begin_movement()
        has_moved, answers, commanded = False, True, start.pose.position
        cancelled: asyncio.CancelledError | None = None
        self._journal.heart.take()  # a pause before this movement does not count as a gap
        try:
            async with self._robot.motion(self._limits(start)) as motion:
                try:
                    await self._run_guarded(motion, start)
                finally:
                    has_moved, commanded, answers = self._read_end(motion, commanded)
        except BridgeError as error:
            self._journal.blame(error.reason(Cause.ROBOT_FAILED))
        except asyncio.CancelledError as error:
            cancelled = error
        finally:
            self.ending.end_movement()
        ending = self.ending
        if ending.requested and ending.outcome is Outcome.COMPLETED:  # requested after the last cycle
            ending.end_as_requested()
        rest = await self._left(start, commanded, answers) if has_moved else None
        if self._state is not None and ending.outcome is not Outcome.COMPLETED:
            self._steps.cut(self._state.program, ending.reason, self._journal.stopped_at)
        self._journal.enter("end")
        left = "" if rest is None else rest.text
        if ending.failed is not None:  # too late for any cycle
            self._journal.blame(ending.failed)
        ending.result = RunResult(ending.outcome, ending.reason, left, tuple(ending.followed), rest)
        if cancelled is not None:
            raise cancelled
        return ending.result

    async def _make_ready(self) -> RobotReport:
        """Bring up the devices and make all checks that need no motion. Return the robot's report."""
        self._journal.enter(CONNECT)
        self._journal.heart.start()
        start = await bring_up(self._robot, self._sensor)
        self._sampler.sensor_is_ready()
        self._loop.initial(start.pose.position)  # raises for a start outside the workspace
        check_start(self._config, self._loop, start)
        self._journal.enter(TARE)
        await self._zeroing.weigh(start, directions_across(self._loop.program))
        return start

    def _read_end(self, motion: Motion, start: Vector) -> tuple[bool, Vector, bool]:
        """Return whether the movement accepted any point, the last ordered point, and whether the robot responds,
        as far as known.
        """
        try:
            return motion.ordered, motion.commanded or start, not motion.abandoned
        except BridgeError as error:
            self._journal.trace(error)
            self._journal.blame(error.reason(Cause.ROBOT_FAILED))
            return True, start, False

    def _limits(self, start: RobotReport) -> MotionLimits:
        """Return the limits of the movement from the start. A stream holds its position if no decision comes for
        longer than the maximum duration of a decision.
        """
        robot, limits, run = self._config.robot, self._config.limits, self._config.run
        hold_after, gain = (limits.cycle_deadline_ms + run.period_ms) * 1e-3, robot.acceleration_mm_s2 * 1e-3
        loop = self._loop
        bounds = run_bounds(self._config, self._robot.facts, loop.sample_time, loop.program.turns, start.pose)
        return MotionLimits(robot.velocity_mm_s * 1e-3, hold_after, acceleration=gain, bounds=bounds)

    async def _run_guarded(self, motion: Motion, start: RobotReport) -> None:
        """Run everything between the start and the end of the movement sequence. Regardless of what ends it, the
        tool is retracted as far as the robot accepts orders.
        """
        journal = self._journal
        try:
            zero = await self._zeroing.take(motion, start, lambda: self.ending.requested is not None)
            if zero is None:
                self.ending.end_as_requested()
                return
            self._start = zero.start
            if self._robot.facts.servo is None:
                journal.event(EventKind.MOTION, UNKNOWN_SERVO)
            self._sampler.begin(zero, self._orientation)
            self._state = self._loop.initial(zero.start.pose.position)
            self._clock.draw_order(self._config.virtual)
            await self._cycles(motion)
        except BridgeError as error:
            journal.trace(error)
            journal.blame(self._in_step(error.reason(Cause.ROBOT_FAILED)))
            await self._retract(motion)
        except BaseException as error:
            if asked := is_interrupt(error):
                journal.blame(Reason(Cause.CANCELLED, "the run was cancelled"), Stimulus.CANCELLED)
            else:
                journal.event(*failure_event(error))
                journal.blame(self._in_step(explain_exception(error)))
            await self._retract(motion)
            if asked or not (isinstance(error, (Exception, SystemExit)) or involves_plugin(error)):
                raise

    def _in_step(self, reason: Reason) -> Reason:
        """Return the reason why the run stops, with the step of the program in which it stops."""
        return reason if self._state is None else self._loop.program.where(self._state.program, reason)

    async def _retract(self, motion: Motion) -> None:
        """Retract to the depth of the start by orders alone."""
        if self._state is None or motion.halted:
            return
        self._journal.enter(Phase.RETRACT)
        await self._fallback.retract(motion, self._state, self._orientation, self._journal.blame)

    async def _left(self, start: RobotReport, commanded: Vector, answers: bool) -> FinalState:
        """Return the final state of the tool. A run that leaves the tool pressing has not completed."""
        state, sensor = self._state, self._sensor
        origin = (start if state is None else self._start).pose.position
        zero = () if state is None else state.program.course.zero
        if zero and sensor.peaks is not None:
            sensor.peaks.rezero(zero)
        if state is None:  # the run did not get beyond the zero
            sensor.peaks = self._zeroing.judge_at_rest()
        depth, force = await self._fallback.rest(origin, commanded, answers)
        hidden = 0.0
        unverified: tuple[str, ...] = ()
        if state is not None:
            if sensor.newest is not None and math.isfinite(force):
                hidden = self._sampler.hidden_at_rest(self._orientation)
            aside = math.hypot(*state.program.step.at) > ARRIVED_M
            unverified = self._zeroing.axes.unverified(aside=aside)
        own = math.nan
        if answers and self._loop.supervisor.witness is not None:
            own = await self._zeroing.own_force.disagreement(
                force, self._loop.supervisor.witness, self._robot
            )
        tolerance = self._config.limits.weight_tolerance_n
        left = FinalState(
            depth=depth,
            force=force,
            tolerance=tolerance,
            saturated=bool(sensor.saturated),
            own_force=own,
            hidden=hidden,
            unverified=unverified,
        )
        if not self.ending.has_failed and (reason := left.failure) is not None:
            self._journal.blame(reason)
        last = self.ending.followed[-1] if self.ending.followed else self.ending.reason
        return altered(left, because="" if last is None else last.fact)

    async def _cycles(self, motion: Motion) -> None:
        """Run the cycles from the start point to the end of the retraction."""
        period, slow, ended = self._config.run.period_ms * 1e-3, SlowCycles(self._config), False
        async for cycle, started_at in cycle_starts(self._clock, period, self._journal.event):
            self.fail(slow.cycle(started_at))
            if self._journal.error is not None:
                raise self._journal.error
            ended = await self._cycle(motion, cycle, started_at)
            if ended:
                break
        assert self._state is not None
        if self.ending.outcome is Outcome.COMPLETED:
            self.ending.reason = self._loop.program.completed(self._state.program)

    async def _cycle(self, motion: Motion, cycle: int, started_at: float) -> bool:
        """Run one cycle: report, decision, order and recording. Return whether the run is over."""
        state, clock = self._state, self._clock
        assert state is not None
        report = await self._robot.report(soon=True)
        frame, decoded_at = self._frame(), self._sensor.decoded_at
        sample = self._sampler.take(report, frame, self._orientation, self._held)
        request = self._handle_request()
        before = state if request is None else self._loop.finish(state, request)
        proposal = self._loop.propose(before, sample)
        if self._pause:
            pause, self._pause = self._pause, 0.0
            await clock.sleep_until(clock.now() + pause)
        proposed_at = clock.now()
        gap = max(self._journal.heart.take(), proposed_at - sample.now)
        if gap * 1e3 > self._config.limits.cycle_deadline_ms:
            sample = replace(sample, gap=gap)
            self._journal.event(EventKind.GAP, f"no decision for {gap * 1e3:.0f} ms")
        after, decision = self._loop.judge(before, sample, proposal)
        controlled_at = clock.now()
        if proposal.trace:
            self._journal.event(EventKind.TRACEBACK, proposal.trace)
        self._journal.enter(decision.intent.phase)
        if decision.intent.phase is Phase.TRACK:
            self._zeroing.axes.tracked = True
        if decision.intent.failed and decision.intent.reason is not None:
            failed = self._loop.program.where(after.program, decision.intent.reason)
            facts = "; ".join(filter(None, (failed.facts, self._sensor.stands)))
            self._journal.blame(replace(failed, facts=facts))
        if decision.stands:
            sent = await cancel_orders(motion)
        else:
            orientation = decision.quaternion or self._orientation
            check_depth(decision.position, self._start.pose, self._config, decision.target.depth)
            unpaced = not self._config.run.period_ms  # the next order then always follows at once
            sent = await motion.to(Pose(decision.position, orientation), soon=unpaced)
            self._orientation = orientation  # a refused order does not affect the retraction's orientation
        self._state = after
        course = Course(
            cycle=cycle,
            started_at=started_at,
            decoded_at=decoded_at,
            proposed_at=proposed_at,
            controlled_at=controlled_at,
            answered_at=clock.now(),
            sensor_counter=frame.counter,
            start=self._start.pose.position,
            request=request,
            step=self._steps.number(decision.intent.leg),
            correction=decision.target.depth - state.supervisor.depth,
            sent_at=sent.begun_at,
            transmitted_at=sent.left_at,
        )
        self._log.cycle(cycle_record(report, sample, decision, course, self._config.task))
        self._steps.ended(after.program)
        return decision.ended

    def _handle_request(self) -> Reason | None:
        """Handle a request to end, or a failure outside the cycles, in this cycle. Return the reason why the
        program must end; None if it continues.
        """
        ending = self.ending
        if ending.requested and ending.outcome is Outcome.COMPLETED:
            ending.end_as_requested()
            return Reason(ending.requested, "interrupted")
        if ending.failed is None:
            return None
        failed = ending.failed
        self._journal.blame(failed)
        return failed

    def _frame(self) -> WrenchFrame:
        """Return the newest frame of the sensor."""
        frame = self._sensor.newest
        assert frame is not None, "the tare waited for a frame"
        return frame
