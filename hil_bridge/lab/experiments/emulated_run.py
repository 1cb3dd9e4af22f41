"""One run through the whole chain in virtual time, kept in memory.

Paced wires, the emulated cell, and the bridge's own devices and run, joined by the composition root.
"""

from dataclasses import dataclass, field
from typing import NamedTuple

from hil_bridge.clock import Clock, run_virtual
from hil_bridge.devices.device_log import LogTo
from hil_bridge.errors import ConfigError
from hil_bridge.record import CycleRecord, EventRecord, StepRecord
from hil_bridge.runs.compose import open_devices
from hil_bridge.runs.cycle import Run, RunResult
from hil_bridge.runs.faults.schedule import FaultSchedule
from hil_bridge.runs.setup import Setup
from hil_bridge.settings.configuration import Config


class EmulatedRun(NamedTuple):
    """Records and result of a run."""

    cycles: tuple[CycleRecord, ...]
    events: tuple[EventRecord, ...]
    result: RunResult


def run_emulated(config: Config) -> EmulatedRun:
    """Run a configuration against the emulated cell in virtual time, without files.

    The same configuration gives the same records. Raises ConfigError for a configuration with URLs,
    BridgeError when a device fails before the movement has begun.
    """
    if config.robot.url or config.sensor.url:
        raise ConfigError("experiments run against the emulated cell alone: leave the URLs empty")
    return run_virtual(_Bench(Setup(config)).main)


@dataclass
class _Bench:
    """The cell, the wires and the run on one virtual loop. Also the run's log."""

    setup: Setup
    cycles: list[CycleRecord] = field(default_factory=list)
    events: list[EventRecord] = field(default_factory=list)
    faults: FaultSchedule | None = None

    def cycle(self, record: CycleRecord) -> None:
        """A cycle has ended."""
        self.cycles.append(record)
        if self.faults is not None:
            self.faults.cycle(record)

    def event(self, record: EventRecord) -> None:
        """Something happened beside the cycles."""
        self.events.append(record)
        if self.faults is not None:
            self.faults.event(record)

    def step(self, record: StepRecord) -> None:
        """A step of a program has ended."""

    async def main(self) -> EmulatedRun:
        clock, setup = Clock.running(), self.setup

        def notice(kind: str, text: str) -> None:
            self.event(EventRecord(clock.now(), kind, text))

        try:
            async with open_devices(setup, clock, LogTo(notice=notice)) as devices:
                assert devices.cell is not None
                self.faults = FaultSchedule(setup.config.faults, devices.cell, clock, self.event)
                result = await Run(setup, clock, devices.robot, devices.sensor, self)()
        finally:
            if self.faults is not None:
                self.faults.close()
            clock.close()
        return EmulatedRun(tuple(self.cycles), tuple(self.events), result)
