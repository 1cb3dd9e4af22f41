"""The page of a run in the browser: every record goes to its feed, and now and then what no record tells."""

import asyncio
from collections.abc import AsyncIterator, Collection, Mapping
from contextlib import asynccontextmanager

from hil_bridge.console.screen import Terminal
from hil_bridge.errors.causes import Cause
from hil_bridge.record import CycleRecord, EventKind, RunEnd
from hil_bridge.record.topics import RECORDS, Record
from hil_bridge.runs.background_tasks import background_task
from hil_bridge.runs.notes import Notes
from hil_bridge.runs.run_log import RunLog
from hil_bridge.runs.running import Running
from hil_bridge.runs.setup import Setup
from hil_bridge.runs.stopping import Stopping
from hil_bridge.runs.views import health_of, scene_of
from hil_bridge.show.terminal import REFRESH_SECONDS
from hil_bridge.show.web.feed import Feed


class Page:
    """A watcher that feeds the page. Nothing of the run waits for it."""

    takes: Collection[type] = RECORDS

    def __init__(self, feed: Feed, notes: Notes, record: str) -> None:
        """`record` names the recording that is kept; empty for none."""
        self._feed, self._notes, self._record = feed, notes, record
        self._run: Running | None = None

    def put(self, record: Record) -> None:
        """Take a record."""
        self._feed.put(record)
        if type(record) is CycleRecord:
            self._feed.cycle(record)

    def devices(self, facts: Mapping[str, str]) -> None:
        """Note that the devices are ready."""
        self._feed.devices(facts)

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """Ignore an attachment: a page shows none."""

    def pause(self, seconds: float) -> None:
        """Do nothing in a pause: a thread of its own sends the page."""

    def close(self, end: Mapping[str, str]) -> None:
        """Leave the end to the session, which may know another than the record's."""

    def begin(self, run: Running) -> None:
        """Note that the devices of the run are open."""
        self._run = run
        scene = scene_of(run.setup, run.facts, run.run.legs, self._record)
        self._feed.begin(scene, run.clock.wall_ns(0.0))
        served = run.devices.served
        if served is not None and served.operated is not None:
            self._feed.offer(served.operated)

    @asynccontextmanager
    async def serving(
        self, setup: Setup, log: RunLog, stopping: Stopping, terminal: Terminal
    ) -> AsyncIterator[None]:
        """Serve the page while the run continues."""
        feed, clock = self._feed, log.clock
        feed.listen(
            lambda: stopping.end_by_hand(Cause.PAGE, "asked for the end on the page in the browser"),
            lambda text: log.notice(EventKind.WEB, f"{text}; the run continues"),
        )
        feed.begin(scene_of(setup, setup.facts, (), self._record), clock.wall_ns(0.0))
        terminal.out.say(f"page: {feed.url}")

        async def pulses() -> None:
            while True:
                feed.pulse(clock.now(), health_of(self._run), self._notes.checked, self._notes.warning)
                feed.show_panel()
                await asyncio.sleep(REFRESH_SECONDS)

        async with background_task(pulses(), "page"):
            yield

    def end(self, end: RunEnd) -> None:
        """Note that the run is over."""
        self._feed.end(end)
        self._feed.close()
