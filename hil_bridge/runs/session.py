"""One run from the command line: its watchers, its outputs, and the report of its end."""

import asyncio
import signal
import time
from collections.abc import Callable
from contextlib import AsyncExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

from emulators.cell import Cell
from hil_bridge.clock import VIRTUAL_EPOCH, Clock, run_real_on, run_virtual_on
from hil_bridge.clock.realtime import collect_generation_1, real_time_loop
from hil_bridge.console.debugging import describe_bug, is_debug_requested
from hil_bridge.console.screen import LEAVE_SECONDS, Terminal
from hil_bridge.errors import BridgeError, Cause
from hil_bridge.errors.cause_row import CRITERION, INTERRUPTED
from hil_bridge.errors.failures import last_line
from hil_bridge.record import CycleRecord, EventKind, Outcome, Recorder, RunEnd
from hil_bridge.record.analysis.steps import failed_criteria, step_outcomes
from hil_bridge.record.kept import READ_RECORDS, KeptRecords
from hil_bridge.record.next_commands import RunPlaces
from hil_bridge.record.reader import Recording, read
from hil_bridge.record.recorder import REAL_TIME, VIRTUAL, map_buffers
from hil_bridge.runs.checks import check
from hil_bridge.runs.notes import Notes
from hil_bridge.runs.outputs import Outputs, record_path, run_places, settle_outputs, write_outputs
from hil_bridge.runs.page import Page
from hil_bridge.runs.result import RunResult
from hil_bridge.runs.run_log import RunLog, metadata_of
from hil_bridge.runs.running import Running, run_end, running
from hil_bridge.runs.setup import Setup
from hil_bridge.runs.signals import Signals, unless_hung_up
from hil_bridge.runs.stopping import Stopping
from hil_bridge.runs.terminal_view import TerminalView
from hil_bridge.runs.views import Views, open_feed
from hil_bridge.runs.watchers import Listener
from hil_bridge.settings.configuration import Config
from hil_bridge.show.web.feed import Feed

OUTPUT_TIMEOUT_S = 5.0
"""Time limit for a blocked output if a signal other than from the keyboard ended the run, s. Chosen."""
KEPT_RECORDS = 500_000
"""Maximum number of records that a run in virtual time keeps in memory for its figures. Chosen: an hour with a
stream of 100 Hz, about 300 MB. For a longer run, the records are read from its file.
"""
_STATUS_DELAY_S = 0.005
"""Delay of a garbage collection after the end of a cycle, s. Chosen: a status order takes ten times as long on a
9600-baud line.
"""
_COLLECT_EVERY = 64
"""Number of cycles between two garbage collections. Chosen: the cost depends only on the objects in use, regardless
of how rare the collections are.
"""


def execute(
    config: Config, virtual: bool, outputs: Outputs, view: bool | Views, config_file: Path | None = None
) -> int:
    """Run once, write the outputs, print the figures and return the exit code.

    `config_file` is never overwritten. `view` selects where the run is shown; True stands for the terminal alone.
    Raises BridgeError if a device fails before the movement has begun, or if a file cannot be written.
    """
    setup = Setup(config)
    cell = check(
        setup, virtual, VIRTUAL_EPOCH if virtual else time.monotonic()
    )  # before a recording is replaced
    signals = Signals()
    views = view if isinstance(view, Views) else Views(view)
    with signals.installed(), open_feed(views, virtual) as feed:
        outputs = settle_outputs(outputs, config_file)
        with record_path(outputs) as path, Terminal() as terminal:
            if outputs.own_folder and not virtual:
                terminal.out.say(f"recording into {path.parent}")
            kept = replace(outputs, record=path, temporary=outputs.record is None)
            session = Session(setup, kept, terminal, signals)
            session.show_view, session.feed, session.cell = views.terminal, feed, cell
            session.places = run_places(setup.config, kept, config_file)
            awake_s = setup.config.realtime.busy_poll_ms * 1e-3
            try:
                main, stray = session.main, session.take_stray
                result = run_virtual_on(main, stray) if virtual else run_real_on(main, awake_s, stray)
            except BridgeError:
                _leave_outputs(session, outputs)
                raise
            except Exception as error:
                if outputs.record is not None:
                    error.add_note(f"record: {outputs.record}")
                raise
            return _finish(session, result, outputs)


