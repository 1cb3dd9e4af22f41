"""Everything that a run and its devices tell, on its way to the watchers: cycles, events, frames, wires, the truth."""

import json
from collections.abc import Callable, Mapping, Sequence
from importlib.metadata import version
from platform import platform, python_version
from socket import gethostname
from typing import Any

from hil_bridge.clock import Clock
from hil_bridge.control.controllers import controller_package
from hil_bridge.control.steps.kinds import step_package
from hil_bridge.control.steps.repeat import unroll
from hil_bridge.errors import BridgeError
from hil_bridge.record import (
    CycleRecord,
    EventRecord,
    LinkLog,
    LinkRecord,
    RunEnd,
    SensorRecord,
    StepRecord,
    WireRecord,
)
from hil_bridge.record.topics import Record
from hil_bridge.runs.watchers import Watcher
from hil_bridge.settings.configuration import Config, dump
from hil_bridge.transports import Direction
from protocol.wrench import WrenchFrame

PACKAGE_NAME = "controller_package"
"""In the metadata of a recording: the package that offered the controller, with its version."""
STEP_PACKAGES = "step_packages"
"""In the metadata of a recording: packages that offered steps, with their versions, by the steps' words, in JSON."""


def metadata_of(config: Config, virtual: bool) -> dict[str, str]:
    """Facts that are known before the run, for its record. Of a run in virtual time they are the same on every host,
    so that its recording is.
    """
    where = (
        {"time": "virtual"}
        if virtual
        else {"time": "real", "host": gethostname(), "platform": f"Python {python_version()}, {platform()}"}
    )
    package = controller_package(config.controller.name)
    words = {step.do for _, step, _ in unroll(config.task.step)}
    steps = {word: owner for word in words if (owner := step_package(word))}
    return (
        where
        | ({PACKAGE_NAME: package} if package else {})
        | ({STEP_PACKAGES: json.dumps(steps, sort_keys=True)} if steps else {})
        | {
            "config": dump(config),
            "controller": config.controller.name,
            "seed": str(config.run.seed),
            "version": version("hil-bridge"),
        }
    )


class RunLog:
    """The log of one run and of its devices, for any number of watchers. It knows neither the run nor the devices.

    An exception of a watcher is raised once all of them have been told.
    """

    def __init__(self, clock: Clock, watchers: Sequence[Watcher]) -> None:
        self.clock = clock
        self._watchers: list[Watcher] = []
        self._takers: dict[type, list[Callable[[Any], object]]] = {}
        """Functions by the type of record that they take."""
        for watcher in watchers:
            self.join(watcher)
        self.verbose = self.wants(LinkRecord)
        """Setting of a `DeviceLog`: a record of the link holds its every event."""
        self._wires = {
            "robot": LinkLog(lambda at, pieces: self.put(at, LinkRecord(at, pieces))),
            "sensor": LinkLog(lambda at, pieces: self.put(at, WireRecord(at, "sensor", pieces))),
        }
        self._taken = {"robot": self.wants(LinkRecord), "sensor": self.wants(WireRecord)}
        """Whether any watcher takes the traffic of a device's wire."""
        self.byte_time_s = 0.0
        """Time of a byte on the robot's line; 0 where it is too short to matter."""

    def join(self, watcher: Watcher) -> None:
        """Tell this watcher too, after those that are there."""
        self._watchers.append(watcher)
        for kind in watcher.takes:
            self._takers.setdefault(kind, []).append(watcher.put)

    def wants(self, kind: type) -> bool:
        """Whether any watcher takes records of this type."""
        return kind in self._takers

    def put(self, at: float, record: Record) -> None:
        """Tell of something of this time, and before it what the wires hold for too long by then."""
        for wire in self._wires.values():
            wire.age(at)
        self.hand_over(record)

    def hand_over(self, record: Record) -> None:
        """Tell of something now."""
        failure: Exception | None = None
        for take in self._takers.get(type(record), ()):
            try:
                take(record)
            except Exception as error:
                failure = failure or error
        if failure is not None:
            raise failure

    def devices(self, facts: Mapping[str, str]) -> None:
        """Log that the devices are ready, and what is known of them."""
        for watcher in self._watchers:
            watcher.devices(facts)

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """Something that belongs to the record as a whole."""
        for watcher in self._watchers:
            watcher.attach(name, media_type, data)

    # --- of the run

    def cycle(self, record: CycleRecord) -> None:
        """Log the end of a cycle."""
        self.put(record.answered_at, record)

    def event(self, record: EventRecord) -> None:
        """Log an event outside the cycles."""
        self.put(record.at, record)

    def step(self, record: StepRecord) -> None:
        """Log the end of a step of a program."""
        self.put(record.at, record)

    # --- of the devices

    def frame(self, frame: WrenchFrame) -> None:
        """Log a complete frame of the sensor."""
        self._wires["robot"].age(frame.at)  # while the robot is silent, frames alone come
        if SensorRecord in self._takers:
            self.hand_over(SensorRecord(frame.at, frame.sequence, frame.values))

    def notice(self, kind: str, text: str) -> None:
        """Log a notice of a device, or of the run's environment."""
        self.tell(kind, text)

    def tell(self, kind: str, text: str, **values: Any) -> None:
        """Something beside the cycles happens now; `values` are further fields of its record."""
        self.event(EventRecord(self.clock.now(), kind, text, **values))

    def traffic(self, device: str, direction: Direction, data: Any) -> None:
        """Log data that have just gone over a device's wire."""
        if self._taken[device]:
            self._wires[device].take(self.clock.now(), direction, data)
        if device == "robot" and direction is Direction.SENT and len(data) > 1:
            for watcher in self._watchers:
                watcher.pause(len(data) * self.byte_time_s)

    def link_event(self, device: str, text: str) -> None:
        """Something happened on a device's link."""
        if self._taken[device]:
            self._wires[device].note(self.clock.now(), text)

    def close(self, end: RunEnd) -> None:
        """Hand over what waits, then the end. Harmless when called again. Raises the first error of a watcher."""
        for wire in self._wires.values():
            wire.flush()
        failure: BridgeError | None = None
        for watcher in self._watchers:
            try:
                watcher.close(end.as_metadata())
            except BridgeError as error:
                failure = failure or error
        if failure is not None:
            raise failure
