"""Reading a record back. Nothing in a file is trusted: it may be cut off, garbled, a bomb or something else."""

import io
import re
import struct
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import lz4.frame
import zstandard
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, McapRecord, Message, Metadata
from mcap.stream_reader import StreamReader, breakup_chunk

from hil_bridge.errors import ConfigError
from hil_bridge.errors.text_files import format_path, open_ordinary, read_up_to
from hil_bridge.record import records
from hil_bridge.record.recorder import DEVICES_NAME, END_NAME, METADATA_NAME
from hil_bridge.record.removed_map import REMOVED_NAME, RemovedMap, from_json
from hil_bridge.record.topics import CYCLE, EVENT, LINK, SENSOR, STEP, TRUTH, WIRE, Record, Topic

CHUNK_LIMIT_BYTES = 1 << 24
"""Largest chunk, unpacked. Chosen: 16 times the largest of a run, 4 times the largest of other programs."""
UNPACKED_LIMIT_BYTES = 1 << 31
"""Of all chunks of a recording, unpacked, and of the file as it is. Chosen: half a day of the default run, and what
reads it needs some times that in memory.
"""
RECORD_LIMIT = UNPACKED_LIMIT_BYTES // 128
"""Records of a recording at most. Derived: the mean record of a run is longer, and as many take minutes to read."""
MESSAGE_BYTES = 31
"""A message is never shorter. Source: MCAP specification, version 0: opcode, length and head of a message."""
CHUNK_EXCESS_BYTES = 4096
"""Chosen: records of other kinds in a chunk may be so much shorter in all."""
FIRST_OF_FORM = (0, 6)
"""The version since which recordings have this form."""
LAST_READER = "0.5"
"""The last version that reads recordings of the form before this one."""
CLOCK_LIMIT_S = 1e10
"""A time of a run's clock lies below this. Chosen: three centuries."""

_VERSION = re.compile(r"(\d{1,4})\.(\d{1,4})(?:\.|$)")
_MAGIC = b"\x89MCAP0\r\n"
_TOO_MANY = f"more than {RECORD_LIMIT} records"
_RECORD = struct.Struct("<BQ")
"""Opcode and length before every record. Source: MCAP specification, version 0."""
_CHUNK = struct.Struct("<QQQ")
"""Begin of a chunk: the times of its first and last message, and its size unpacked. Source: as above."""


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
    """The record in a file, as far as it can be read. A run that ended before its first cycle has events, and no cycle.

    Raises ConfigError when there is no such file, when it is no record of a run, or damaged before anything happened.
    """
    found = _contents(path, (CYCLE, SENSOR, TRUTH, EVENT, STEP))
    if not found.finished and not found.records[CYCLE.name] and not found.records[EVENT.name]:
        raise ConfigError(f"{path} ends or is damaged before the first event: record the run again")
    return dated(_recording(found), path)


def dated(recording: Recording, path: Path) -> Recording:
    """The recording with the time at which this file of it was written, where there is such a file."""
    try:
        return replace(recording, written_at=path.stat().st_mtime)
    except OSError:
        return recording


