"""Reader of recordings.

No content of a file is trusted: the file may be cut off, damaged, a decompression bomb or unrelated.
"""

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
    LimitExceeded,
    check_size,
    mcap_records,
    read_mcap,
    refusal,
)
from hil_bridge.record.recorder import DEVICES_NAME, END_NAME, METADATA_NAME
from hil_bridge.record.removed_map import REMOVED_NAME, RemovedMap, from_json
from hil_bridge.record.topics import CYCLE, EVENT, LINK, SENSOR, STEP, TRUTH, WIRE, Record, Topic

FIRST_OF_FORM = (0, 7)
"""First version that writes recordings in the current form."""
LAST_READER = "0.6"
"""Last version that can read the previous form."""
CLOCK_LIMIT_S = 1e10
"""Upper bound of a time on a run's clock, s. Chosen: three centuries."""

_BAG_READERS = "`hil-bridge report`, `view`, `compare` and `identify fidelity` read a bag"
_VERSION = re.compile(r"(\d{1,4})\.(\d{1,4})(?:\.|$)")


@dataclass(frozen=True, slots=True)
class Recording:
    """Records and metadata of a run."""

    cycles: tuple[records.CycleRecord, ...]
    sensors: tuple[records.SensorRecord, ...] = ()
    events: tuple[records.EventRecord, ...] = ()
    metadata: Mapping[str, str] = field(default_factory=dict)
    """Metadata written before the run: configuration, versions, seed."""
    end: Mapping[str, str] = field(default_factory=dict)
    """Metadata written at an orderly end; empty if the run was cut off."""
    truncated: bool = False
    """Whether the file ends early or is damaged; the records before the damage are included."""
    truths: tuple[records.TruthRecord, ...] = ()
    """Ground truth of the emulated cell; empty for a real cell."""
    devices: Mapping[str, str] = field(default_factory=dict)
    """Facts of the devices, which exist once the devices were ready; see `device_facts`."""
    unix_zero_ns: int = 0
    """UNIX time at which the run's clock was 0, ns."""
    steps: tuple[records.StepRecord, ...] = ()
    """Completed steps of a program."""
    removed: RemovedMap | None = None
    """Depths of the material that the tool removed from an emulated surface; None if it removed no material."""
    foreign: Foreign | None = None
    """Origin of a recording made by another program; None for the recording of a run."""
    written_at: float | None = field(default=None, compare=False)
    """UNIX time at which the file was written, s; None without a file."""
    file: str = field(default="", compare=False)
    """Name of the file; empty without a file."""


NO_CYCLE = "the run ended before its first control cycle; `hil-bridge why` explains the cause"
"""Error message of a command that needs cycles if the recording has none."""


@dataclass(frozen=True, slots=True)
class RawTraffic:
    """Data on the wires of a run."""

    robot: tuple[records.LinkRecord, ...]
    sensor: tuple[records.WireRecord, ...]


def read(path: Path) -> Recording:
    """Read a recording up to the first damage. A run that ended before its first cycle has events but no cycles.

    Raises ConfigError if the file does not exist, is not a recording of a run, or is damaged before its first
    event.
    """
    contents = _contents(path, (CYCLE, SENSOR, TRUTH, EVENT, STEP))
    if not contents.finished and not contents.records[CYCLE.name] and not contents.records[EVENT.name]:
        raise ConfigError(f"{path} ends or is damaged before the first event: record the run again")
    return with_file(_recording(contents), path)


def with_file(recording: Recording, path: Path) -> Recording:
    """Return the recording with name and modification time of its file, if the file exists."""
    try:
        return replace(recording, written_at=path.stat().st_mtime, file=path.name)
    except OSError:
        return recording


def read_with_traffic(path: Path) -> tuple[Recording, RawTraffic]:
    """Read a recording with the raw traffic of the wires. Raises the same errors as `read`."""
    contents = _contents(path, (CYCLE, SENSOR, TRUTH, EVENT, STEP, LINK, WIRE))
    return _recording(contents), RawTraffic(
        tuple(contents.records[LINK.name]), tuple(contents.records[WIRE.name])
    )


