"""One run from the outside: event loop, wires, recorder, view, Ctrl-C, and what is left on the disk."""

import asyncio
import os
import signal
import sys
import tempfile
import threading
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager, suppress
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING

import click

from emulators.cell import Cell
from hil_bridge.checks import check
from hil_bridge.clock import Clock, run_real, run_virtual
from hil_bridge.compose import opened_devices
from hil_bridge.config import Config, dump
from hil_bridge.devices import ForceSensor, RobotLink
from hil_bridge.errors import BridgeError, ConfigError
from hil_bridge.faults import FaultSchedule
from hil_bridge.line_time import line_floor
from hil_bridge.realtime import collect_young, prompt_threads, quiet_garbage, scheduled
from hil_bridge.recording import (
    CHUNKS,
    VIRTUAL_CHUNKS,
    CycleRecord,
    EventRecord,
    LinkLog,
    Outcome,
    Recorder,
    RunEnd,
    SensorRecord,
    Summary,
    read,
    summarise,
)
from hil_bridge.recording.latency import AnswerTimes
from hil_bridge.run import Run, RunResult
from hil_bridge.transports import Direction
from hil_bridge.truth import Truths
from hil_bridge.view import REFRESH_SECONDS, Health
from protocol.jr3 import SensorFrame
from protocol.values import dataclass

if TYPE_CHECKING:
    from hil_bridge.view.live import LiveView

EXIT_CODES = {Outcome.COMPLETED: 0, Outcome.STOPPED: 3, Outcome.INTERRUPTED: 130}
"""130 is what a shell expects of a command that Ctrl-C ended."""

_DRAWING_S = 0.015
"""What drawing the view takes: 8 ms as a rule, 12 ms at most in a run of 20 s. Chosen."""
_UNDER_WAY_S = 0.005
"""Chosen: after the end of a cycle; a status order takes ten times as long on a 9600-baud line."""

_COLLECT_EVERY = 64
"""Cycles between two collections. Chosen: only what is still in use costs one time, and that is as much however
rarely it comes.
"""

TROUBLE = ("block repeated", "bid repeated", "time-out", "bad block", "bad checksum", "gap in block")
"""Counters of the link that the view adds up as link errors."""


@dataclass(frozen=True, slots=True)
class Outputs:
    """Files that a run leaves; None for what is not wanted."""

    record: Path | None = None
    summary: Path | None = None
    report: Path | None = None


def execute(
    config: Config, virtual: bool, outputs: Outputs, view: bool, config_file: Path | None = None
) -> int:
    """Run once, leave the outputs, print the figures; the exit code. `config_file` is never written over.

    Raises BridgeError when a device fails before the movement has begun, or a file cannot be written.
    """
    check(config, virtual)  # before an earlier recording is replaced
    _prepare(outputs, config_file)
    with _record_path(outputs) as path:
        session = _Session(config, path, view)
        awake_s = config.realtime.busy_poll_ms * 1e-3
        result = run_virtual(session.main) if virtual else run_real(session.main, awake_s)
        ended = f": {result.cause}" if result.cause and result.outcome is not Outcome.STOPPED else ""
        lines = [f"{result.outcome}{ended}"]
        if session.cycles:
            lines += _leave(outputs, path)
        elif outputs.record is not None:
            lines.append(f"record: {outputs.record}")
        for line in lines:
            click.echo(line)
    if result.outcome is Outcome.STOPPED:
        click.echo(f"hil-bridge: stopped: {result.cause}", err=True)
    return EXIT_CODES[result.outcome]


def _prepare(outputs: Outputs, config_file: Path | None) -> None:
    """Find out before the robot moves what cannot be written afterwards. Raises ConfigError."""
    files = [file for file in (outputs.record, outputs.summary) if file is not None]
    for folder in (*(file.parent for file in files), *filter(None, (outputs.report,))):
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise ConfigError(
                f"cannot make the folder {folder}: {error.strerror}; name another place"
            ) from error
        if not os.access(folder, os.W_OK):
            raise ConfigError(f"cannot write into {folder}: no permission; name another place")
    for file in files:
        if file.is_dir():
            raise ConfigError(f"cannot write {file}: it is a folder; name a file in it")
    taken = {} if config_file is None else {config_file.resolve(): "the configuration"}
    for option, wanted in (("--record", outputs.record), ("--summary", outputs.summary)):
        if wanted is None:
            continue
        place = wanted.resolve()
        if place in taken:
            raise ConfigError(f"{option} {wanted} would overwrite {taken[place]}; name another file")
        taken[place] = option