def read_with_traffic(path: Path) -> tuple[Recording, RawTraffic]:
    """The same with the raw traffic of the wires. Errors as `read`."""
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
    """The raw traffic of the computer link in a recording as far as it can be read, and what was known before the
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
    """Records of topics, and all metadata. Raises ConfigError."""
    data = _bytes(path)
    if not data:
        raise ConfigError(f"{path} is empty: the run was ended before anything was recorded; record it again")
    if not data.startswith(_MAGIC):
        raise ConfigError(f"{path} is not an MCAP file: name the recording that a run has written")
    if (size := max(len(data), sum(_claims(data)))) > UNPACKED_LIMIT_BYTES:
        raise _too_long(path, f"{size} bytes unpacked")
    found = _Contents(
        records={topic.name: [] for topic in topics},
        metadata={METADATA_NAME: {}, DEVICES_NAME: {}, END_NAME: {}},
    )
    try:
        for item in _items(data, topics):
            match item:
                case Metadata() if item.name in found.metadata:
                    found.metadata[item.name] = item.metadata
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
    except _TooMuch as error:
        raise _too_long(path, str(error)) from error
    except _Damage:
        pass  # what came before is there
    if _is_older(recorder := found.metadata[METADATA_NAME].get("version", "")):
        raise ConfigError(
            f"{path} was recorded by version {recorder}; {LAST_READER} is the last version that reads it"
        )
    return found


def _is_older(version: str) -> bool:
    """Whether a version of this program made recordings of the form before this one."""
    number = _VERSION.match(version)
    return number is not None and (int(number[1]), int(number[2])) < FIRST_OF_FORM


def _read_removed(item: Attachment) -> RemovedMap:
    try:
        return from_json(item.data)
    except ValueError as error:
        raise _ForeignMessage(f"the attachment {item.name}: {error}") from error


def _bytes(path: Path) -> bytes:
    """A file as it is, and of one that is too long, or is none at all, no more than shows that. Raises ConfigError."""
    with open_ordinary(path, "the recording") as file:
        head = file.read(len(_MAGIC))
        return head + read_up_to(file, UNPACKED_LIMIT_BYTES) if head == _MAGIC else head


def _too_long(path: Path, what: str) -> ConfigError:
    return ConfigError(
        f"{format_path(path)} is refused: it says that it holds {what}, but at most {UNPACKED_LIMIT_BYTES} bytes "
        f"are read, {CHUNK_LIMIT_BYTES} of them in a chunk; is it damaged, or no recording of a run?"
    )


class _ForeignMessage(Exception):
    """A whole message that is not what its topic says."""


class _TooMuch(Exception):
    """The file unpacks to more than is read."""


class _Damage(Exception):
    """The file cannot be read from here on."""


def _items(
    data: bytes, wanted: Sequence[Topic]
) -> Iterator[Metadata | Attachment | int | tuple[str, Record]]:
    """The metadata, attachments and records of a file in order, and once the UNIX time at which the run's clock was 0,
    ns. Raises _Damage where the file ends or is garbled, _TooMuch.
    """
    topics = {topic.name: topic for topic in wanted}
    channels: dict[int, str] = {}
    dated = False
    for item in _mcap_records(data):
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
            case Metadata() | Attachment():
                yield item


def _mcap_records(data: bytes) -> Iterator[McapRecord]:
    """Every record up to the closing magic, those in chunks too. Raises _Damage, _TooMuch."""
    unpacked = count = 0
    try:
        for item in StreamReader(
            io.BytesIO(data), emit_chunks=True, validate_crcs=True, record_size_limit=len(data)
        ).records:
            count += 1
            if count > RECORD_LIMIT:
                raise _TooMuch(_TOO_MANY)
            if not isinstance(item, Chunk):
                yield item
                continue
            unpacked += item.uncompressed_size
            if item.uncompressed_size > CHUNK_LIMIT_BYTES or unpacked > UNPACKED_LIMIT_BYTES:
                raise _TooMuch(f"a chunk of {item.uncompressed_size} bytes unpacked")
            plain = replace(item, compression="", data=_unpack(item))
            inside = sum(1 for _ in _records(plain.data, 0))
            if inside * MESSAGE_BYTES > len(plain.data) + CHUNK_EXCESS_BYTES:
                raise ValueError("a chunk of records that are too short for messages")
            count += inside
            if count > RECORD_LIMIT:
                raise _TooMuch(_TOO_MANY)
            yield from breakup_chunk(plain, validate_crc=True)
    except _TooMuch:
        raise
    except Exception as error:  # the library lets everything through: struct, zstd, lz4, Unicode, memory
        raise _Damage from error


def _claims(data: bytes) -> Iterator[int]:
    """Unpacked size that each chunk states, as far as the file can be followed."""
    for opcode, at, length in _records(data, len(_MAGIC)):
        if opcode == Opcode.CHUNK and _CHUNK.size <= length <= len(data) - at:
            yield _CHUNK.unpack_from(data, at)[2]


def _records(data: bytes, at: int) -> Iterator[tuple[int, int, int]]:
    """Opcode, place and length of each record, as far as they can be followed; at most one more than are read."""
    for _ in range(RECORD_LIMIT + 1):
        if at + _RECORD.size > len(data):
            return
        opcode, length = _RECORD.unpack_from(data, at)
        at += _RECORD.size
        yield opcode, at, length
        at += length


def _unpack(chunk: Chunk) -> bytes:
    """A chunk's records. No more memory is taken than the chunk claims, whatever its data unpack to: a frame's own
    header is not asked. Raises ValueError when that is not what it claims, and what the libraries raise.
    """
    size = chunk.uncompressed_size
    match chunk.compression:
        case "zstd":
            bounded = zstandard.ZstdDecompressor(max_window_size=CHUNK_LIMIT_BYTES)
            data: bytes = bounded.stream_reader(chunk.data).read(size + 1)
        case "lz4":
            data = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=size + 1)
        case _:
            data = chunk.data
    if len(data) != size:
        raise ValueError(f"a chunk says {size} bytes and holds {'more' if len(data) > size else len(data)}")
    return data
