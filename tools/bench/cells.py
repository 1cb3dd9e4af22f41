"""Whole cells in virtual time with their bridges, any number of them in one loop."""

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, field

from hil_bridge.clock import Clock, run_virtual
from hil_bridge.devices.device_log import LogTo
from hil_bridge.devices.wiring import Wiring
from hil_bridge.record import CycleRecord, EventRecord, Outcome
from hil_bridge.runs.compose import Ports, cell_ports, connect_robot, connect_sensor, emulated_cell
from hil_bridge.runs.cycle import Run
from hil_bridge.runs.setup import Setup
from hil_bridge.settings.configuration import Config
from protocol.wrench import WrenchFrame

CAN, BOARD = "jr3+can+memory:sensor", "jr3-board+memory:sensor"
"""URLs at which a cell's sensor listens: behind its CAN gateway, or on a receiver board behind its registers."""
USUAL = ""
"""Robot and sensor listen at the usual URLs of their kinds: for one cell in a loop."""


class RunFailed(Exception):
    """A run that was to be measured did not come to its end."""


@dataclass
class CellRun:
    """One cell, its bridge, and what they told. Also the run's log."""

    config: Config
    number: int = 0
    sensor: str = CAN
    on_cycle: Callable[[CycleRecord], object] = lambda record: None
    on_event: Callable[[EventRecord], object] = lambda record: None
    on_frame: Callable[[WrenchFrame], object] = lambda frame: None
    cycles: int = 0
    frames: int = 0
    simulated: float = 0.0
    """Time from power-up to the end, s of virtual time."""
    faults: list[str] = field(default_factory=list)

    def cycle(self, record: CycleRecord) -> None:
        """A cycle has ended."""
        self.cycles += 1
        self.on_cycle(record)

    def event(self, record: EventRecord) -> None:
        """Something happened beside the cycles."""
        self.on_event(record)

    def _frame(self, frame: WrenchFrame) -> None:
        self.frames += 1
        self.on_frame(frame)

    async def main(self) -> None:
        """Run to the end. Raises RunFailed when it is stopped before."""
        clock = Clock.running()
        began = clock.now()
        if self.sensor == USUAL:
            ports = cell_ports(self.config, virtual=True)
        else:
            ports = Ports(f"s3+memory:robot{self.number}", f"{self.sensor}{self.number}")

        def notice(kind: str, text: str) -> None:
            self.event(EventRecord(clock.now(), kind, text))

        seeded = self.config.run.model_copy(update={"seed": self.config.run.seed + self.number})
        config = self.config.model_copy(update={"run": seeded})
        log = LogTo(self._frame, notice)
        async with emulated_cell(
            Setup(config), clock, ports, lambda cause: self.faults.append(repr(cause))
        ) as at:
            robot = await connect_robot(config, at.robot or "", Wiring("robot", clock, log))
            sensor = await connect_sensor(config, at.sensor or "", Wiring("sensor", clock, log))
            robot.start()
            sensor.start()
            try:
                result = await Run(Setup(config), clock, robot, sensor, self)()
            finally:
                await sensor.aclose()
                await robot.aclose()
        if self.faults or result.outcome is not Outcome.COMPLETED:
            raise RunFailed(", ".join((result.text, *self.faults)))
        self.simulated = clock.now() - began


def run_together(runs: list[CellRun]) -> None:
    """Run them all in one virtual loop. Raises what the first of them raises, in a group."""

    async def main() -> None:
        async with asyncio.TaskGroup() as group:
            for run in runs:
                group.create_task(run.main())

    run_virtual(main)