def _leave(outputs: Outputs, path: Path) -> list[str]:
    """Leave what is wanted of the record at `path`, before anything is said: whoever reads it may have gone. The lines
    to print.
    """
    recording = read(path)
    summary = summarise(recording)
    lines = _figures(summary)
    if outputs.record is not None:
        lines.append(f"record: {outputs.record}")
    if outputs.summary is not None:
        summary.write_json(outputs.summary)
        lines.append(f"summary: {outputs.summary}")
    if outputs.report is not None:
        from hil_bridge.report import write_report

        lines.append(f"report: {write_report(recording, summary, outputs.report)}")
    return lines


@contextmanager
def _record_path(outputs: Outputs) -> Iterator[Path]:
    """Where the run is recorded; in a temporary folder when nobody wants to keep it, for the figures come from it."""
    if outputs.record is not None:
        yield outputs.record
        return
    with tempfile.TemporaryDirectory(prefix="hil-bridge-") as folder:
        yield Path(folder) / "run.mcap"


class _Session:
    """Everything around one `Run`, inside its event loop. Also its log."""

    def __init__(self, config: Config, record: Path, view: bool) -> None:
        self._config = config
        self._record_path = record
        self._view_wanted = view
        self._link = config.robot.link
        self._clock: Clock
        self._recorder: Recorder
        self._link_log: LinkLog
        self._truths: Truths | None = None
        self._faults: FaultSchedule | None = None
        self._view: LiveView | None = None
        self._robot: RobotLink | None = None
        self._sensor: ForceSensor | None = None
        self._may_draw = asyncio.Event()
        """Set when a pause of the loop is long enough for it."""
        self.cycles = 0
        """Cycles so far; a record without any has no figures."""

    # --- what the run and the devices tell

    def cycle(self, record: CycleRecord) -> None:
        """A cycle has ended."""
        self.cycles += 1
        self._recorder.put(record)
        if self._truths is not None:
            self._truths.cycle(record)
        if self._faults is not None:
            self._faults.cycle(record)
        if self._view is not None:
            self._view.update(record)
        if self.cycles % _COLLECT_EVERY:
            return
        if self._clock.is_virtual:
            collect_young()
        else:
            # By then the next order is on the line, and everybody waits for its answer.
            self._clock.call_at(self._clock.now() + _UNDER_WAY_S, collect_young)

    def event(self, record: EventRecord) -> None:
        """Something happened beside the cycles."""
        self._recorder.put(record)
        if self._view is not None and record.kind == "phase":
            self._view.enter(record.text)
        if self._faults is not None:
            self._faults.event(record)

    def _frame(self, frame: SensorFrame) -> None:
        self._recorder.put(SensorRecord(frame.at, frame.sequence, frame.counts))

    def _notice(self, kind: str, text: str) -> None:
        self.event(EventRecord(self._clock.now(), kind, text))

    def _traffic(self, direction: Direction, data: bytes) -> None:
        self._link_log.take(self._clock.now(), direction, data)
        if direction is Direction.SENT and len(data) > 1:
            # a block is on the line, and nothing can answer it before its last character
            seconds = len(data) * self._link.character_time
            self._recorder.pause(seconds)
            if seconds >= _DRAWING_S:
                self._may_draw.set()

    def _link_event(self, text: str) -> None:
        self._link_log.note(self._clock.now(), text)

    def _emulated(self, cell: Cell) -> None:
        self._truths = Truths(cell, self._config.sensor, self._recorder.put)
        self._faults = FaultSchedule(self._config.faults, cell, self._clock, self._notice)

    # --- the run

    async def main(self) -> RunResult:
        """Open everything, run, close everything; the record is whole whatever happened."""
        clock = self._clock = Clock.running()
        config = self._config
        self._recorder = Recorder(
            self._record_path,
            clock.wall_ns,
            threaded=not clock.is_virtual,
            chunks=VIRTUAL_CHUNKS if clock.is_virtual else CHUNKS,
            metadata={
                "config": dump(config),
                "controller": config.controller.name,
                "seed": str(config.run.seed),
                "version": version("hil-bridge"),
            },
        )
        self._link_log = LinkLog(self._recorder.put)
        end = RunEnd(Outcome.STOPPED)
        try:
            with self._scheduled():
                result = await self._with_devices()
            end = self._end(result)
            return result
        except BridgeError as error:
            end = self._end(RunResult(Outcome.STOPPED, str(error)))
            raise
        except (
            asyncio.CancelledError
        ):  # Ctrl-C before the movement: everything has been closed on the way here
            result = RunResult(Outcome.INTERRUPTED, "before the movement began")
            end = self._end(result)
            return result
        finally:
            self._link_log.flush()
            if self._faults is not None:
                self._faults.close()
            if self._truths is not None:
                self._truths.close()
            self._recorder.close(end.as_metadata())
            clock.close()

    @contextmanager
    def _scheduled(self) -> Iterator[None]:
        """The loop's thread as the configuration wants it; the recorder has been started, and stays as it is."""
        with quiet_garbage():
            if self._clock.is_virtual:
                yield
                return
            with prompt_threads(), scheduled(self._config.realtime) as executor:
                if executor is not None:
                    asyncio.get_running_loop().set_default_executor(executor)
                yield

    def _end(self, result: RunResult) -> RunEnd:
        return RunEnd(
            result.outcome,
            result.cause,
            line_floor(self._link),
            dict(self._robot.counters) if self._robot else {},
            self._sensor.lost if self._sensor else None,
            self._sensor.delay if self._sensor else None,
        )

    async def _with_devices(self) -> RunResult:
        config, clock = self._config, self._clock
        async with opened_devices(
            config,
            clock,
            self._frame,
            self._notice,
            self._traffic,
            self._emulated,
            _tell_panel,
            self._link_event,
        ) as (robot, sensor):
            self._robot, self._sensor, self._link = robot, sensor, robot.profile
            run = Run(config, clock, robot, sensor, self)
            async with self._shown(), self._interruptible(run):
                return await run()

    @asynccontextmanager
    async def _interruptible(self, run: Run) -> AsyncIterator[None]:
        """Ctrl-C retracts while the robot moves, and ends at once before that.

        Python's own signal handlers, since a loop in virtual time has none: they run between two callbacks'
        instructions, so they only set a flag or ask for the cancellation.
        """
        loop, task = asyncio.get_running_loop(), asyncio.current_task()
        assert task is not None

        def interrupted(number: int, frame: object) -> None:
            if run.moving:
                run.interrupt()
            else:
                loop.call_soon_threadsafe(task.cancel)

        if threading.current_thread() is not threading.main_thread():  # only there may handlers be set
            yield
            return
        before = {number: signal.signal(number, interrupted) for number in (signal.SIGINT, signal.SIGTERM)}
        try:
            yield
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)

    @asynccontextmanager
    async def _shown(self) -> AsyncIterator[None]:
        """The live view in a task of its own; in virtual time there is nobody to watch."""
        if not self._view_wanted or self._clock.is_virtual:
            yield
            return
        from hil_bridge.view.live import LiveView

        config = self._config
        self._view = LiveView(
            config.run.duration_s,
            config.task.force_n,
            sys.stdout,
            line_floor(self._link),
            AnswerTimes.on(self._link),
        )
        task = asyncio.create_task(self._refresh(self._view), name="view")
        try:
            with self._view:
                yield
        finally:
            task.cancel()
            with suppress(asyncio.CancelledError):
                await task

    async def _refresh(self, view: "LiveView") -> None:
        """Draw now and then, in a pause of the loop where one comes: a thread that draws holds it up."""
        while True:
            await asyncio.to_thread(view.refresh, self._clock.now(), self._health())
            await asyncio.sleep(REFRESH_SECONDS)
            self._may_draw.clear()
            # not wait_for, which swallows a cancellation that comes together with the event before Python 3.12
            with suppress(TimeoutError):
                async with asyncio.timeout(REFRESH_SECONDS):
                    await self._may_draw.wait()

    def _health(self) -> Health:
        assert self._robot is not None
        assert self._sensor is not None
        counters, newest = self._robot.counters, self._sensor.newest
        return Health(
            link_errors=sum(counters.get(name, 0) for name in TROUBLE),
            frames_lost=self._sensor.lost,
            sensor_at=None if newest is None else newest.at,
            link=dict(counters),
        )


