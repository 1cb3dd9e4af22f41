"""Reading a record back. Nothing in a file is trusted: it may be cut off, garbled, a bomb or something else."""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from mcap.records import Attachment, Channel, Header, Message, Metadata

from hil_bridge.errors import ConfigError
from hil_bridge.errors.text_files import refuse_known_file
from hil_bridge.record import records
from hil_bridge.record.foreign import Foreign
from hil_bridge.record.mcap_file import (
    MAGIC,
    ROS_PROFILE,
    Damage,
    TooMuch,
    check_size,
    mcap_records,
    read_mcap,
    refusal,
)
from hil_bridge.record.recorder import DEVICES_NAME, END_NAME, METADATA_NAME
from hil_bridge.record.removed_map import REMOVED_NAME, RemovedMap, from_json
from hil_bridge.record.topics import CYCLE, EVENT, LINK, SENSOR, STEP, TRUTH, WIRE, Record, Topic

FIRST_OF_FORM = (0, 7)
"""The version since which recordings have this form."""
LAST_READER = "0.6"
"""The last version that reads recordings of the form before this one."""
CLOCK_LIMIT_S = 1e10
"""A time of a run's clock lies below this. Chosen: three centuries."""

_BAG_READERS = "`hil-bridge report`, `view`, `compare` and `identify fidelity` read a bag"
_VERSION = re.compile(r"(\d{1,4})\.(\d{1,4})(?:\.|$)")


@dataclass(frozen=True, slots=True)
class Recording:
    """Records of a run."""

    cycles: tuple[records.CycleRecord, ...]
    sensors: tuple[records.SensorRecord, ...] = ()
    events: tuple[records.EventRecord, ...] = ()
    metadata: Mapping[str, str] = field(default_factory=dict)
    """Metadata from before the run: configuration, versions, seed."""
    end: Mapping[str, str] = field(default_factory=dict)
    """Metadata from after an orderly end; empty when the run was cut off."""
    truncated: bool = False
    """The file ends early or is damaged; what came before the damage is here."""
    truths: tuple[records.TruthRecord, ...] = ()
    """Ground truth from the emulated cell; empty for a real one."""
    devices: Mapping[str, str] = field(default_factory=dict)
    """Facts of the devices once they were ready, see `device_facts`; empty before that."""
    unix_zero_ns: int = 0
    """UNIX time at which the run's clock was 0, ns."""
    steps: tuple[records.StepRecord, ...] = ()
    """Steps of a program that have ended."""
    removed: RemovedMap | None = None
    """Depths that the tool removed from an emulated surface; None where it removed nothing."""
    foreign: Foreign | None = None
    """Its origin where another program has made it; None for the recording of a run."""
    written_at: float | None = field(default=None, compare=False)
    """UNIX time at which its file was written, s; None for one that is in no file."""


NO_CYCLE = "the run ended before its first control cycle; `hil-bridge why` tells the cause"
"""The answer of a command that needs cycles, to a recording without any."""


@dataclass(frozen=True, slots=True)
class RawTraffic:
    """Data that went over the wires of a run."""

    robot: tuple[records.LinkRecord, ...]
    sensor: tuple[records.WireRecord, ...]


def read(path: Path) -> Recording:
    """Read the record in a file, as far as possible. A run that ended before its first cycle has events, and no cycle.

    Raises ConfigError when there is no such file, when it is no record of a run, or damaged before anything happened.
    """
    found = _contents(path, (CYCLE, SENSOR, TRUTH, EVENT, STEP))
    if not found.finished and not found.records[CYCLE.name] and not found.records[EVENT.name]:
        raise ConfigError(f"{path} ends or is damaged before the first event: record the run again")
    return dated(_recording(found), path)


def dated(recording: Recording, path: Path) -> Recording:
    """Return the recording with the time at which its file was written, if there is such a file."""
    try:
        return replace(recording, written_at=path.stat().st_mtime)
    except OSError:
        return recording


def read_with_traffic(path: Path) -> tuple[Recording, RawTraffic]:
    """Read the record with the raw traffic of the wires. Raises the errors of `read`."""
    found = _contents(path, (CYCLE, SENSOR, TRUTH, EVENT, STEP, LINK, WIRE))
    return _recording(found), RawTraffic(tuple(found.records[LINK.name]), tuple(found.records[WIRE.name]))


