"""One run from the outside: event loop, wires, recorder, view, signals, and how it ended."""

import asyncio
import os
import signal
import time
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from emulators.cell import Cell
from hil_bridge.clock import VIRTUAL_EPOCH, Clock, run_real_on, run_virtual_on
from hil_bridge.clock.realtime import collect_generation_1, real_time_loop
from hil_bridge.console import keys
from hil_bridge.console.debugging import debug_wanted, told_bug
from hil_bridge.console.screen import LEAVE_SECONDS, Terminal
from hil_bridge.errors import BridgeError, Cause
from hil_bridge.errors.cancelling import is_asked
from hil_bridge.errors.cause_row import CRITERION, INTERRUPTED
from hil_bridge.errors.failures import BUG_EVENT, TRACEBACK_EVENT, failure_event, traceback_of, unexpected
from hil_bridge.errors.text_files import format_path
from hil_bridge.record import (
    CHECK_EVENT,
    REAL_TIME,
    VIRTUAL,
    CycleRecord,
    EventRecord,
    Outcome,
    Recorder,
    RunEnd,
    StepRecord,
)
from hil_bridge.record.analysis.steps import failed_criteria, step_outcomes
from hil_bridge.record.ending import Check
from hil_bridge.record.recorder import map_buffers
from hil_bridge.runs.checks import check
from hil_bridge.runs.closing import ended_after, ended_before
from hil_bridge.runs.cycle import Run, RunResult
from hil_bridge.runs.outputs import Outputs, record_path, settled, write_outputs
from hil_bridge.runs.run_log import RunLog, metadata_of
from hil_bridge.runs.setup import Setup
from hil_bridge.runs.shown import Relay, Views, fed
from hil_bridge.runs.signals import Signals, signal_name, unless_hung_up
from hil_bridge.settings.configuration import Config
from hil_bridge.show.terminal import REFRESH_SECONDS, Health, Scene
from protocol.faults import FaultStage

if TYPE_CHECKING:
    from hil_bridge.show.terminal.live import LiveView
    from hil_bridge.show.web.feed import Feed

SIGNALS_TOLD = 16
"""Signals that the record names. Chosen: a flood of them must not fill it."""
TELL_SECONDS = 5.0
"""Longest wait for a blocked output when a signal that comes from no keyboard ended the run. Chosen."""
_DRAWING_S = 0.015
"""Time to draw the view: 8 ms as a rule, 12 ms at most in a run of 20 s. Chosen."""
_UNDER_WAY_S = 0.005
"""Chosen: after the end of a cycle; a status order takes ten times as long on a 9600-baud line."""

_ENDING_KEYS, _HOLD_KEY, _MARK_KEY = "rq", "p", "m"

_COLLECT_EVERY = 64
"""Cycles between two collections. Chosen: only what is still in use costs one time, and that is as much however
rarely it comes.
"""


def execute(
    config: Config, virtual: bool, outputs: Outputs, view: bool | Views, config_file: Path | None = None
) -> int:
    """Run once, leave the outputs, print the figures; the exit code. `config_file` is never written over. `view` says
    where the run is shown; True is the terminal alone.

    Raises BridgeError when a device fails before the movement has begun, or a file cannot be written.
    """
    setup = Setup(config)
    cell = check(
        setup, virtual, VIRTUAL_EPOCH if virtual else time.monotonic()
    )  # before an earlier recording is replaced
    signals = Signals()
    views = view if isinstance(view, Views) else Views(view)
    with signals.heard(), fed(views, virtual) as feed:
        outputs = settled(outputs, config_file)
        with record_path(outputs) as path, Terminal() as terminal:
            if outputs.own_folder and not virtual:
                terminal.out.say(f"recording into {path.parent}")
            kept = replace(outputs, record=path, temporary=outputs.record is None)
            session = _Session(setup, kept, views.terminal, terminal, signals)
            session.feed, session.cell = feed, cell
            awake_s = setup.config.realtime.busy_poll_ms * 1e-3
            try:
                main, stray = session.main, session.take_stray
                result = run_virtual_on(main, stray) if virtual else run_real_on(main, awake_s, stray)
            except BridgeError:
                raise
            except Exception as error:
                if outputs.record is not None:
                    error.add_note(f"record: {outputs.record}")
                raise
            return _end(session, result, outputs, path)