def _tell_panel(url: str) -> None:
    click.echo(f"panel: {url}")


def _figures(summary: Summary) -> list[str]:
    """The figures that a person wants to see at once, a line each."""
    tracked, figures = summary.phases_s.get("track", 0.0), summary.figures
    if summary.force_reference_n is None or not figures:
        return []
    rows = [("tracked", f"{tracked:.1f} s at {summary.force_reference_n:g} N with {summary.controller}")]
    if summary.force_mean_steady_n is not None:
        rows.append(
            (
                "steady force",
                f"{summary.force_mean_steady_n:.2f} N mean, {figures['steady_peak_to_peak_n']:.2f} N peak to peak",
            )
        )
    rise = figures["rise_samples"]
    rows += [
        ("rise to 90 %", "not reached" if rise is None else f"{rise:.0f} samples, {figures['rise_s']:.2f} s"),
        ("overshoot", f"{figures['overshoot_percent']:.1f} %"),
        ("RMS error", f"{figures['rms_error_n']:.2f} N"),
        ("contact losses", f"{figures['contact_losses']:.0f}"),
    ]
    if summary.cycle_time is not None:
        floor = f", {summary.line_floor_s * 1e3:.1f} ms of it the line" if summary.line_floor_s else ""
        rows.append(("cycle time", f"{summary.cycle_time.mean_s * 1e3:.1f} ms mean{floor}"))
    if summary.latency_sentence:
        rows.append(("latency", summary.latency_sentence))
    return [f"  {name:<15}{text}" for name, text in rows]
