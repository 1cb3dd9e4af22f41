"""Live view of a run on the terminal, its keys, and the lines for the operator during the run."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from functools import partial
from typing import TYPE_CHECKING

from hil_bridge.console import keys
from hil_bridge.console.screen import Terminal
from hil_bridge.errors.causes import Cause
from hil_bridge.record import CycleRecord, EventKind, EventRecord
from hil_bridge.record.ending import Check
from hil_bridge.record.next_commands import RunPlaces
from hil_bridge.runs.background_tasks import background_task
from hil_bridge.runs.running import Running
from hil_bridge.runs.stopping import Stopping
from hil_bridge.runs.views import health_of, scene_of
from hil_bridge.runs.watchers import Listener
from hil_bridge.show.terminal import REFRESH_SECONDS

if TYPE_CHECKING:
    from hil_bridge.show.terminal.live import LiveView

_DRAWING_S = 0.015
"""Time to draw the view, s. Chosen: drawing usually takes 8 ms, and at most 12 ms in a run of 20 s."""
_ENDING_KEYS, _HOLD_KEY, _MARK_KEY = "rq", "p", "m"


class TerminalView(Listener):
    """Watcher that shows a run to an operator at the terminal. It shows nothing in virtual time."""

    def __init__(self, terminal: Terminal, is_enabled: bool, virtual: bool) -> None:
        super().__init__({CycleRecord: self._cycle, EventRecord: self._event})
        self._terminal = terminal
        self._is_enabled = is_enabled and not virtual
        self._virtual = virtual
        self._view: LiveView | None = None
        self._may_draw = asyncio.Event()
        """Event that is set when a pause of the loop is long enough for drawing."""

    def _cycle(self, record: CycleRecord) -> None:
        if self._view is not None:
            self._view.update(record)

    def _event(self, record: EventRecord) -> None:
        if self._view is not None:
            self._view.event(record)
        if record.kind == EventKind.CHECK and not self._virtual:
            self._report_check(record)

    def pause(self, seconds: float) -> None:
        """Draw while a block is being transmitted on the robot's line."""
        if seconds >= _DRAWING_S:
            self._may_draw.set()

    def _report_check(self, record: EventRecord) -> None:
        """Report findings about the sensor while an operator can still intervene."""
        text = record.text
        if self._view is None:
            self._terminal.out.say(f"sensor: {text}")
        elif record.check is Check.UNCHECKED:
            self._view.warn(text)
        else:
            self._view.check(text)

    def warn(self, text: str) -> None:
        """Show a problem as a short line."""
        if self._view is not None:
            self._view.warn(text)

    @asynccontextmanager
    async def showing(self, run: Running, stopping: Stopping, places: RunPlaces) -> AsyncIterator[None]:
        """Show the live view of a run, drawn by the screen's thread.

        Nothing waits for the terminal: the loop continues if the terminal is paused or closed.
        """
        screen = self._terminal.out
        if not self._is_enabled or screen.stream is None:
            yield
            return
        from hil_bridge.show.terminal.live import LiveView

        scene = scene_of(run.setup, run.facts, run.run.legs, places)
        view = self._view = LiveView(scene, screen.stream)
        loop, board = asyncio.get_running_loop(), Keys(run, stopping)
        try:
            async with background_task(self._refresh(view, run), "view"):
                with keys.listen_for_keys(lambda key: loop.call_soon_threadsafe(board.press, key)):
                    yield
        finally:
            screen.do(view.close)

    async def _refresh(self, view: "LiveView", run: Running) -> None:
        """Draw periodically, preferably during a pause of the loop, because a drawing thread delays the loop."""
        while True:
            if not self._terminal.out.busy:
                self._terminal.out.do(partial(view.refresh, run.clock.now(), health_of(run)))
            await asyncio.sleep(REFRESH_SECONDS)
            self._may_draw.clear()
            # not wait_for, which swallows a cancellation that comes together with the event before Python 3.12
            with suppress(TimeoutError):
                async with asyncio.timeout(REFRESH_SECONDS):
                    await self._may_draw.wait()


class Keys:
    """Keys of the terminal, which end the run like Ctrl-C, hold the tool, or add a mark to the recording."""

    def __init__(self, run: Running, stopping: Stopping) -> None:
        self._run, self._stopping = run, stopping
        self._marks = 0

    def press(self, key: str) -> None:
        """Handle a pressed key. Unknown keys are ignored."""
        if key in _ENDING_KEYS:
            self._stopping.end_by_hand(Cause.KEY, f"requested the end with the key {key}", key)
        elif key == _HOLD_KEY:
            text = "holds the tool at its position" if self._run.run.hold() else "releases the tool"
            self._run.log.notice(EventKind.OPERATOR, text)
        elif key == _MARK_KEY:
            self._marks += 1
            self._run.log.notice(EventKind.MARK, f"number {self._marks}")