def _leave_outputs(session: "Session", outputs: Outputs) -> None:
    """Write the requested outputs of a run that ended before its movement, and print their paths.

    The error that ended the run takes precedence, so a file that cannot be written is not reported.
    """
    if session.end is not None:
        lines, _ = write_outputs(outputs, session.recording, session.end)
        session.terminal.print_last([], lines, OUTPUT_TIMEOUT_S)


def _finish(session: "Session", result: RunResult, outputs: Outputs) -> int:
    """Write the requested outputs, print how the run ended, and return the exit code.

    All files are written before the first line is printed, because the reader of the output may already have closed
    it. After a signal, no report is written. After a second signal, a blocked terminal is not waited for.
    """
    signals, notes = session.signals, session.notes
    code = result.exit_code
    text, left = result.text, result.left
    ended = f": {text}" if text and result.outcome is not Outcome.STOPPED else ""
    lines = [f"{result.outcome}{ended}", *(f"then: {one}" for one in result.followed)]
    errors = [f"stopped: {text}"] if result.outcome is Outcome.STOPPED else []
    if result.outcome is Outcome.COMPLETED and (unmet := failed_criteria(step_outcomes(notes.steps))):
        errors.append(unmet)
        code = CRITERION
    if session.record_error is not None:
        errors.append(str(session.record_error))
        code = code or session.record_error.exit_code
    by_hand = signals.first in (None, signal.SIGINT, signal.SIGTSTP)
    patience = None if by_hand else OUTPUT_TIMEOUT_S
    record = [] if outputs.record is None else [f"record: {outputs.record}"]
    if session.hurried:
        lines += record
        patience = LEAVE_SECONDS
    elif notes.cycles:
        try:
            with signals.reacting_with(unless_hung_up):
                more, troubles = write_outputs(outputs, session.recording, session.end)
            lines += more or record
            errors += map(str, troubles)
            code = code or max((trouble.exit_code for trouble in troubles), default=0)
        except KeyboardInterrupt:
            lines += [*record, "interrupted before all requested outputs were written"]
            code, patience = INTERRUPTED, LEAVE_SECONDS
    else:
        lines += record
    if result.outcome is Outcome.STOPPED or session.end.retracted is False:
        commands = session.places.next_commands(result.outcome, bool(notes.cycles), session.end.retracted)
        lines += [f"next: {command}" for _, command in commands]
    lines += [f"fault: {text}" for text in notes.faults]
    if left:
        lines.append(f"left: {left}")
    if result.outcome is Outcome.STOPPED and notes.traces:
        errors[0] += "" if is_debug_requested() else "; --debug shows the traceback"
        errors = [*(text.rstrip() for text in notes.traces if is_debug_requested()), *errors]
    bugs = [describe_bug("; ".join([last_line(text), *record]), text) for text in notes.bugs]
    session.terminal.print_last([*bugs, *(f"hil-bridge: {text}" for text in errors)], lines, patience)
    return code


