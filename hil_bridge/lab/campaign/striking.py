"""What a run really struck: the rows of the table of causes, and the injected faults that had an effect."""

from collections import Counter
from collections.abc import Iterable, Iterator
from typing import Protocol

from hil_bridge.devices.kinds import ROBOTS, SENSORS
from hil_bridge.errors import Cause
from hil_bridge.record import Recording
from hil_bridge.record.ending import followed_of, reason_of
from hil_bridge.settings.configuration import Config

CELL = "every cell"
"""Stands for the faults that no device has: of surface, obstacle, bus, computer and controller."""


class Struck(Protocol):
    """An injected fault, as the ledger of a cell has it."""

    @property
    def target(self) -> str:
        """Part of the cell."""

    @property
    def fault(self) -> str:
        """Its name."""

    @property
    def struck(self) -> int:
        """Number of its effects."""


def fault_key(device: str, on: str, fault: str) -> str:
    """Name of a fault of a device."""
    return f"{device}: {on}: {fault}"


def owner_of(config: Config, on: str, fault: str) -> str:
    """Name of the device of a run that has a fault; CELL where none has."""
    for kinds, name in ((ROBOTS, config.robot.emulated), (SENSORS, config.sensor.emulated)):
        emulation = kinds.kind(name).emulation
        if emulation is not None and fault in emulation.faults.get(on, {}):
            return name
    return CELL


def struck_faults(config: Config, faults: Iterable[Struck]) -> dict[str, int]:
    """Number of effects of each fault that had one, by device, target and fault."""
    counts: Counter[str] = Counter()
    for one in faults:
        if one.struck:
            counts[fault_key(owner_of(config, one.target, one.fault), one.target, one.fault)] += one.struck
    return dict(counts)


def causes_of(recording: Recording) -> Iterator[Cause]:
    """Causes of a run, more than once where they came so: its stop, what followed, what was asked for, its end."""
    told = (
        *(event.cause for event in recording.events),
        *(cycle.asked.cause for cycle in recording.cycles if cycle.asked),
    )
    yield from (cause for cause in told if cause is not None)
    reason = reason_of(recording.end)
    yield from (each.cause for each in (*([] if reason is None else [reason]), *followed_of(recording.end)))


def struck_causes(recording: Recording) -> dict[str, int]:
    """Number of times that each cause is told in a run. Causes that hold an order back are recorded in words alone."""
    return {str(cause): count for cause, count in Counter(causes_of(recording)).items()}
