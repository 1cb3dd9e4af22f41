"""Log of all reports from a run and its devices to the watchers: cycles, events, frames, link traffic and ground
truth.
"""

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
"""Key in the metadata of a recording for the package that provided the controller, with its version."""
STEP_PACKAGES = "step_packages"
"""Key in the metadata of a recording for the packages that provided steps, with their versions, by the steps'
words, in JSON.
"""


def metadata_of(config: Config, virtual: bool) -> dict[str, str]:
    """Return the facts that are known before the run, for its recording. For a run in virtual time they are the
    same on every host, so that its recording is the same as well.
    """
    where = (
        {"time": "virtual"}
        if virtual
        else {"time": "real", "host": gethostname(), "platform": f"Python {python_version()}, {platform()}"}
    )
    package = controller_package(config.controller.name)
    kinds = {step.do for _, step, _ in unroll(config.task.step)}
    steps = {word: owner for word in kinds if (owner := step_package(word))}
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
    """Log of one run and its devices, for any number of watchers. It does not depend on the run or the devices.

    An exception of a watcher is raised after all watchers have received the record.
    """

    def __init__(self, clock: Clock, watchers: Sequence[Watcher]) -> None:
        self.clock = clock
        self._watchers: list[Watcher] = []
        self._takers: dict[type, list[Callable[[Any], object]]] = {}
        """Functions that accept a record, by the type of the record."""
        for watcher in watchers:
            self.join(watcher)
        self._wires: dict[str, LinkLog] = {}
        """Traffic of the devices' wires, by device, as far as any watcher accepts it."""
        if self.wants(LinkRecord):
            self._wires["robot"] = LinkLog(lambda at, pieces: self.put(at, LinkRecord(at, pieces)))
        if self.wants(WireRecord):
            self._wires["sensor"] = LinkLog(lambda at, pieces: self.put(at, WireRecord(at, "sensor", pieces)))
        self.verbose = bool(self._wires)
        """Setting of a `DeviceLog`: whether any watcher accepts traffic."""
        self.with_true_states = True
        """Whether the ground truth contains the states of the emulated cell; False for a run of which only the
        figures are needed, which use its times alone.
        """
        self.byte_time_s = 0.0
        """Transmission time of one byte on the robot's line, s; 0 if negligible."""

    def join(self, watcher: Watcher) -> None:
        """Add a watcher, after the existing ones."""
        self._watchers.append(watcher)
        for kind, take in watcher.takes.items():
            self._takers.setdefault(kind, []).append(take)

    def wants(self, kind: type) -> bool:
        """Return whether any watcher accepts records of this type."""
        return kind in self._takers

    def put(self, at: float, record: Record) -> None:
        """Pass on a record, preceded by the link data that is due up to its time."""
        for wire in self._wires.values():
            wire.age(at)
        self.hand_over(record)

    def hand_over(self, record: Record) -> None:
        """Pass on a record at once."""
        failure: Exception | None = None
        for take in self._takers.get(type(record), ()):
            try:
                take(record)
            except Exception as error:
                failure = failure or error
        if failure is not None:
            raise failure

    def devices(self, facts: Mapping[str, str]) -> None:
        """Log that the devices are ready, with their known facts."""
        for watcher in self._watchers:
            watcher.devices(facts)

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """Log an attachment, which belongs to the entire recording."""
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
        if (wire := self._wires.get("robot")) is not None:
            wire.age(frame.at)  # while the robot is silent, only frames arrive
        if SensorRecord in self._takers:
            self.hand_over(SensorRecord(frame.at, frame.sequence, frame.values))

    def notice(self, kind: str, text: str) -> None:
        """Log a notice from a device, or from the environment of the run."""
        self.tell(kind, text)

    def tell(self, kind: str, text: str, **values: Any) -> None:
        """Log an event outside the cycles now. `values` holds additional fields of its record."""
        self.event(EventRecord(self.clock.now(), kind, text, **values))

    def traffic(self, device: str, direction: Direction, data: Any) -> None:
        """Log data that has just been transferred on a device's link."""
        if (wire := self._wires.get(device)) is not None:
            wire.take(self.clock.now(), direction, data)
        if device == "robot" and direction is Direction.SENT and len(data) > 1:
            for watcher in self._watchers:
                watcher.pause(len(data) * self.byte_time_s)

    def link_event(self, device: str, text: str) -> None:
        """Log an event on a device's link."""
        if (wire := self._wires.get(device)) is not None:
            wire.note(self.clock.now(), text)

    def close(self, end: RunEnd) -> None:
        """Pass on pending records, and then the end. Idempotent. Raises the first error of a watcher."""
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