class Session:
    """Run from the command line with its watchers, inside its event loop. It closes everything in order."""

    def __init__(self, setup: Setup, outputs: Outputs, terminal: Terminal, signals: Signals) -> None:
        """Prepare a session. `outputs` names a recording, kept or temporary."""
        assert outputs.record is not None
        self._setup, self._outputs, self._path = setup, outputs, outputs.record
        self.terminal, self.signals, self.notes = terminal, signals, Notes()
        self.show_view = False
        self.places = RunPlaces()
        self.feed: Feed | None = None
        """Feed of the page in the browser."""
        self.cell: Cell[Any, Any] | None = None
        """Emulated cell, as powered up by the checks."""
        self.end = RunEnd(Outcome.STOPPED)
        """Metadata of the end, for the recording."""
        self.record_error: BridgeError | None = None
        """Reason why the recording is incomplete; None if it is complete."""
        self._stopping: Stopping | None = None
        self._kept: KeptRecords | None = None
        """Records from which the figures of a run in virtual time are computed."""

    @property
    def hurried(self) -> bool:
        """Whether another signal came after the movement had ended, so that the process must end at once."""
        return self._stopping is not None and self._stopping.hurried

    def take_stray(self, error: BaseException) -> bool:
        """Handle an exception from a loop callback. See `Stopping`."""
        return self._stopping is not None and self._stopping.take_stray(error)

    def recording(self) -> Recording:
        """Return the recording of the run, from memory if it is complete there, otherwise from its file. Raises
        ConfigError.
        """
        if self._kept is not None and self._kept.is_whole and self.record_error is None:
            return self._kept.recording()
        return read(self._path)

    async def main(self) -> RunResult:
        """Open everything, run, and close everything. The recording is completed in any case."""
        clock, setup = Clock.running(), self._setup
        map_buffers()
        recorder = self._record(clock)
        view = TerminalView(self.terminal, self.show_view, clock.is_virtual)
        page = None if self.feed is None else Page(self.feed, self.notes, self.places)
        watchers = (recorder, self.notes, None if clock.is_virtual else view, page, self._kept)
        log = RunLog(clock, [watcher for watcher in watchers if watcher is not None])
        log.with_true_states = not self._outputs.only_figures or page is not None
        stopping = self._stopping = Stopping(self.signals, log)
        log.join(Listener({CycleRecord: _collector(clock)}))
        if recorder is not None:
            log.join(Listener({CycleRecord: lambda _: self._check_recorder(recorder, log, view)}))
        run: Running | None = None

        async def with_devices() -> RunResult:
            nonlocal run
            async with running(setup, log, self.cell, ending=stopping.ending) as run:
                served = run.devices.served
                if served is not None and served.panel is not None:
                    self.terminal.out.say(f"panel: {served.panel}")
                if setup.remark:
                    self.terminal.out.say(setup.remark)
                if page is not None:
                    page.begin(run)
                async with view.showing(run, stopping, self.places):
                    return await run()

        try:
            if recorder is not None and recorder.error is not None:
                raise recorder.error
            with stopping.interruptible(), real_time_loop(setup.config.realtime, clock.is_virtual):
                try:
                    async with AsyncExitStack() as stack:
                        if page is not None:
                            await stack.enter_async_context(page.serving(setup, log, stopping, self.terminal))
                        result = await with_devices()
                except (asyncio.CancelledError, Exception) as error:  # everything is closed by now
                    result = stopping.ended_by(error, self.notes.bugs)
                self.end = run_end(result, run, setup.facts)
                self._close(log)
            return result
        except BridgeError as error:
            self.end = run_end(
                RunResult(Outcome.STOPPED, error.reason(Cause.ROBOT_NOT_READY)), run, setup.facts
            )
            raise
        finally:
            self._close(log)
            if page is not None:
                page.end(self.end)
            clock.close()

    def _record(self, clock: Clock) -> Recorder | None:
        """Prepare the records of the run: in a file, in memory in virtual time, or both.

        Return the recorder of the file; None if memory is enough.
        """
        metadata = metadata_of(self._setup.config, clock.is_virtual)
        temporary = self._outputs.temporary and clock.is_virtual
        if clock.is_virtual:
            spill = self._path if temporary else None
            self._kept = KeptRecords(clock.wall_ns, metadata, READ_RECORDS, KEPT_RECORDS, spill)
        if temporary:
            return None
        writing = VIRTUAL if clock.is_virtual else REAL_TIME
        return Recorder(self._path, clock.wall_ns, metadata, writing, self._outputs.overwrite)

    def _close(self, log: RunLog) -> None:
        """Finish the recording. Idempotent."""
        try:
            log.close(self.end)
        except BridgeError as error:
            self.record_error = error

    def _check_recorder(self, recorder: Recorder, log: RunLog, view: TerminalView) -> None:
        """Report a failure of the recorder at once. The run continues, because it does not depend on its recording."""
        if not recorder.trouble or self.notes.warning:
            return
        text = f"the recording {self._path} {recorder.trouble}"
        self.notes.warning = text
        log.notice(EventKind.RECORDER, text)
        self.terminal.err.say(f"hil-bridge: {text}; the run continues")
        view.warn(f"the recording {recorder.trouble}")  # short line


def _collector(clock: Clock) -> Callable[[CycleRecord], object]:
    """Return a function that collects garbage once every few cycles."""

    def collect(record: CycleRecord) -> None:
        if (record.cycle + 1) % _COLLECT_EVERY:
            return
        if clock.is_virtual:
            collect_generation_1()
        else:
            # The next order is then on the line, and the run only waits for its answer.
            clock.call_at(clock.now() + _STATUS_DELAY_S, collect_generation_1)

    return collect