def _end(session: "_Session", result: RunResult, outputs: Outputs, path: Path) -> int:
    """Write the wanted outputs from the record at `path`, then print how the run ended; returns the exit code.

    All files are written before the first line is printed, since the reader of the output may have gone. A signal
    keeps the run from its report. A second one keeps it from waiting for a terminal that takes no more.
    """
    signals, terminal = session.signals, session.terminal
    code = result.exit_code
    ended = f": {result.text}" if result.text and result.outcome is not Outcome.STOPPED else ""
    lines = [f"{result.outcome}{ended}", *(f"then: {text}" for text in result.followed)]
    errors = [f"stopped: {result.text}"] if result.outcome is Outcome.STOPPED else []
    if result.outcome is Outcome.COMPLETED and (unmet := failed_criteria(step_outcomes(session.steps))):
        errors.append(unmet)
        code = CRITERION
    if session.record_error is not None:
        errors.append(str(session.record_error))
        code = code or session.record_error.exit_code
    by_hand = signals.first in (None, signal.SIGINT, signal.SIGTSTP)
    patience = None if by_hand else TELL_SECONDS
    record = [] if outputs.record is None else [f"record: {outputs.record}"]
    if session.hurried:
        lines += record
        patience = LEAVE_SECONDS
    elif session.cycles:
        try:
            with signals.leading_to(unless_hung_up):
                more, troubles = write_outputs(outputs, path, session.end)
            lines += more or record
            errors += map(str, troubles)
            code = code or max((trouble.exit_code for trouble in troubles), default=0)
        except KeyboardInterrupt:
            lines += [*record, "interrupted before all that was wanted had been written"]
            code, patience = INTERRUPTED, LEAVE_SECONDS
    else:
        lines += record
    lines += [f"fault: {text}" for text in session.faults]
    if result.left:
        lines.append(f"left: {result.left}")
    if result.outcome is Outcome.STOPPED and session.traces:
        errors[0] += "" if debug_wanted() else "; --debug shows the traceback"
        errors = [*(text.rstrip() for text in session.traces if debug_wanted()), *errors]
    bugs = [told_bug("; ".join([text.strip().rpartition("\n")[2], *record]), text) for text in session.bugs]
    terminal.say_last([*bugs, *(f"hil-bridge: {text}" for text in errors)], lines, patience)
    return code


