"""One run through the whole chain in virtual time, kept in memory.

Paced wires, the emulated cell, and the bridge's own devices and run, joined by the composition root.
"""

from typing import NamedTuple

from hil_bridge.clock import Clock, run_virtual
from hil_bridge.errors import ConfigError
from hil_bridge.record import CycleRecord, EventRecord
from hil_bridge.runs.result import RunResult
from hil_bridge.runs.run_log import RunLog
from hil_bridge.runs.running import running
from hil_bridge.runs.setup import Setup
from hil_bridge.runs.watching import Listener
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
    return run_virtual(lambda: _run(Setup(config)))


async def _run(setup: Setup) -> EmulatedRun:
    """The cell, the wires and the run on one virtual loop."""
    clock = Clock.running()
    cycles, events = list[CycleRecord](), list[EventRecord]()
    log = RunLog(clock, [Listener({CycleRecord: cycles.append, EventRecord: events.append})])
    try:
        async with running(setup, log) as run:
            result = await run()
    finally:
        clock.close()
    return EmulatedRun(tuple(cycles), tuple(events), result)
