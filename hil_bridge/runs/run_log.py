"""Everything that a run and its devices tell, on its way into the record: cycles, events, frames, wires, the truth."""

import time
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager
from importlib.metadata import version
from platform import platform, python_version
from socket import gethostname
from typing import Any, Protocol

from emulators.cell import Cell
from hil_bridge.clock import Clock
from hil_bridge.control.course.task import TARE
from hil_bridge.devices.facts import Devices, Pacing, Sensor
from hil_bridge.devices.robots.seam import RobotLink
from hil_bridge.devices.sensors.stream import ForceSensor
from hil_bridge.errors.causes import Cause, Reason
from hil_bridge.errors.failures import FAILED_EVENT, RAISED, of_others, raise_if_asked, tell_failure
from hil_bridge.record import (
    PHASE_EVENT,
    CycleRecord,
    EventRecord,
    LinkLog,
    LinkRecord,
    RunEnd,
    SensorRecord,
    StepRecord,
    WireRecord,
)
from hil_bridge.record.removed_map import MEDIA_TYPE, REMOVED_NAME
from hil_bridge.record.topics import Record
from hil_bridge.runs import compose
from hil_bridge.runs.cycle import Run, RunResult
from hil_bridge.runs.faults.schedule import FaultSchedule
from hil_bridge.runs.setup import Setup
from hil_bridge.runs.truth import GroundTruth
from hil_bridge.settings.configuration import Config, dump
from hil_bridge.transports import Direction
from protocol.wrench import WrenchFrame


class Keeper(Protocol):
    """Takes the records of a run in order, as `recording.Recorder` does."""

    def put(self, record: Record) -> None:
        """Take a record."""

    def devices(self, facts: Mapping[str, str]) -> None:
        """Take the facts of the devices, JSON by name."""

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """Take an attachment."""

    def pause(self, seconds: float) -> None:
        """The run awaits nothing for so long, s."""

    def close(self, end: Mapping[str, str]) -> None:
        """Take the end. Harmless when called again. Raises BridgeError for records that could not be kept."""


class Watcher(Protocol):
    """Told of a run after its record; must not block."""

    def cycle(self, record: CycleRecord) -> None:
        """A cycle has ended."""

    def event(self, record: EventRecord) -> None:
        """Something happened beside the cycles."""

    def pause(self, seconds: float) -> None:
        """A block is on the robot's line, and nothing can answer it before its last character, s."""


def metadata_of(config: Config, virtual: bool) -> dict[str, str]:
    """Facts that are known before the run, for its record. Of a run in virtual time they are the same on every host,
    so that its recording is.
    """
    where = (
        {"time": "virtual"}
        if virtual
        else {"time": "real", "host": gethostname(), "platform": f"Python {python_version()}, {platform()}"}
    )
    return where | {
        "config": dump(config),
        "controller": config.controller.name,
        "seed": str(config.run.seed),
        "version": version("hil-bridge"),
    }


