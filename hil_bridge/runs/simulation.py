"""Runs inside a user's program: their results, and operations on a run in progress."""

import asyncio
import sys
import warnings
from collections.abc import AsyncIterator, Callable, Collection
from contextlib import aclosing, asynccontextmanager
from copy import copy
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from emulators.cell import Cell, TrueState
from hil_bridge.clock import Clock
from hil_bridge.devices.device_log import NullLog
from hil_bridge.devices.robots.seam import RobotLink
from hil_bridge.devices.sensors.stream import ForceSensor
from hil_bridge.devices.wiring import Wiring
from hil_bridge.errors import BridgeError, Cause, ConfigError, Reason
from hil_bridge.errors.failures import explain_exception
from hil_bridge.record import (
    CycleRecord,
    EventKind,
    EventRecord,
    Outcome,
    RawTraffic,
    StepRecord,
    TruthRecord,
)
from hil_bridge.record.analysis.summary import Summary
from hil_bridge.record.kept import KeptRecords
from hil_bridge.record.topics import RECORDS
from hil_bridge.runs import compose
from hil_bridge.runs.checks import Start, check, check_wires
from hil_bridge.runs.ending import Act
from hil_bridge.runs.faults.panel import FaultPanel
from hil_bridge.runs.recorded import Arrays, Recording
from hil_bridge.runs.result import RunResult
from hil_bridge.runs.run_log import RunLog, metadata_of
from hil_bridge.runs.running import Running, run_end, running
from hil_bridge.runs.setup import Setup
from hil_bridge.runs.watchers import Listener
from hil_bridge.settings.configuration import Config
from hil_bridge.settings.faults import refuse_faults

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Observe = Callable[[CycleRecord], object]
_BETWEEN = frozenset({"hil_bridge", "asyncio", "contextlib", "concurrent", "threading"})
"""Packages whose stack frames may lie between a user's program and a run."""
_NEVER_MOVED = RunResult(Outcome.INTERRUPTED, Reason(Cause.INTERRUPTED, "before the movement began"))
_CANCELLED = RunResult(Outcome.STOPPED, Reason(Cause.CANCELLED, "before the movement began"))


class Result:
    """Result of a run. Times are in seconds on the run's clock; all other values are in SI units."""

    def __init__(self, result: RunResult, records: KeptRecords) -> None:
        self.outcome: Outcome = result.outcome
        """Outcome of the run: completed, stopped or interrupted."""
        self.cause: Cause | None = result.cause
        """Reason of the end, as a cause from the table of causes; None for a program that ran to its end."""
        self.text: str = result.text
        """Cause as one line of text; empty for a run that completed as intended."""
        self.left: str = result.left
        """Description of the tool's final state; empty if the tool never moved."""
        self.retracted: bool = result.rest is None or result.rest.retracted
        """Whether the tool was left off the surface, or never moved."""
        self.exit_code: int = result.exit_code
        """Exit code of a command with this result, before failed criteria are considered."""
        self.followed: tuple[Reason, ...] = result.followed
        """Causes after the first."""
        self._records = records

    def __repr__(self) -> str:
        return f"<Result: {self.outcome}{self.text and f', {self.text}'}; {len(self.cycles)} cycles>"

    def _repr_html_(self) -> str:
        return self.recording._repr_html_()

    @cached_property
    def recording(self) -> Recording:
        """Recording as `hil-bridge run --record` writes it and `hil_bridge.read` reads it."""
        return Recording.of(self._records.recording())

    @property
    def cycles(self) -> tuple[CycleRecord, ...]:
        """Control cycles, oldest first."""
        return self.recording.cycles

    @property
    def events(self) -> tuple[EventRecord, ...]:
        """Events outside the cycles: phases, checks, faults and the stop."""
        return self.recording.events

    @property
    def truths(self) -> tuple[TruthRecord, ...]:
        """Ground truth of each cycle in an emulated cell; empty with real devices."""
        return self.recording.truths

    @property
    def steps(self) -> tuple[StepRecord, ...]:
        """Steps of a program that have ended."""
        return self.recording.steps

    @property
    def traffic(self) -> RawTraffic:
        """Data transferred on the links of robot and sensor."""
        return self._records.traffic

    @property
    def arrays(self) -> Arrays:
        """Cycles as arrays by field. See `Recording.arrays`."""
        return self.recording.arrays

    @property
    def figures(self) -> Summary:
        """Figures of merit, durations, counters and latency. Raises ConfigError for a run without any cycle."""
        return self.recording.figures

    def plot(self, *charts: str) -> "Figure":
        """Return a matplotlib figure with charts of the run. See `Recording.plot`."""
        return self.recording.plot(*charts)

    def report(self, directory: Path | str, *, overwrite: bool = False) -> Path:
        """Write the report into a directory. See `Recording.report`."""
        return self.recording.report(directory, overwrite=overwrite)

    def save(self, path: Path | str, *, overwrite: bool = False) -> Path:
        """Write the recording as MCAP and return its path.

        Raises ConfigError if it cannot be written, or if it already exists and `overwrite` is not set.
        """
        self._records.save(Path(path), overwrite)
        return Path(path)


