"""Watchers of a run, which receive the records of the run and its devices in order and have no influence on the run."""

from collections.abc import Callable, Mapping
from typing import Any, Protocol

from hil_bridge.record import CycleRecord, EventRecord, StepRecord


class Log(Protocol):
    """Recipient of a run's records. It must not block."""

    def cycle(self, record: CycleRecord) -> None:
        """Accept the record of a completed cycle."""

    def event(self, record: EventRecord) -> None:
        """Accept an event outside the cycles."""

    def step(self, record: StepRecord) -> None:
        """Accept the record of a completed step of a program."""


class Watcher(Protocol):
    """Recipient of a run's records. It must not block the run. `record.Recorder` is a watcher."""

    @property
    def takes(self) -> Mapping[type, Callable[[Any], object]]:
        """Functions that accept records, by the type of the record. A record that no watcher accepts is not created."""

    def devices(self, facts: Mapping[str, str]) -> None:
        """Accept the facts of the devices, as JSON by name, once the devices are ready."""

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """Accept an attachment of the recording."""

    def pause(self, seconds: float) -> None:
        """Use a pause of the given time, s, in which a block is transmitted on the robot's line and no answer can
        come before its last character. It is called only if any watcher accepts the traffic.
        """

    def close(self, end: Mapping[str, str]) -> None:
        """Accept the end of the run. Idempotent. Raises BridgeError for records that could not be stored."""


class Listener:
    """Watcher that passes each record of some types to a function."""

    def __init__(self, functions: Mapping[type, Callable[[Any], object]]) -> None:
        self.takes = dict(functions)

    def devices(self, facts: Mapping[str, str]) -> None:
        """Ignore the facts of the devices."""

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """Ignore the attachment."""

    def pause(self, seconds: float) -> None:
        """Do nothing."""

    def close(self, end: Mapping[str, str]) -> None:
        """Do nothing."""