class RunLog:
    """The log of one run and of its devices. It opens the devices, since their facts and the truth belong to it."""

    verbose = True
    """Setting of a `DeviceLog`: the record holds every event of a link."""

    def __init__(self, setup: Setup, clock: Clock, keeper: Keeper, watcher: Watcher) -> None:
        self._setup = setup
        self._clock = clock
        self._keeper = keeper
        self._watcher = watcher
        self._logs = {
            "robot": LinkLog(lambda at, pieces: self._put(at, LinkRecord(at, pieces))),
            "sensor": LinkLog(lambda at, pieces: self._put(at, WireRecord(at, "sensor", pieces))),
        }
        """Logs of the devices' wires, by device."""
        self._truths: GroundTruth | None = None
        self._faults: FaultSchedule | None = None
        self.facts = setup.facts
        """Facts of the robot; with the line of its URL once it is connected."""
        self.robot: RobotLink | None = None
        self.sensor: ForceSensor | None = None
        self.run: Run | None = None
        """The run over the devices, once they are open."""
        self.steps: list[StepRecord] = []
        """Steps of a program that have ended."""
        self._failed: Reason | None = None
        """Failure of the emulated cell."""

    # --- records and notices of the run and the devices

    def cycle(self, record: CycleRecord) -> None:
        """A cycle has ended."""
        self._put(record.answered_at, record)
        if self._truths is not None:
            self._truth(self._truths, lambda truths: truths.cycle(record))
        if self._faults is not None:
            self._faults.cycle(record)
        self._watcher.cycle(record)

    def event(self, record: EventRecord) -> None:
        """Something happened beside the cycles."""
        self._put(record.at, record)
        if record.kind == PHASE_EVENT and record.text == TARE:
            self._keeper.devices(self._devices().as_metadata())
        self._watcher.event(record)
        if self._faults is not None:
            self._faults.event(record)

    def _truth(self, truths: GroundTruth, ask: Callable[[GroundTruth], object]) -> None:
        """Ask for the truth, in which code of another package may have a part; no more once that has failed."""
        try:
            ask(truths)
        except RAISED as error:
            raise_if_asked(error)
            if not of_others(error):
                raise
            self._truths = None
            tell_failure("the truth of the emulated cell", error, self.notice)

    def step(self, record: StepRecord) -> None:
        """A step of a program has ended."""
        self._put(record.at, record)
        self.steps.append(record)

    def frame(self, frame: WrenchFrame) -> None:
        """A complete frame of the sensor has arrived."""
        self._logs["robot"].age(frame.at)  # while the robot is silent, frames alone come
        self._keeper.put(SensorRecord(frame.at, frame.sequence, frame.values))

    def notice(self, kind: str, text: str) -> None:
        """A device tells something that is worth a line in the record."""
        self.tell(kind, text)
        if kind == FAILED_EVENT:
            self._failed = Reason(Cause.CELL_FAILED, text)
            if self.run is not None:
                self.run.fail(self._failed)

    def tell(self, kind: str, text: str, **values: Any) -> None:
        """Something beside the cycles happens now; `values` are further fields of its record."""
        self.event(EventRecord(self._clock.now(), kind, text, **values))

    def traffic(self, device: str, direction: Direction, data: Any) -> None:
        """Data have just gone over a device's wire."""
        self._logs[device].take(self._clock.now(), direction, data)
        if device == "robot" and direction is Direction.SENT and len(data) > 1:
            seconds = len(data) * (self.facts.byte_time_s or 0.0)
            self._keeper.pause(seconds)
            self._watcher.pause(seconds)

    def link_event(self, device: str, text: str) -> None:
        """Something happened on a device's link."""
        self._logs[device].note(self._clock.now(), text)

    def _put(self, at: float, record: Record) -> None:
        """Record something of this time, and before it what the devices' logs hold for too long by then."""
        for log in self._logs.values():
            log.age(at)
        self._keeper.put(record)

    def _devices(self) -> Devices:
        """Facts of robot and sensor, both being ready."""
        assert self.sensor is not None
        return Devices(self.facts, Sensor(self._setup.sensor.kind.name, self.sensor.facts))

    # --- begin and end

    @asynccontextmanager
    async def opened(self, cell: Cell[Any, Any] | None) -> AsyncIterator[compose.Devices]:
        """The devices, started, and `run` over them; `cell` as of `compose.open_devices`, which raises too."""
        setup, clock = self._setup, self._clock
        async with compose.open_devices(setup, clock, self, cell=cell) as devices:
            self.robot, self.sensor = devices.robot, devices.sensor
            self.facts = setup.identified(devices.robot.facts)
            if devices.served is not None:
                self._emulated(devices.served)
            self.run = Run(setup, clock, devices.robot, devices.sensor, self)
            self.run.fail(self._failed)
            yield devices

    def _emulated(self, served: compose.ServedCell) -> None:
        cell = served.cell
        streamed = self._setup.facts.pacing is Pacing.STREAMED
        self._truths = GroundTruth(cell, self._setup.sensor.is_emulated, self._keeper.put, streamed)
        self._faults = FaultSchedule(self._setup.config.faults, cell, self._clock, self.event, self._pause)

    def _pause(self, seconds: float) -> None:
        """A fault of the computer: it stands still."""
        if self.run is not None and self._clock.is_virtual:
            self.run.stand_still(seconds)
        else:
            time.sleep(seconds)

    def end(self, result: RunResult) -> RunEnd:
        """The end of the run, for the record."""
        sensor = self.sensor
        return RunEnd(
            result.outcome,
            result.reason,
            self.facts.line_floor_s,
            dict(self.robot.counters) if self.robot else {},
            sensor.lost if sensor else None,
            sensor.delay if sensor and sensor.is_ready else None,
            result.left,
            result.followed,
            {} if result.rest is None else result.rest.values,
            "" if result.rest is None else result.rest.place,
        )

    def close(self, end: RunEnd) -> None:
        """Hand over what waits, then the end. Harmless when called again. Raises as `Keeper.close`."""
        for log in self._logs.values():
            log.flush()
        if self._faults is not None:
            self._faults.close()
        if self._truths is not None:
            self._truth(self._truths, GroundTruth.close)
        if self._truths is not None and (removed := self._truths.removed_map()) is not None:
            self._keeper.attach(REMOVED_NAME, MEDIA_TYPE, removed.as_json())
        self._keeper.close(end.as_metadata())
