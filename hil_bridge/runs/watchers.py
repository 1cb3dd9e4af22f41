"""Watchers of a run: they hear what it and its devices tell, in order, and ask nothing of it."""

from collections.abc import Callable, Collection, Mapping
from typing import Any, Protocol

from hil_bridge.record import CycleRecord, EventRecord, StepRecord
from hil_bridge.record.topics import Record


class Log(Protocol):
    """Log of a run for its records; must not block."""

    def cycle(self, record: CycleRecord) -> None:
        """Note that a cycle has ended."""

    def event(self, record: EventRecord) -> None:
        """Something happened beside the cycles."""

    def step(self, record: StepRecord) -> None:
        """Note that a step of a program has ended."""


class Watcher(Protocol):
    """Told of a run; must not block, and must not hold the run. `record.Recorder` is one."""

    @property
    def takes(self) -> Collection[type]:
        """Types of the records that it is told; what no watcher takes is not made."""

    def put(self, record: Record) -> None:
        """Take a record of these types."""

    def devices(self, facts: Mapping[str, str]) -> None:
        """Take the facts of the devices, JSON by name, once they are ready."""

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """Take an attachment."""

    def pause(self, seconds: float) -> None:
        """Note that a block is on the robot's line, and nothing can answer it before its last character, s."""

    def close(self, end: Mapping[str, str]) -> None:
        """Take the end. Harmless when called again. Raises BridgeError for records that could not be kept."""


class Listener:
    """A watcher that gives each record of some types to a function."""

    def __init__(self, functions: Mapping[type, Callable[[Any], object]]) -> None:
        self._functions = dict(functions)
        self.takes: Collection[type] = frozenset(functions)

    def put(self, record: Record) -> None:
        """Hand it on."""
        self._functions[type(record)](record)

    def devices(self, facts: Mapping[str, str]) -> None:
        """Forget them."""

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """Forget it."""

    def pause(self, seconds: float) -> None:
        """Do nothing."""

    def close(self, end: Mapping[str, str]) -> None:
        """Do nothing."""
