"""Harness of every run: devices, loop, faults and truth, with any number of watchers.

    log = RunLog(clock, watchers)
    async with running(setup, log) as run:
        result = await run()
    log.close(run_end(result, run))

The command line, the Python interface, experiments, benchmarks and tests are its watchers.
"""

import time
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, asynccontextmanager
from typing import Any

from emulators.cell import Cell
from hil_bridge.clock import Clock
from hil_bridge.control.course.intent import TARE
from hil_bridge.devices.facts import Devices, Pacing, RobotFacts, Sensor
from hil_bridge.devices.wiring import Wrap, unwrapped
from hil_bridge.errors.causes import Cause, Reason
from hil_bridge.errors.failures import RAISED, involves_plugin, raise_if_interrupt, report_failure
from hil_bridge.record import CycleRecord, EventKind, EventRecord, RunEnd, TruthRecord
from hil_bridge.record.removed_map import MEDIA_TYPE, REMOVED_NAME
from hil_bridge.runs import compose
from hil_bridge.runs.cycle import Run
from hil_bridge.runs.ending import Ending
from hil_bridge.runs.faults.schedule import FaultSchedule
from hil_bridge.runs.result import RunResult
from hil_bridge.runs.run_log import RunLog
from hil_bridge.runs.setup import Setup
from hil_bridge.runs.truth import GroundTruth
from hil_bridge.runs.watchers import Listener
from protocol.unmodelled import NotModelled


class Running:
    """Run with its open devices. Call it once. Code that acts on a run uses this class; watchers do not."""

    def __init__(self, setup: Setup, log: RunLog, devices: compose.Devices, ending: Ending) -> None:
        self.setup, self.log, self.devices = setup, log, devices
        self.robot, self.sensor, self.cell = devices.robot, devices.sensor, devices.cell
        self.clock: Clock = log.clock
        self.facts: RobotFacts = setup.identified(devices.robot.facts)
        """Facts of the robot, including the line from its URL."""
        self.run = Run(setup, devices.robot, devices.sensor, log, ending)

    async def __call__(self) -> RunResult:
        """Run to the end. Raises BridgeError if a device fails before the movement has begun."""
        return await self.run()

    def on_record(self, record: EventRecord) -> None:
        """Report the devices once they are ready, and end the run if the emulated cell has failed."""
        if record.kind == EventKind.PHASE and record.text == TARE:
            sensor = Sensor(self.setup.sensor.kind.name, self.sensor.facts)
            self.log.devices(Devices(self.facts, sensor).as_metadata())
        elif record.kind == EventKind.FAILED:
            self.run.fail(Reason(Cause.CELL_FAILED, record.text))

    def stall(self, seconds: float) -> None:
        """Suspend the process, to simulate a stalled computer."""
        if self.clock.is_virtual:
            self.run.stall(seconds)
        else:
            time.sleep(seconds)


class _Truth:
    """Source of the emulated cell's ground truth for the log. Code of plug-ins may be involved."""

    def __init__(self, running: Running, cell: Cell[Any, Any]) -> None:
        facts = running.setup.facts
        self._log = running.log
        self._truth: GroundTruth | None = GroundTruth(
            cell,
            running.setup.sensor.is_emulated,
            self._log.hand_over,
            packet_s=(facts.cycle_s or 0.0) if facts.pacing is Pacing.STREAMED else 0.0,
            with_states=self._log.with_true_states,
        )

    def cycle(self, record: CycleRecord) -> None:
        """Handle the end of a cycle."""
        self._ask(GroundTruth.cycle, record)

    def close(self) -> None:
        """Query the remaining truth at the end of the run."""
        self._ask(GroundTruth.close)
        if self._truth is not None and (removed := self._truth.removed_map()) is not None:
            self._log.attach(REMOVED_NAME, MEDIA_TYPE, removed.as_json())

    def _ask(self, ask: Callable[..., object], *arguments: object) -> None:
        """Query the ground truth. After a failure, it is never queried again."""
        if self._truth is None:
            return
        try:
            ask(self._truth, *arguments)
        except RAISED as error:
            raise_if_interrupt(error)
            if not involves_plugin(error):
                raise
            self._truth = None
            report_failure("the truth of the emulated cell", error, self._log.notice)


@asynccontextmanager
async def running(
    setup: Setup,
    log: RunLog,
    cell: Cell[Any, Any] | None = None,
    wrap: Wrap = unwrapped,
    ending: Ending | None = None,
) -> AsyncIterator[Running]:
    """Open the devices and return a run that has not started. The devices are closed on exit from the context.

    `cell` is the emulated cell if a check has already created it. `wrap` may insert a layer between each connection
    and its client. `ending` is shared with everything that may end the run from outside. Faults in the
    configuration are injected, and the ground truth of an emulated cell is recorded if a watcher accepts it. The
    owner of the log closes it. Raises the same exceptions as `compose.open_devices`.
    """
    run: Running | None = None
    failed: list[EventRecord] = []

    def on_record(record: EventRecord) -> None:
        if run is not None:
            run.on_record(record)
        elif record.kind == EventKind.FAILED:  # while the devices are opened
            failed.append(record)

    log.join(Listener({EventRecord: on_record}))
    async with AsyncExitStack() as after, compose.open_devices(setup, log.clock, log, wrap, cell) as devices:
        run = Running(setup, log, devices, ending or Ending())
        log.byte_time_s = run.facts.byte_time_s or 0.0
        for record in failed:
            run.on_record(record)
        if devices.cell is not None:
            _join_cell(run, devices.cell, after)
        if setup.remark:
            log.notice(EventKind.PACE, setup.remark)
        yield run


def _join_cell(run: Running, cell: Cell[Any, Any], after: AsyncExitStack) -> None:
    """Inject faults, and report the ground truth if a watcher accepts it. Both end with the stack."""
    log = run.log
    faults = FaultSchedule(run.setup.config.faults, cell, log.clock, log.event, run.stall)
    if log.wants(TruthRecord):
        truth = _Truth(run, cell)
        log.join(Listener({CycleRecord: truth.cycle}))
        after.callback(truth.close)
    log.join(Listener({CycleRecord: faults.cycle, EventRecord: faults.event}))
    after.callback(faults.close)

    def report(thing: NotModelled) -> None:
        log.tell(EventKind.NOT_MODELLED, str(thing), not_modelled=thing)

    compose.follow_unmodelled(cell, report)


def run_end(result: RunResult, run: Running | None, facts: RobotFacts) -> RunEnd:
    """Return the end of a run, for the recording. `facts` holds the facts of a robot that was never connected."""
    sensor = None if run is None else run.sensor
    return RunEnd(
        outcome=result.outcome,
        reason=result.reason,
        line_floor_s=(facts if run is None else run.facts).line_floor_s,
        link={} if run is None else dict(run.robot.counters),
        sensor_lost=None if sensor is None else sensor.lost,
        sensor_delay_s=sensor.delay if sensor is not None and sensor.is_ready else None,
        left=result.left,
        followed=result.followed,
        rest={} if result.rest is None else result.rest.values,
        place="" if result.rest is None else result.rest.place,
    )
