"""Watchers of a run: they receive the records of the run and its devices, in order, and request nothing."""

from collections.abc import Callable, Collection, Mapping
from typing import Any, Protocol

from hil_bridge.record import CycleRecord, EventRecord, StepRecord
from hil_bridge.record.topics import Record


class Log(Protocol):
    """Log of a run for its records; must not block."""

    def cycle(self, record: CycleRecord) -> None:
        """Note that a cycle has ended."""

    def event(self, record: EventRecord) -> None:
        """Note an event outside the cycles."""

    def step(self, record: StepRecord) -> None:
        """Note that a step of a program has ended."""


class Watcher(Protocol):
    """Receiver of a run's records; must not block the run. `record.Recorder` is one."""

    @property
    def takes(self) -> Collection[type]:
        """Types of the records that it accepts; a record that no watcher accepts is not made."""

    def put(self, record: Record) -> None:
        """Accept a record of these types."""

    def devices(self, facts: Mapping[str, str]) -> None:
        """Accept the facts of the devices, JSON by name, once they are ready."""

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """Accept an attachment."""

    def pause(self, seconds: float) -> None:
        """Note that a block is on the robot's line, and nothing can answer it before its last character, s."""

    def close(self, end: Mapping[str, str]) -> None:
        """Accept the end of the run. Idempotent. Raises BridgeError for records that could not be kept."""


class Listener:
    """A watcher that passes each record of some types to a function."""

    def __init__(self, functions: Mapping[type, Callable[[Any], object]]) -> None:
        self._functions = dict(functions)
        self.takes: Collection[type] = frozenset(functions)

    def put(self, record: Record) -> None:
        """Pass the record on."""
        self._functions[type(record)](record)

    def devices(self, facts: Mapping[str, str]) -> None:
        """Ignore them."""

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """Ignore it."""

    def pause(self, seconds: float) -> None:
        """Do nothing."""

    def close(self, end: Mapping[str, str]) -> None:
        """Do nothing."""
