"""The complete loop in virtual time, with access to the cell and the wires while it runs."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, TypeAlias

from hil_bridge.clock import Clock, run_virtual
from hil_bridge.devices.robots.seam import RobotLink
from hil_bridge.record import CycleRecord, EventRecord
from hil_bridge.runs.compose import make_cell
from hil_bridge.runs.cycle import Run
from hil_bridge.runs.result import RunResult
from hil_bridge.runs.run_log import RunLog
from hil_bridge.runs.running import running
from hil_bridge.runs.setup import Setup
from hil_bridge.runs.watchers import Listener
from hil_bridge.settings.configuration import Config, read_config
from hil_bridge.testing.wires import Faults, Faulty
from hil_bridge.transports import Frames, Transport
from tests.near_surface import NEAR_START, merged
from tests.paper_cell import PaperCell


class CutCan:
    """CAN wire on which nothing arrives any more once it is cut."""

    def __init__(self, inner: Transport[Frames]) -> None:
        self._inner = inner
        self.cut = False
        self.name = inner.name
        self.aclose = inner.aclose
        self.send = inner.send

    def start(self, on_data: Callable[[Frames], None], on_end: Callable[..., None]) -> None:
        self.inject = on_data
        self._inner.start(lambda frames: None if self.cut else on_data(frames), on_end)


SOON_OVER: dict[str, Any] = {"run": {"duration_s": 5.0}, "limits": {"retract_patience_s": 0.5}}
"""Settings of a run of at most five seconds, which waits half a second for a robot that cannot retract."""


@dataclass
class Bench:
    """One run and its results."""

    config: Config
    cycles: list[CycleRecord] = field(default_factory=list)
    events: list[EventRecord] = field(default_factory=list)
    result: RunResult = field(init=False)
    ended_at: float = 0.0
    meddle: Callable[["Bench", CycleRecord], object] = lambda bench, record: None
    prepare: Callable[["Bench"], object] = lambda bench: None
    """Called when the cell exists, before the first telegram to it."""
    cell: PaperCell = field(init=False)
    clock: Clock = field(init=False)
    line: Faulty = field(init=False)
    can: CutCan = field(init=False)
    robot: RobotLink = field(init=False)
    run: Run = field(init=False)

    def cycle(self, record: CycleRecord) -> None:
        self.cycles.append(record)
        self.meddle(self, record)

    def texts(self, kind: str) -> list[str]:
        return [event.text for event in self.events if event.kind == kind]

    def tracked(self) -> list[CycleRecord]:
        return [record for record in self.cycles if record.phase == "track"]

    @property
    def true_force(self) -> float:
        """Force at the end, N; 0 once the tool has been retracted."""
        return self.cell.true_state(self.ended_at).contact_force[2]

    async def main(self) -> None:
        self.clock = clock = Clock.running()
        setup = Setup(self.config)
        self.cell = make_cell(setup, clock.now())
        self.prepare(self)
        log = RunLog(clock, [Listener({CycleRecord: self.cycle, EventRecord: self.events.append})])
        async with running(setup, log, self.cell, self.wrapped) as run:
            self.robot, self.run = run.robot, run.run
            try:
                self.result = await run()
            finally:
                self.ended_at = clock.now()

    def wrapped(self, device: str, wire: Transport[Any]) -> Transport[Any]:
        """Return the wires, wrapped for access by the test."""
        if device == "robot":
            self.line = Faulty(wire, Faults(), seed=self.config.run.seed)
            return self.line
        self.can = CutCan(wire)
        return self.can


RunBench: TypeAlias = Callable[..., Bench]


def run_bench(
    meddle: Callable[[Bench, CycleRecord], object] | None = None,
    prepare: Callable[[Bench], object] | None = None,
    **sections: Any,
) -> Bench:
    """Run the loop from just above the surface, with further settings as nested dictionaries.

    `meddle` is called after every cycle.
    """
    bench = Bench(read_config(merged({**NEAR_START, **SOON_OVER}, sections)))
    if meddle is not None:
        bench.meddle = meddle
    if prepare is not None:
        bench.prepare = prepare
    run_virtual(bench.main)
    return bench
