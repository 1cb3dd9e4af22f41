"""Page of a run in the browser. Its feed receives every record, and periodically the state that no record contains."""

import asyncio
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager
from typing import Any

from hil_bridge.console.screen import Terminal
from hil_bridge.errors.causes import Cause
from hil_bridge.record import CycleRecord, EventKind, RunEnd
from hil_bridge.record.next_commands import RunPlaces
from hil_bridge.record.topics import RECORDS
from hil_bridge.runs.background_tasks import background_task
from hil_bridge.runs.notes import Notes
from hil_bridge.runs.run_log import RunLog
from hil_bridge.runs.running import Running
from hil_bridge.runs.setup import Setup
from hil_bridge.runs.stopping import Stopping
from hil_bridge.runs.views import health_of, planned_places, scene_of
from hil_bridge.show.charts.cell import model_of
from hil_bridge.show.terminal import REFRESH_SECONDS
from hil_bridge.show.web.feed import Feed


class Page:
    """Watcher that sends data to the page. The run never waits for it."""

    def __init__(self, feed: Feed, notes: Notes, places: RunPlaces) -> None:
        self._feed, self._notes, self._places = feed, notes, places
        self._run: Running | None = None

    @property
    def takes(self) -> Mapping[type, Callable[[Any], object]]:
        """Functions that accept records, for all types of records."""
        return {**dict.fromkeys(RECORDS, self._feed.put), CycleRecord: self._cycle}

    def _cycle(self, record: CycleRecord) -> None:
        self._feed.put(record)
        self._feed.cycle(record)

    def devices(self, facts: Mapping[str, str]) -> None:
        """Mark the devices as ready."""
        self._feed.devices(facts)

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """Ignore an attachment, because a page does not show it."""

    def pause(self, seconds: float) -> None:
        """Do nothing, because a separate thread sends the page."""

    def close(self, end: Mapping[str, str]) -> None:
        """Do nothing, because the session reports the end and may know more than the log."""

    def begin(self, run: Running) -> None:
        """Mark the devices of the run as open."""
        self._run = run
        scene = scene_of(run.setup, run.facts, run.run.legs, self._places)
        config = run.setup.config
        model = model_of(config, planned_places(config, run.run.legs))
        self._feed.begin(scene, run.clock.wall_ns(0.0), model)
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
            lambda: stopping.end_by_hand(Cause.PAGE, "requested the end on the page in the browser"),
            lambda text: log.notice(EventKind.WEB, f"{text}; the run continues"),
        )
        feed.begin(scene_of(setup, setup.facts, (), self._places), clock.wall_ns(0.0))
        terminal.out.say(f"page: {feed.url}")

        async def pulses() -> None:
            while True:
                feed.pulse(clock.now(), health_of(self._run), self._notes.checked, self._notes.warning)
                feed.show_panel()
                await asyncio.sleep(REFRESH_SECONDS)

        async with background_task(pulses(), "page"):
            yield

    def end(self, end: RunEnd) -> None:
        """Mark the run as over."""
        self._feed.end(end)
        self._feed.close()
