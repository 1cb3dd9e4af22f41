"""Complete runs against a faulty emulated cell, in virtual time, with the ground truth sampled independently."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import pytest

from hil_bridge.clock import Clock, Timer, run_virtual
from hil_bridge.devices.robots.s3.link import S3Link
from hil_bridge.errors import BridgeError, TransportClosed
from hil_bridge.record import CycleRecord, EventRecord, Outcome
from hil_bridge.runs.cycle import Run
from hil_bridge.runs.result import RunResult
from hil_bridge.runs.run_log import RunLog
from hil_bridge.runs.running import running
from hil_bridge.runs.setup import Setup
from hil_bridge.runs.watchers import Listener
from hil_bridge.settings.configuration import Config
from tests.near_surface import awake_config, merged
from tests.paper_cell import PaperCell

WATCH_S = 0.01
"""Interval between samples of the ground truth, s."""


class Killed(BaseException):
    """Simulated end of the process: no further orders."""


@dataclass
class Guarded:
    """One run, and the ground truth meanwhile."""

    config: Config
    meddle: Callable[["Guarded", CycleRecord], None] = lambda run, record: None
    cycles: list[CycleRecord] = field(default_factory=list)
    events: list[EventRecord] = field(default_factory=list)
    truths: list[tuple[float, float]] = field(default_factory=list)
    """Time, s, and length of the true contact force, N."""
    result: RunResult = field(default_factory=lambda: RunResult(Outcome.STOPPED))
    error: BridgeError | None = None
    """Condition that refused the run before it moved."""
    clock: Clock = field(init=False)
    cell: PaperCell = field(init=False)
    run: Run = field(init=False)

    @property
    def largest(self) -> float:
        """The largest true contact force, N."""
        return max(force for _, force in self.truths)

    @property
    def last(self) -> float:
        """The true contact force at the end, N."""
        return self.truths[-1][1]

    @property
    def cause(self) -> str:
        """Cause of a run that was refused or stopped."""
        return str(self.error) if self.error is not None else self.result.text

    def texts(self, kind: str) -> list[str]:
        return [event.text for event in self.events if event.kind == kind]

    def cycle(self, record: CycleRecord) -> None:
        self.cycles.append(record)
        self.meddle(self, record)

    def event(self, record: EventRecord) -> None:
        self.events.append(record)

    def kill(self) -> None:
        """End the process in the middle of the run."""

        async def dead(*_: object, **__: object) -> None:
            raise TransportClosed("the process was killed")

        link = self.run._robot
        assert isinstance(link, S3Link)
        link.exchange = dead  # type: ignore[assignment,method-assign]
        raise Killed

    async def main(self, cell: PaperCell | None = None) -> "Guarded":
        """Run in this cell, or in a new one."""
        self.clock = clock = Clock.running()
        timers: list[Timer] = []

        def watch() -> None:
            now = clock.now()
            self.truths.append((now, math.hypot(*self.cell.true_state(now).contact_force)))
            timers[:] = [clock.call_at(now + WATCH_S, watch)]

        log = RunLog(
            clock, [Listener({CycleRecord: self.cycle, EventRecord: lambda record: self.event(record)})]
        )
        try:
            async with running(Setup(self.config), log, cell) as run:
                assert run.cell is not None
                self.cell, self.run = run.cell, run.run
                watch()
                try:
                    self.result = await run()
                except Killed:
                    pass
                finally:
                    watch()
                    timers[0].cancel()
        except BridgeError as error:
            self.error = error
        return self


Meddle = Callable[[Guarded, CycleRecord], None]


@pytest.fixture
def configured() -> Callable[..., Config]:
    """A run of three seconds of tracking on a surface of this stiffness, N/m, with more settings laid over it."""

    def make(stiffness: float, *more: dict[str, Any]) -> Config:
        values: dict[str, Any] = {
            "run": {"duration_s": 3.0},
            "cell": {"surface": {"stiffness_n_m": stiffness}},
        }
        for settings in more:
            values = merged(values, settings)
        return awake_config(values)

    return make


@pytest.fixture
def guarded() -> Callable[..., Guarded]:
    """Run a configuration once."""

    def run(
        config: Config, meddle: Meddle | None = None, prepare: Callable[[Guarded], object] = lambda run: None
    ) -> Guarded:
        guarded = Guarded(config, meddle) if meddle else Guarded(config)
        prepare(guarded)
        return run_virtual(guarded.main)

    return run


@pytest.fixture
def in_one_cell() -> Callable[..., list[Guarded]]:
    """Run configurations one after the other in the same cell."""

    def run(configs: Sequence[Config], meddle: Meddle) -> list[Guarded]:
        async def main() -> list[Guarded]:
            done: list[Guarded] = []
            for config in configs:
                done.append(await Guarded(config, meddle).main(done[0].cell if done else None))
            return done

        return run_virtual(main)

    return run
