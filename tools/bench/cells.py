"""Complete cells in virtual time with their bridges. One loop can run any number of them."""

import asyncio
from collections.abc import Callable
from dataclasses import dataclass

from hil_bridge.clock import Clock, run_virtual
from hil_bridge.record import CycleRecord, EventRecord, Outcome, SensorRecord
from hil_bridge.runs.run_log import RunLog
from hil_bridge.runs.running import running
from hil_bridge.runs.setup import Listen, Setup
from hil_bridge.runs.watchers import Listener
from hil_bridge.settings.configuration import Config

CAN, BOARD = "jr3+can+memory:sensor", "jr3-board+memory:sensor"
"""URLs at which a cell's sensor listens: behind its CAN gateway, and on a receiver board."""
USUAL = ""
"""Options of a robot and a sensor at the default URLs of their kinds, for one cell per loop."""


class RunFailed(Exception):
    """Failure of a measured run to complete."""


@dataclass
class CellRun:
    """Run of a cell and its bridge, with the results."""

    config: Config
    number: int = 0
    sensor: str = CAN
    on_cycle: Callable[[CycleRecord], object] = lambda record: None
    on_event: Callable[[EventRecord], object] = lambda record: None
    on_frame: Callable[[SensorRecord], object] = lambda frame: None
    cycles: int = 0
    frames: int = 0
    simulated: float = 0.0
    """Virtual time from power-up to the end, s."""

    def _cycle(self, record: CycleRecord) -> None:
        self.cycles += 1
        self.on_cycle(record)

    def _frame(self, frame: SensorRecord) -> None:
        self.frames += 1
        self.on_frame(frame)

    async def main(self) -> None:
        """Run until the end. Raises RunFailed if the run stops early."""
        clock = Clock.running()
        began = clock.now()
        listen = None
        if self.sensor != USUAL:
            listen = Listen(f"s3+memory:robot{self.number}", f"{self.sensor}{self.number}")
        seeded = self.config.run.model_copy(update={"seed": self.config.run.seed + self.number})
        setup = Setup(self.config.model_copy(update={"run": seeded}), listen)
        listener = Listener({CycleRecord: self._cycle, EventRecord: self.on_event, SensorRecord: self._frame})
        async with running(setup, RunLog(clock, [listener])) as run:
            result = await run()
        if result.outcome is not Outcome.COMPLETED:
            raise RunFailed(result.text)
        self.simulated = clock.now() - began


def run_together(runs: list[CellRun]) -> None:
    """Run all cells in one virtual loop. Raises the first error in an exception group."""

    async def main() -> None:
        async with asyncio.TaskGroup() as group:
            for run in runs:
                group.create_task(run.main())

    run_virtual(main)
