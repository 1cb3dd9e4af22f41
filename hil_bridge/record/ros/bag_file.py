"""Messages of a ROS 2 bag as bytes. The bag is a folder, one of its files, or a separate MCAP file of CDR messages.

No content of a bag is trusted. `metadata.yaml` is not read, because the files themselves define their topics.
"""

import io
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeAlias

from mcap.records import Channel, Header, Message, Schema
from mcap.stream_reader import StreamReader

from hil_bridge.errors import ConfigError
from hil_bridge.errors.failures import quote_error
from hil_bridge.errors.text_files import format_path, open_ordinary, refuse_known_file
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
from hil_bridge.record.ros.messages import require_rosbags

MCAP, SQLITE, COMPRESSED = ".mcap", ".db3", ".zstd"
"""File name extensions of the files of a bag."""
MESSAGES_MAX = 2_000_000
"""Maximum number of messages that are read from a bag. Chosen: half an hour of a sensor at 1 kHz, which takes
minutes.
"""
MESSAGE_BYTES = 1 << 20
"""Largest size of a message that is read, bytes. Chosen: a message of `/tf` with thousands of frames."""
CDR = "cdr"
OWN_WRITER = "hil-bridge"
"""Library name in the header of recordings that this program writes."""
_HEADER_BYTES = 4096
_ZSTD = b"\x28\xb5\x2f\xfd"
"""First bytes of a compressed message. Source: RFC 8878."""
TopicFilter: TypeAlias = Callable[[str, str], bool]
"""Predicate for whether the messages of a topic are needed, given the name and type of the topic."""


@dataclass(slots=True)
class Bag:
    """Topics of a bag and messages of the requested topics."""

    path: Path
    types: dict[str, str] = field(default_factory=dict)
    """Type of every topic, by name."""
    messages: dict[str, list[tuple[int, bytes]]] = field(default_factory=dict)
    """Recording time, ns, and CDR data of each message, by topic and in order of time."""
    truncated: bool = False
    """Whether the bag ends early or is damaged; the messages before the damage are included."""

    def of_type(self, kind: str) -> list[str]:
        """Return the names of all topics of a type."""
        return sorted(name for name, one in self.types.items() if one == kind)


def is_bag(path: Path) -> bool:
    """Return whether a file or a folder is a ROS 2 bag, by its first bytes or its name. Raises ConfigError."""
    if path.is_dir() or path.suffix == SQLITE:
        return True
    if not path.exists():
        return False
    with open_ordinary(path, "the recording") as file:
        head = file.read(_HEADER_BYTES)
    if not head.startswith(MAGIC):
        return False
    match _header(head):
        case Header(library=writer, profile=profile) if writer != OWN_WRITER:
            return profile == ROS_PROFILE or _first_encoding(path) == CDR
    return False


def read_messages(path: Path, wants: TopicFilter) -> Bag:
    """Read the topics of a bag and the requested messages. Raises ConfigError."""
    bag = Bag(path)
    for file in _files(path):
        if file.suffix == SQLITE:
            _read_sqlite(file, wants, bag)
        else:
            _read_mcap(file, wants, bag)
    for messages in bag.messages.values():
        messages.sort(key=lambda message: message[0])  # messages with equal times stay in order
    return bag


def _header(head: bytes) -> Header | None:
    try:
        first = next(iter(StreamReader(io.BytesIO(head)).records), None)
    except Exception:  # the library passes all exceptions on
        return None
    return first if isinstance(first, Header) else None


def _first_encoding(path: Path) -> str:
    """Return the encoding of the first channel of an MCAP file; empty if the file has no channel."""
    try:
        data = read_mcap(path, "the recording")
        return next((one.message_encoding for one in mcap_records(data) if isinstance(one, Channel)), "")
    except (Damage, LimitExceeded):
        return ""


def _files(path: Path) -> list[Path]:
    if not path.is_dir():
        return [path]
    try:
        files = sorted(path.iterdir())
    except OSError as error:
        raise ConfigError(f"cannot read the bag {format_path(path)}: {error.strerror or error}") from error
    if chosen := [file for file in files if file.suffix in (MCAP, SQLITE)]:
        return chosen
    if packed := [file for file in files if file.suffix == COMPRESSED]:
        raise ConfigError(f"{format_path(packed[0])} is compressed; decompress it with `zstd -d`")
    raise ConfigError(f"{format_path(path)} is not a ROS 2 bag: no file in it ends in {MCAP} or {SQLITE}")


def _take(bag: Bag, topic: str, at_ns: int, data: bytes) -> None:
    name = format_path(bag.path)
    if len(data) > MESSAGE_BYTES:
        raise ConfigError(
            f"{name}: a message of {topic} has {len(data)} bytes; at most {MESSAGE_BYTES} are read"
        )
    if data.startswith(_ZSTD):
        raise ConfigError(
            f"{name}: its messages are compressed one by one; `ros2 bag convert` writes them without compression"
        )
    bag.messages.setdefault(topic, []).append((at_ns, data))
    if sum(map(len, bag.messages.values())) > MESSAGES_MAX:
        raise ConfigError(f"{name} has more than {MESSAGES_MAX} messages of wrench and pose; split the bag")


def _read_mcap(path: Path, wants: TopicFilter, bag: Bag) -> None:
    data = read_mcap(path, "the bag")
    if not data.startswith(MAGIC):
        refuse_known_file(path)
        raise ConfigError(
            f"{format_path(path)} is not an MCAP file: it is empty, damaged or of another format"
        )
    try:
        check_size(data)
        for topic, at_ns, message in _mcap_messages(data, wants, bag):
            _take(bag, topic, at_ns, message)
    except LimitExceeded as error:
        raise refusal(path, error, "record wrench and pose alone: `ros2 bag record /WRENCH /POSE`") from error
    except Damage:
        bag.truncated = True  # earlier messages are kept


def _mcap_messages(data: bytes, wants: TopicFilter, bag: Bag) -> Iterator[tuple[str, int, bytes]]:
    schemas: dict[int, str] = {}
    channels: dict[int, str] = {}
    for item in mcap_records(data):
        match item:
            case Schema():
                schemas[item.id] = item.name
            case Channel(message_encoding=encoding) if encoding == CDR:
                kind = schemas.get(item.schema_id, "")
                bag.types[item.topic] = kind
                if wants(item.topic, kind):
                    channels[item.id] = item.topic
            case Message() if item.channel_id in channels:
                yield channels[item.channel_id], item.log_time, item.data


def _read_sqlite(path: Path, wants: TopicFilter, bag: Bag) -> None:
    with open_ordinary(path, "the bag"):
        pass  # the library would open any file
    require_rosbags()
    from rosbags.rosbag2 import Reader

    try:
        with Reader(path) as reader:
            bag.types |= {one.topic: one.msgtype for one in reader.connections}
            chosen = [one for one in reader.connections if wants(one.topic, one.msgtype)]
            for connection, at_ns, data in reader.messages(chosen) if chosen else ():
                _take(bag, connection.topic, at_ns, bytes(data))
    except ConfigError:
        raise
    except Exception as error:  # the library passes all exceptions on: SQLite, YAML, struct
        raise ConfigError(
            f"{format_path(path)} is damaged, or not a ROS 2 bag: {quote_error(error)}"
        ) from error
