"""Reading a record back. Nothing in a file is trusted: it may be cut off, garbled or something else."""

import io
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import field
from pathlib import Path
from typing import Any

from mcap.records import Channel, McapRecord, Message, Metadata
from mcap.stream_reader import StreamReader

from hil_bridge.errors import ConfigError
from hil_bridge.recording.recorder import END_NAME, METADATA_NAME
from hil_bridge.recording.records import CycleRecord, EventRecord, LinkRecord, SensorRecord, TruthRecord
from hil_bridge.recording.topics import CYCLE, EVENT, LINK, SENSOR, TRUTH, Record, Topic
from protocol.values import dataclass

_MAGIC = b"\x89MCAP0\r\n"


@dataclass(frozen=True, slots=True)
class Recording:
    """What is kept of a run."""

    cycles: tuple[CycleRecord, ...]
    sensors: tuple[SensorRecord, ...] = ()
    events: tuple[EventRecord, ...] = ()
    metadata: Mapping[str, str] = field(default_factory=dict)
    """What was known before the run: configuration, versions, seed."""
    end: Mapping[str, str] = field(default_factory=dict)
    """What was known after an orderly end; empty when the run was cut off."""
    truncated: bool = False
    """The file ends early or is damaged; what came before the damage is here."""
    truths: tuple[TruthRecord, ...] = ()
    """What the emulated cell knew; empty for a real one."""


def read(path: Path) -> Recording:
    """The record in a file, as far as it can be read.

    Raises ConfigError when there is no such file, when it is no record of a run, or holds no cycle.
    """
    records, metadata, finished = _contents(path, (CYCLE, SENSOR, TRUTH, EVENT))
    if not records[CYCLE.name]:
        why = "holds no control cycle" if finished else "ends or is damaged before the first control cycle"
        raise ConfigError(f"{path} {why}: nothing can be shown or replayed; record the run again")
    return Recording(
        tuple(records[CYCLE.name]),
        tuple(records[SENSOR.name]),
        tuple(records[EVENT.name]),
        metadata[METADATA_NAME],
        metadata[END_NAME],
        truncated=not finished,
        truths=tuple(records[TRUTH.name]),
    )


def read_link(path: Path) -> tuple[tuple[LinkRecord, ...], Mapping[str, str]]:
    """The raw traffic of the computer link in a recording as far as it can be read, and what was known before the
    run. A run that never came to a cycle has it too.

    Raises ConfigError when there is no such file or it is no record of a run.
    """
    records, metadata, _ = _contents(path, (LINK,))
    return tuple(records[LINK.name]), metadata[METADATA_NAME]


def _contents(
    path: Path, topics: Sequence[Topic]
) -> tuple[dict[str, list[Any]], dict[str, dict[str, str]], bool]:
    """Records by topic, metadata by name, and whether the file is whole. Raises ConfigError."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise ConfigError(f"cannot read the recording {path}: {error.strerror or error}") from error
    if not data:
        raise ConfigError(f"{path} is empty: the run was ended before anything was recorded; record it again")
    if not data.startswith(_MAGIC):
        raise ConfigError(f"{path} is not an MCAP file: name the recording that a run has written")
    records: dict[str, list[Any]] = {topic.name: [] for topic in topics}
    metadata: dict[str, dict[str, str]] = {METADATA_NAME: {}, END_NAME: {}}
    try:
        for item in _items(data, topics):
            match item:
                case Metadata() if item.name in metadata:
                    metadata[item.name] = item.metadata
                case (str(topic), record):
                    records[topic].append(record)
        finished = True
    except _ForeignMessage as error:
        raise ConfigError(
            f"{path} is not a recording of this version: {error}; record the run again"
        ) from error
    except _Damage:
        finished = False
    return records, metadata, finished


class _ForeignMessage(Exception):
    """A whole message that is not what its topic says."""


class _Damage(Exception):
    """From here on the file cannot be read."""


def _items(data: bytes, wanted: Sequence[Topic]) -> Iterator[Metadata | tuple[str, Record]]:
    """The metadata and the records of a file in order. Raises _Damage where the file ends or is garbled."""
    topics = {topic.name: topic for topic in wanted}
    channels: dict[int, str] = {}
    for item in _mcap_records(data):
        match item:
            case Channel():
                channels[item.id] = item.topic
            case Message() if channels.get(item.channel_id) in topics:
                name = channels[item.channel_id]
                try:
                    yield name, topics[name].decode(item.data)
                except (ValueError, RecursionError) as error:
                    raise _ForeignMessage(f"a message of {name}: {error}") from error
            case Metadata():
                yield item


def _mcap_records(data: bytes) -> Iterator[McapRecord]:
    """Every record up to the closing magic. Raises _Damage."""
    try:
        yield from StreamReader(io.BytesIO(data), validate_crcs=True, record_size_limit=len(data)).records
    except Exception as error:  # the library lets everything through: struct, zstd, lz4, Unicode, memory
        raise _Damage from error