def _recording(found: "_Contents") -> Recording:
    records, metadata = found.records, found.metadata
    return Recording(
        tuple(records[CYCLE.name]),
        tuple(records[SENSOR.name]),
        tuple(records[EVENT.name]),
        metadata[METADATA_NAME],
        metadata[END_NAME],
        truncated=not found.finished,
        truths=tuple(records[TRUTH.name]),
        devices=metadata[DEVICES_NAME],
        unix_zero_ns=found.unix_zero_ns,
        steps=tuple(records[STEP.name]),
        removed=found.removed,
    )


def read_link(path: Path) -> tuple[tuple[records.LinkRecord, ...], Mapping[str, str]]:
    """Read the raw traffic of the robot's link in a recording as far as possible, and what was known before the
    run. A run that never came to a cycle has it too.

    Raises ConfigError when there is no such file or it is no record of a run.
    """
    found = _contents(path, (LINK,))
    return tuple(found.records[LINK.name]), found.metadata[METADATA_NAME]


@dataclass(slots=True)
class _Contents:
    """The wanted part of a file."""

    records: dict[str, list[Any]]
    """By topic."""
    metadata: dict[str, dict[str, str]]
    """By name."""
    finished: bool = False
    """The file is whole."""
    unix_zero_ns: int = 0
    removed: RemovedMap | None = None


def _contents(path: Path, topics: Sequence[Topic]) -> _Contents:
    """Return records of topics, and all metadata. Raises ConfigError."""
    if path.is_dir():
        raise ConfigError(f"{path} is a folder, and no recording of a run; {_BAG_READERS}")
    data = read_mcap(path, "the recording")
    if not data:
        raise ConfigError(f"{path} is empty: the run was ended before anything was recorded; record it again")
    if not data.startswith(MAGIC):
        refuse_known_file(path)
        raise ConfigError(f"{path} is not an MCAP file: name the recording that a run has written")
    found = _Contents(
        records={topic.name: [] for topic in topics},
        metadata={METADATA_NAME: {}, DEVICES_NAME: {}, END_NAME: {}},
    )
    try:
        check_size(data)
        for item in _items(data, topics):
            match item:
                case Header(profile=profile) if profile == ROS_PROFILE:
                    raise ConfigError(f"{path} is a bag of ROS 2 and no recording of a run; {_BAG_READERS}")
                case Metadata() if item.name in found.metadata:
                    found.metadata[item.name] = item.metadata
                    _refuse_older(path, found.metadata[METADATA_NAME].get("version", ""))
                case Attachment() if item.name == REMOVED_NAME:
                    found.removed = _read_removed(item)
                case int():
                    found.unix_zero_ns = item
                case (str(topic), record):
                    found.records[topic].append(record)
        found.finished = True
    except _ForeignMessage as error:
        raise ConfigError(
            f"{path} is not a recording of this version: {error}; record the run again"
        ) from error
    except TooMuch as error:
        raise refusal(path, error, "is it damaged, or no recording of a run?") from error
    except Damage:
        pass  # what came before is there
    return found


def _refuse_older(path: Path, version: str) -> None:
    """Raise ConfigError for a version of this program that made recordings of the form before this one."""
    number = _VERSION.match(version)
    if number is not None and (int(number[1]), int(number[2])) < FIRST_OF_FORM:
        raise ConfigError(
            f"{path} was recorded by version {version}; {LAST_READER} is the last version that reads it"
        )


def _read_removed(item: Attachment) -> RemovedMap:
    try:
        return from_json(item.data)
    except ValueError as error:
        raise _ForeignMessage(f"the attachment {item.name}: {error}") from error


class _ForeignMessage(Exception):
    """A whole message that is not what its topic says."""


def _items(
    data: bytes, wanted: Sequence[Topic]
) -> Iterator[Header | Metadata | Attachment | int | tuple[str, Record]]:
    """Header, metadata, attachments and records of a file in order, and once the UNIX time at which the run's clock
    was 0, ns. Raises Damage where the file ends or is garbled, TooMuch.
    """
    topics = {topic.name: topic for topic in wanted}
    channels: dict[int, str] = {}
    dated = False
    for item in mcap_records(data):
        match item:
            case Channel():
                channels[item.id] = item.topic
            case Message() if channels.get(item.channel_id) in topics:
                name = channels[item.channel_id]
                topic = topics[name]
                try:
                    record = topic.decode(item.data)
                except (ValueError, RecursionError) as error:
                    raise _ForeignMessage(f"a message of {name}: {error}") from error
                if not dated and abs(at := topic.time_of(record)) < CLOCK_LIMIT_S:
                    dated = True
                    yield item.publish_time - round(at * 1e9)
                yield name, record
            case Metadata() | Attachment() | Header():
                yield item