def with_records(result: Result, records: KeptRecords | None) -> Result:
    """Return a copy of a result with other records; without records, the copy can be pickled."""
    other = copy(result)
    vars(other).pop("recording", None)
    other._records = records  # type: ignore[assignment]
    return other


class OpenDevices:
    """Started robot and sensor of a configuration."""

    def __init__(
        self, robot: RobotLink, sensor: ForceSensor | None, clock: Clock, cell: Cell[Any, Any] | None
    ):
        self.robot = robot
        """Robot, which reports poses (m, base frame) and accepts orders. See `RobotLink`."""
        self._sensor = sensor
        self.clock = clock
        """Clock of the loop, s. In virtual time, waiting takes no real time."""
        self.cell = cell
        """Emulated cell with its ground truth; None if both devices are real."""
        self.panel = FaultPanel(cell, clock)
        """Panel that injects faults into the emulated cell."""

    @property
    def sensor(self) -> ForceSensor:
        """Force sensor, with its newest frame and the wrench of that frame in N and N·m. See `ForceSensor`.

        Raises ConfigError if the robot is real and the sensor has no URL.
        """
        if self._sensor is None:
            raise ConfigError(
                "an emulated sensor cannot measure the contact of a real robot: set sensor.url to read forces"
            )
        return self._sensor

    def truth(self) -> TrueState:
        """Return the ground truth of the emulated cell: pose (m, base frame), contact force (N) and joints (rad).

        Raises ConfigError if both devices are real.
        """
        if self.cell is None:
            raise ConfigError(
                "the ground truth is only known for an emulated cell, but both devices are real"
            )
        return self.cell.true_state(self.cell.truth_available_from(self.clock.now()))


class Simulation(OpenDevices):
    """Run in a background task, and the devices that it uses."""

    def __init__(self, run: Running, reached: "_Reached") -> None:
        super().__init__(run.robot, run.sensor, run.clock, run.cell)
        self.config = run.setup.config
        """Configuration of the run, with period and tuning filled in."""
        self._running, self._run = run, run.run
        self._reached = reached
        self._task: asyncio.Task[RunResult] | None = None
        self._begun = self._ended_early = False
        """Whether the task has begun to run. Otherwise, `interrupt` came before any motion."""
        self._result: Result | None = None

    def start(self) -> asyncio.Task[RunResult]:
        """Start the run and return its task. Idempotent. To end the run early, use `interrupt`."""
        if self._task is None:
            self._task = asyncio.get_running_loop().create_task(self._carry_out(), name="run")
            self._task.add_done_callback(self._reached.over)
        return self._task

    async def reached(self, phase: str) -> None:
        """Wait until the run has entered a phase: connect, tare, one of `Phase` (approach, track, retract, move,
        seek, zero), or end.

        Starts the run if necessary. If the run ends without entering the phase, the exception that ended the run is
        raised, or ConfigError.
        """
        task = self.start()
        await self._reached.wait(phase)
        if phase not in self._reached.phases:
            result = await task
            raise ConfigError(f"the run ended before the phase {phase!r}: {result.text or result.outcome}")

    async def finished(self) -> RunResult:
        """Wait for the end of the run, starting the run if necessary, and return its result.

        Raises BridgeError if a device fails before the movement has begun.
        """
        return await asyncio.shield(self.start())

    def interrupt(self) -> None:
        """Let the run retract from the next cycle on, and then end; if nothing has moved yet, end it at once."""
        if self._run.interrupt() is Act.CLOSE:
            self._ended_early = True
            if self._task is not None and self._begun:  # a task is not affected before its first step
                self._task.cancel()

    async def _carry_out(self) -> RunResult:
        """Carry out the run. Return its result even if `interrupt` ended it before any motion."""
        self._begun = True
        try:
            return _NEVER_MOVED if self._ended_early else await self._run()
        except asyncio.CancelledError:
            if self._ended_early:
                return _NEVER_MOVED
            raise

    @property
    def result(self) -> Result:
        """Results of the run, available after exit from the context. Raises ConfigError before that."""
        if self._result is None:
            raise ConfigError("the result is available after the context of the simulation has exited")
        return self._result