def _recording(contents: "_Contents") -> Recording:
    records, metadata = contents.records, contents.metadata
    return Recording(
        tuple(records[CYCLE.name]),
        tuple(records[SENSOR.name]),
        tuple(records[EVENT.name]),
        metadata[METADATA_NAME],
        metadata[END_NAME],
        truncated=not contents.finished,
        truths=tuple(records[TRUTH.name]),
        devices=metadata[DEVICES_NAME],
        unix_zero_ns=contents.unix_zero_ns,
        steps=tuple(records[STEP.name]),
        removed=contents.removed,
    )


def read_link(path: Path) -> tuple[tuple[records.LinkRecord, ...], Mapping[str, str]]:
    """Read the raw traffic of the robot's link and the metadata written before the run, up to the first damage.

    A recording without control cycles is accepted. Raises ConfigError if the file does not exist or is not a
    recording of a run.
    """
    contents = _contents(path, (LINK,))
    return tuple(contents.records[LINK.name]), contents.metadata[METADATA_NAME]


@dataclass(slots=True)
class _Contents:
    """Requested parts of a file."""

    records: dict[str, list[Any]]
    """Records by topic."""
    metadata: dict[str, dict[str, str]]
    """Metadata by name."""
    finished: bool = False
    """Whether the file is complete."""
    unix_zero_ns: int = 0
    removed: RemovedMap | None = None


def _contents(path: Path, topics: Sequence[Topic]) -> _Contents:
    """Return the records of these topics and all metadata. Raises ConfigError."""
    if path.is_dir():
        raise ConfigError(f"{path} is a folder, not a recording of a run; {_BAG_READERS}")
    data = read_mcap(path, "the recording")
    if not data:
        raise ConfigError(f"{path} is empty: the run was ended before anything was recorded; record it again")
    if not data.startswith(MAGIC):
        refuse_known_file(path)
        raise ConfigError(f"{path} is not an MCAP file: name the recording that a run has written")
    contents = _Contents(
        records={topic.name: [] for topic in topics},
        metadata={METADATA_NAME: {}, DEVICES_NAME: {}, END_NAME: {}},
    )
    try:
        check_size(data)
        for item in _items(data, topics):
            match item:
                case Header(profile=profile) if profile == ROS_PROFILE:
                    raise ConfigError(f"{path} is a ROS 2 bag, not a recording of a run; {_BAG_READERS}")
                case Metadata() if item.name in contents.metadata:
                    contents.metadata[item.name] = item.metadata
                    _refuse_older(path, contents.metadata[METADATA_NAME].get("version", ""))
                case Attachment() if item.name == REMOVED_NAME:
                    contents.removed = _read_removed(item)
                case int():
                    contents.unix_zero_ns = item
                case (str(topic), record):
                    contents.records[topic].append(record)
        contents.finished = True
    except _UnexpectedMessage as error:
        raise ConfigError(
            f"{path} is not a recording of this version: {error}; record the run again"
        ) from error
    except LimitExceeded as error:
        raise refusal(path, error, "is it damaged, or not a recording of a run?") from error
    except Damage:
        pass  # earlier records are kept
    return contents


def _refuse_older(path: Path, version: str) -> None:
    """Raise ConfigError if the recording was made by an earlier version, in the previous form."""
    number = _VERSION.match(version)
    if number is not None and (int(number[1]), int(number[2])) < FIRST_OF_FORM:
        raise ConfigError(
            f"{path} was recorded by version {version}; {LAST_READER} is the last version that reads it"
        )


def _read_removed(item: Attachment) -> RemovedMap:
    try:
        return from_json(item.data)
    except ValueError as error:
        raise _UnexpectedMessage(f"the attachment {item.name}: {error}") from error


class _UnexpectedMessage(Exception):
    """A complete message does not match the type of its topic."""


def _items(
    data: bytes, wanted: Sequence[Topic]
) -> Iterator[Header | Metadata | Attachment | int | tuple[str, Record]]:
    """Yield header, metadata, attachments and records of a file in order.

    It also yields once the UNIX time at which the run's clock was 0, ns. Raises Damage if the file ends early or is
    damaged, LimitExceeded if it exceeds a limit.
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
                    raise _UnexpectedMessage(f"a message of {name}: {error}") from error
                if not dated and abs(at := topic.time_of(record)) < CLOCK_LIMIT_S:
                    dated = True
                    yield item.publish_time - round(at * 1e9)
                yield name, record
            case Metadata() | Attachment() | Header():
                yield item