class _Session:
    """Everything around one `Run`, inside its event loop. It watches the log of the run."""

    def __init__(
        self, setup: Setup, outputs: Outputs, view: bool, terminal: Terminal, signals: Signals
    ) -> None:
        """`outputs` names a record, kept or temporary."""
        assert outputs.record is not None
        self._kept = not outputs.temporary
        self._setup, self._config = setup, setup.config
        self._record_path = outputs.record
        self._overwrite = outputs.overwrite
        self._view_wanted = view
        self.terminal = terminal
        self.signals = signals
        self._clock: Clock
        self._recorder: Recorder
        self._log: RunLog
        self.faults: list[str] = []
        """Outcome of each injected fault, in words."""
        self._view: LiveView | None = None
        self.feed: Feed | None = None
        """Feeds the page in the browser."""
        self.cell: Cell[Any, Any] | None = None
        """The emulated cell, as the check has powered it up."""
        self._warning, self._checked = "", ""
        """The page's words on trouble, and on the sensor."""
        self._result: RunResult | None = None
        self._moved = False
        """The movement has begun, and may have ended."""
        self._cancelled: Cause | None = None
        """Who or what ended the run before it moved."""
        self._asked: Cause | None = None
        """By which way a person has asked for the end, other than a signal."""
        self._task: asyncio.Task[Any] | None = None
        """The task of the run, once the record can be written."""
        self._stray: BaseException | None = None
        """Exception that left a callback of the loop, the first one."""
        self._trouble_told = False
        self._marks = 0
        self._may_draw = asyncio.Event()
        """Set when a pause of the loop is long enough for it."""
        self.cycles = 0
        """Cycles so far; a record without any has no figures."""
        self.end = RunEnd(Outcome.STOPPED)
        """Metadata of the end for the record."""
        self.record_error: BridgeError | None = None
        """Why the record is incomplete."""
        self.bugs: list[str] = []
        """Tracebacks that the run told."""
        self.traces: list[str] = []
        """Tracebacks of failures of other packages' code."""
        self.hurried = False
        """A further signal came when the movement had ended already: the process shall end at once."""

    # --- told after the record

    def cycle(self, record: CycleRecord) -> None:
        """A cycle has ended."""
        self.cycles += 1
        if self._recorder.trouble and not self._trouble_told:
            self._tell_trouble(self._recorder.trouble)
        if self._view is not None:
            self._view.update(record)
        if self.feed is not None:
            self.feed.cycle(record)
        if self.cycles % _COLLECT_EVERY:
            return
        if self._clock.is_virtual:
            collect_generation_1()
        else:
            # By then the next order is on the line, and the run only waits for its answer.
            self._clock.call_at(self._clock.now() + _UNDER_WAY_S, collect_generation_1)

    def event(self, record: EventRecord) -> None:
        """Something happened beside the cycles."""
        self._moved = self._moved or self._moving
        if record.kind == BUG_EVENT:
            self.bugs.append(record.text)
        if record.kind == TRACEBACK_EVENT:
            self.traces.append(record.text)
        if self._view is not None:
            self._view.event(record)
        if record.kind == CHECK_EVENT and not self._clock.is_virtual:
            self._tell_check(record)
        if record.fault is not None and record.fault.stage in (FaultStage.STRUCK, FaultStage.NEVER):
            self.faults.append(record.text)

    def pause(self, seconds: float) -> None:
        """A block is on the robot's line."""
        if seconds >= _DRAWING_S:
            self._may_draw.set()

    def _tell_check(self, record: EventRecord) -> None:
        """Findings about the sensor, while a person can still intervene."""
        text = self._checked = record.text
        if self._view is None:
            self.terminal.out.say(f"sensor: {text}")
        elif record.check is Check.UNCHECKED:
            self._view.warn(text)
        else:
            self._view.check(text)

    def _tell_trouble(self, text: str) -> None:
        """Tell trouble of the recorder at once. The run goes on, since nothing in it depends on its record."""
        self._trouble_told = True
        self._warning = text
        self._log.notice("recorder", text)
        self.terminal.err.say(f"hil-bridge: {text}; the run goes on")
        if self._view is not None:  # where a line is short
            self._view.warn(text.replace(f" {self._record_path}", ""))

    # --- the run

    async def main(self) -> RunResult:
        """Open everything, run, close everything; the record is whole whatever happened."""
        clock = self._clock = Clock.running()
        config = self._config
        map_buffers()
        self._recorder = Recorder(
            self._record_path,
            clock.wall_ns,
            metadata_of(config, clock.is_virtual),
            VIRTUAL if clock.is_virtual else REAL_TIME,
            self._overwrite,
        )
        keeper = self._recorder if self.feed is None else Relay(self._recorder, self.feed)
        self._log = RunLog(self._setup, clock, keeper, self)
        try:
            if self._recorder.error is not None:
                raise self._recorder.error
            with self._interruptible(), real_time_loop(config.realtime, clock.is_virtual):
                try:
                    async with self._page():
                        result = await self._with_devices()
                except (asyncio.CancelledError, Exception) as error:  # all has been closed on the way here
                    result = self._ended_by(error)
                self.end = self._log.end(result)
                self._close_record()
            return result
        except BridgeError as error:
            self.end = self._log.end(RunResult(Outcome.STOPPED, error.reason(Cause.ROBOT_NOT_READY)))
            raise
        finally:
            self._close_record()
            if self.feed is not None:
                self.feed.end(self.end)
                self.feed.close()
            clock.close()

    def _ended_by(self, error: BaseException) -> RunResult:
        """Result of a run that this exception ended, or that it came after. Raises the exception else."""
        result = self._result or (self._run.result if self._run is not None else None)
        if result is None:
            return ended_before(error, self._cancelled, self._stray)
        if not isinstance(error, (BridgeError, asyncio.CancelledError)):
            self.bugs.append(traceback_of(error))
        return ended_after(result, error)

    def take_stray(self, error: BaseException) -> bool:
        """An exception has left a callback of the loop, which asyncio does not take: the run retracts and ends.

        False where nothing is there that could end in order.
        """
        if is_asked(error) or self._task is None:
            return False
        if self._stray is None:
            self._stray = error
            self._log.notice(*failure_event(error))
        if self._run is not None and self._moving:
            self._run.fail(unexpected(error))
        elif not self._moved:
            self._task.cancel()
        return True

    def _close_record(self) -> None:
        """Finish the record. Harmless when called again."""
        try:
            self._log.close(self.end)
        except BridgeError as error:
            self.record_error = error

    async def _with_devices(self) -> RunResult:
        async with self._log.opened(self.cell) as devices:
            if devices.served is not None and devices.served.panel is not None:
                self.terminal.out.say(f"panel: {devices.served.panel}")
            assert self._run is not None
            if self.feed is not None:
                self.feed.begin(self._scene(self._run.step_labels), self._clock.wall_ns(0.0))
            async with self._live_view(self._run.step_labels):
                self._result = await self._run()
            return self._result

    @asynccontextmanager
    async def _page(self) -> AsyncIterator[None]:
        """The page in the browser. It learns what the records do not tell now and then; nothing waits for it."""
        feed = self.feed
        if feed is None:
            yield
            return
        feed.listen(self._asked_by_page, lambda text: self._log.notice("web", f"{text}; the run goes on"))
        feed.begin(self._scene(()), self._clock.wall_ns(0.0))
        self.terminal.out.say(f"page: {feed.url}")

        async def pulses() -> None:
            while True:
                feed.pulse(self._clock.now(), self._health(), self._checked, self._warning)
                await asyncio.sleep(REFRESH_SECONDS)

        task = asyncio.create_task(pulses(), name="page")
        try:
            yield
        finally:
            task.cancel()
            with suppress(asyncio.CancelledError):
                await task

    def _asked_by_page(self) -> None:
        self._end_by_hand(Cause.PAGE, "asked for the end on the page in the browser")

    def _end_by_hand(self, cause: Cause, text: str, key: str = "") -> None:
        """End in the same way as by Ctrl-C."""
        self._asked = self._asked or cause
        os.kill(os.getpid(), signal.SIGINT)
        # behind the notice of the signal, which a small view would else show in its place
        tell = partial(self._log.tell, "operator", text, cause=cause, by=key)
        asyncio.get_running_loop().call_soon(tell)

    @property
    def _run(self) -> Run | None:
        return self._log.run

    @property
    def steps(self) -> list[StepRecord]:
        """Steps of a program that have ended."""
        return self._log.steps

    @contextmanager
    def _interruptible(self) -> Iterator[None]:
        """A signal retracts while the robot moves, and ends at once before that. When the movement has ended, it waits
        until the tool has come to rest and the record is whole.
        """
        loop, task = asyncio.get_running_loop(), asyncio.current_task()
        assert task is not None
        self._task = task

        def ended() -> None:
            if self._moving and self._run is not None:  # the movement has begun since
                self._run.interrupt(self._asked or Cause.SIGNAL)
            elif not (self._moved or self._moving or self._cancelled):
                self._cancelled = self._asked or Cause.SIGNAL  # once: what is being closed is closed in order
                task.cancel()

        def interrupted(number: int) -> None:
            if self._moved and not self._moving:
                # a shell that closes sends SIGHUP a second time
                self.hurried |= self.signals.count > 1 and number != signal.SIGHUP
                return
            if self._run is not None and self._moving:
                self._moved = True
                self._run.interrupt(self._asked or Cause.SIGNAL)
            if self.signals.count <= SIGNALS_TOLD:
                name = signal_name(number)
                tell = partial(self._log.tell, "signal", name, cause=Cause.SIGNAL, by=name)
                loop.call_soon_threadsafe(tell)
            loop.call_soon_threadsafe(ended)

        with self.signals.leading_to(interrupted):
            yield

    @property
    def _moving(self) -> bool:
        return self._run is not None and self._run.moving

    @asynccontextmanager
    async def _live_view(self, steps: tuple[str, ...]) -> AsyncIterator[None]:
        """The live view, drawn by the screen's thread; in virtual time there is no person to watch.

        No part of it waits for the terminal: the loop goes on when that is paused or gone.
        """
        screen = self.terminal.out
        if not self._view_wanted or self._clock.is_virtual or screen.stream is None:
            yield
            return
        from hil_bridge.show.terminal.live import LiveView

        view = self._view = LiveView(self._scene(steps), screen.stream)
        task = asyncio.create_task(self._refresh(view), name="view")
        loop = asyncio.get_running_loop()
        try:
            with keys.heard(lambda key: loop.call_soon_threadsafe(self._key, key)):
                yield
        finally:
            task.cancel()
            with suppress(asyncio.CancelledError):
                await task
            screen.do(view.close)

    def _scene(self, steps: tuple[str, ...]) -> Scene:
        config = self._config
        real, cell = self._setup.in_words
        return Scene(
            reference_n=config.task.force_n,
            robot=self._log.facts,
            total_s=None if steps else config.run.duration_s,
            steps=steps,
            cell=cell,
            real=real,
            limits=config.limits,
            approach=config.frame.approach,
            record=format_path(self._record_path) if self._kept else "",
            keys=keys.can_be_heard(),
        )

    def _key(self, key: str) -> None:
        """A key of the terminal: the end in the same way as by Ctrl-C, a hold, or a mark in the record."""
        if key in _ENDING_KEYS:
            self._end_by_hand(Cause.KEY, f"asked for the end with the key {key}", key)
        elif key == _HOLD_KEY and self._run is not None:
            told = "holds the tool in its place" if self._run.hold() else "does not hold the tool"
            self._log.notice("operator", told)
        elif key == _MARK_KEY:
            self._marks += 1
            self._log.notice("mark", f"mark {self._marks}")

    async def _refresh(self, view: "LiveView") -> None:
        """Draw now and then, in a pause of the loop where one comes: a thread that draws holds it up."""
        while True:
            if not self.terminal.out.busy:
                self.terminal.out.do(partial(view.refresh, self._clock.now(), self._health()))
            await asyncio.sleep(REFRESH_SECONDS)
            self._may_draw.clear()
            # not wait_for, which swallows a cancellation that comes together with the event before Python 3.12
            with suppress(TimeoutError):
                async with asyncio.timeout(REFRESH_SECONDS):
                    await self._may_draw.wait()

    def _health(self) -> Health:
        robot, sensor = self._log.robot, self._log.sensor
        if robot is None or sensor is None:  # not open yet
            return Health()
        counters, newest = robot.counters, sensor.newest
        return Health(
            link_errors=sum(counters.get(name, 0) for name in self._log.facts.errors),
            frames_lost=sensor.lost,
            sensor_at=None if newest is None else newest.at,
            link=dict(counters),
        )