class _Reached:
    """Phases that a run has entered, and the tasks that wait for a phase."""

    def __init__(self) -> None:
        self.phases: list[str] = []
        self._changed = asyncio.Event()
        self._over = False

    async def wait(self, phase: str) -> None:
        while phase not in self.phases and not self._over:
            self._changed.clear()
            await self._changed.wait()

    def on_event(self, record: EventRecord) -> None:
        """Handle an event of the run."""
        if record.kind == EventKind.PHASE:
            self.phases.append(record.text)
            self._changed.set()

    def over(self, task: Any) -> None:
        self._over = True
        self._changed.set()


class _Observer(Listener):
    """Watcher that reports the cycles to a program. An exception of the program ends the run, and then the
    simulation.
    """

    def __init__(self, observe: Observe) -> None:
        super().__init__({CycleRecord: self._cycle})
        self._observe = observe
        self.error: Exception | None = None

    def _cycle(self, record: CycleRecord) -> None:
        if self.error is not None:
            return
        try:
            self._observe(record)
        except Exception as error:
            self.error = error
            raise


def _callers_level() -> int:
    """Return the stack level for a warning, so that it refers to the line in the user's program."""
    frame, level = sys._getframe(1).f_back, 2
    while frame is not None and frame.f_globals.get("__name__", "").partition(".")[0] in _BETWEEN:
        frame, level = frame.f_back, level + 1
    return level


@asynccontextmanager
async def simulating(
    config: Config, observe: Observe | None, takes: Collection[type] = RECORDS
) -> AsyncIterator[Simulation]:
    """Run in the background while the context is open. See `api.simulation`. `takes` holds the types of records that
    the result keeps.
    """
    clock = Clock.running()
    observer = None if observe is None else _Observer(observe)
    reached = _Reached()
    try:
        setup = Setup(config)
        cell = check(setup, clock.is_virtual, clock.now())
        if setup.remark:
            warnings.warn(setup.remark, stacklevel=_callers_level())
        keeper = KeptRecords(clock.wall_ns, metadata_of(setup.config, clock.is_virtual), takes)
        log = RunLog(clock, [keeper, *([] if observer is None else [observer])])
        simulation: Simulation | None = None
        try:
            async with running(setup, log, cell) as run:
                log.join(Listener({EventRecord: reached.on_event}))
                simulation = Simulation(run, reached)
                try:
                    yield simulation
                finally:
                    await _end(simulation)
        finally:
            result = _how_ended(simulation)
            log.close(run_end(result, None if simulation is None else simulation._running, setup.facts))
            if simulation is not None:
                simulation._result = Result(result, keeper)
        if simulation._task is not None and simulation._task.done() and not simulation._task.cancelled():
            simulation._task.result()  # raises what prevented the run from moving
    finally:
        clock.close()
    if observer is not None and observer.error is not None:
        raise observer.error


async def _end(simulation: Simulation) -> None:
    """Wait for the run, after letting it retract if it has not ended. A cancellation of this task is delayed until
    then.
    """
    task, cancelled = simulation._task, False
    if task is None or task.done():
        return
    simulation.interrupt()
    while not task.done():
        try:
            await asyncio.wait([task])
        except asyncio.CancelledError:
            cancelled = True
    if cancelled:
        raise asyncio.CancelledError


def _how_ended(simulation: Simulation | None) -> RunResult:
    """Return the result of a run that has ended, or that never began."""
    if simulation is None or (task := simulation._task) is None:
        return _NEVER_MOVED
    if task.cancelled():
        return simulation._run.ending.result or (_NEVER_MOVED if simulation._ended_early else _CANCELLED)
    failure = task.exception()
    if failure is None:
        return task.result()
    if isinstance(failure, BridgeError):
        return RunResult(Outcome.STOPPED, failure.reason(Cause.ROBOT_NOT_READY))
    return RunResult(Outcome.STOPPED, explain_exception(failure))


@asynccontextmanager
async def opening_devices(config: Config) -> AsyncIterator[OpenDevices]:
    """Keep robot and sensor started while the context is open. See `api.open_devices`."""
    try:
        refuse_faults(config.faults, "open_devices", "call `panel.inject`")
    except ValueError as error:
        raise ConfigError(str(error)) from error
    clock = Clock.running()
    try:
        setup = Setup(config)
        if setup.sensor.is_emulated and not (setup.robot.is_emulated or clock.is_virtual):
            compose.check_panel(setup, clock.is_virtual)
            wiring = Wiring("robot", clock, NullLog())
            async with aclosing(await compose.connect_robot(setup.robot, wiring)) as robot:
                robot.start()
                yield OpenDevices(robot, None, clock, None)
            return
        check_wires(setup, Start(clock.is_virtual))
        async with compose.open_devices(setup, clock, NullLog()) as devices:
            yield OpenDevices(devices.robot, devices.sensor, clock, devices.cell)
    finally:
        clock.close()
