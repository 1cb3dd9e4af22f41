"""Causes reported in a run, and the injected faults that took effect."""

from collections import Counter
from collections.abc import Iterable, Iterator
from typing import Protocol

from hil_bridge.devices.kinds import ROBOTS, SENSORS
from hil_bridge.errors import Cause
from hil_bridge.record import Recording
from hil_bridge.record.ending import followed_of, reason_of
from hil_bridge.settings.configuration import Config

CELL = "every cell"
"""Owner of the faults that belong to no device: faults of surface, obstacle, bus, computer and controller."""


class InjectedFault(Protocol):
    """Injected fault in the ledger of a cell."""

    @property
    def target(self) -> str:
        """Part of the cell that the fault affects."""

    @property
    def fault(self) -> str:
        """Name of the fault."""

    @property
    def struck(self) -> int:
        """Number of times that the fault took effect."""


def fault_key(device: str, on: str, fault: str) -> str:
    """Return the key of a device's fault."""
    return f"{device}: {on}: {fault}"


def owner_of(config: Config, on: str, fault: str) -> str:
    """Return the name of the device that has a fault; CELL if no device has it."""
    for kinds, name in ((ROBOTS, config.robot.emulated), (SENSORS, config.sensor.emulated)):
        emulation = kinds.kind(name).emulation
        if emulation is not None and fault in emulation.faults.get(on, {}):
            return name
    return CELL


def struck_faults(config: Config, faults: Iterable[InjectedFault]) -> dict[str, int]:
    """Count how often each fault took effect, by device, target and fault. Faults without effect are left out."""
    counts: Counter[str] = Counter()
    for one in faults:
        if one.struck:
            counts[fault_key(owner_of(config, one.target, one.fault), one.target, one.fault)] += one.struck
    return dict(counts)


def causes_of(recording: Recording) -> Iterator[Cause]:
    """Yield the causes reported in a run, with repetitions: causes of events, of requested stops, of the end, and
    of what followed the end.
    """
    reported = (
        *(event.cause for event in recording.events),
        *(cycle.asked.cause for cycle in recording.cycles if cycle.asked),
    )
    yield from (cause for cause in reported if cause is not None)
    reason = reason_of(recording.end)
    yield from (each.cause for each in (*([] if reason is None else [reason]), *followed_of(recording.end)))


def struck_causes(recording: Recording) -> dict[str, int]:
    """Count how often each cause is reported in a run. Causes that limit an order are recorded as text only, and
    not counted.
    """
    return {str(cause): count for cause, count in Counter(causes_of(recording)).items()}
