"""The messages of a bag of ROS 2 as bytes: a folder, one of its files, or an MCAP file of CDR messages alone.

Nothing in a bag is trusted. `metadata.yaml` is not read, for the files tell their topics themselves.
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
    TooMuch,
    check_size,
    mcap_records,
    read_mcap,
    refusal,
)
from hil_bridge.record.ros.messages import need_rosbags

MCAP, SQLITE, PACKED = ".mcap", ".db3", ".zstd"
"""Ends of the names of files."""
MESSAGES_MOST = 2_000_000
"""Messages of a bag that are read at most. Chosen: half an hour of a sensor at 1 kHz, and they take minutes."""
MESSAGE_BYTES = 1 << 20
"""Longest message that is read. Chosen: a message of `/tf` with thousands of frames."""
CDR = "cdr"
OURS = "hil-bridge"
"""Library that the header of our own recordings names."""
_HEADER_BYTES = 4096
_ZSTD = b"\x28\xb5\x2f\xfd"
"""Begin of a packed message. Source: RFC 8878."""
Wants: TypeAlias = Callable[[str, str], bool]
"""Whether the messages of a topic are wanted, by its name and type."""


@dataclass(slots=True)
class Bag:
    """Topics of a bag, and messages of those that are wanted."""

    path: Path
    types: dict[str, str] = field(default_factory=dict)
    """Type of every topic by its name."""
    messages: dict[str, list[tuple[int, bytes]]] = field(default_factory=dict)
    """Times at which they were recorded, ns, and CDR; by topic, in the order of these times."""
    truncated: bool = False
    """It ends early or is damaged; what came before the damage is here."""

    def of_type(self, kind: str) -> list[str]:
        """Names of the topics of a type."""
        return sorted(name for name, one in self.types.items() if one == kind)


def is_bag(path: Path) -> bool:
    """Whether a file or a folder is a bag of ROS 2, by its first bytes or its name. Raises ConfigError."""
    if path.is_dir() or path.suffix == SQLITE:
        return True
    if not path.exists():
        return False
    with open_ordinary(path, "the recording") as file:
        head = file.read(_HEADER_BYTES)
    if not head.startswith(MAGIC):
        return False
    header = _header(head)
    if header is None or header.library == OURS:
        return False
    return header.profile == ROS_PROFILE or _first_encoding(path) == CDR


def read_messages(path: Path, wants: Wants) -> Bag:
    """Read the topics of a bag and the requested messages. Raises ConfigError."""
    bag = Bag(path)
    for file in _files(path):
        if file.suffix == SQLITE:
            _read_sqlite(file, wants, bag)
        else:
            _read_mcap(file, wants, bag)
    for messages in bag.messages.values():
        messages.sort(key=lambda message: message[0])  # those of one time stay in order
    return bag


def _header(head: bytes) -> Header | None:
    try:
        first = next(iter(StreamReader(io.BytesIO(head)).records), None)
    except Exception:  # the library lets everything through
        return None
    return first if isinstance(first, Header) else None


def _first_encoding(path: Path) -> str:
    """Return the encoding of the first channel of an MCAP file; empty if it has none."""
    try:
        data = read_mcap(path, "the recording")
        return next((one.message_encoding for one in mcap_records(data) if isinstance(one, Channel)), "")
    except (Damage, TooMuch):
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
    if packed := [file for file in files if file.suffix == PACKED]:
        raise ConfigError(f"{format_path(packed[0])} is packed as a whole; `zstd -d` unpacks it")
    raise ConfigError(f"{format_path(path)} is no bag of ROS 2: no file in it ends in {MCAP} or {SQLITE}")


def _take(bag: Bag, topic: str, at_ns: int, data: bytes) -> None:
    name = format_path(bag.path)
    if len(data) > MESSAGE_BYTES:
        raise ConfigError(
            f"{name}: a message of {topic} has {len(data)} bytes; at most {MESSAGE_BYTES} are read"
        )
    if data.startswith(_ZSTD):
        raise ConfigError(
            f"{name}: its messages are packed one by one; `ros2 bag convert` writes them without compression"
        )
    bag.messages.setdefault(topic, []).append((at_ns, data))
    if sum(map(len, bag.messages.values())) > MESSAGES_MOST:
        raise ConfigError(f"{name} has more than {MESSAGES_MOST} messages of wrench and pose; split the bag")


def _read_mcap(path: Path, wants: Wants, bag: Bag) -> None:
    data = read_mcap(path, "the bag")
    if not data.startswith(MAGIC):
        refuse_known_file(path)
        raise ConfigError(
            f"{format_path(path)} is no MCAP file: it is empty or damaged, or another program's"
        )
    try:
        check_size(data)
        for topic, at_ns, message in _mcap_messages(data, wants, bag):
            _take(bag, topic, at_ns, message)
    except TooMuch as error:
        raise refusal(path, error, "record wrench and pose alone: `ros2 bag record /WRENCH /POSE`") from error
    except Damage:
        bag.truncated = True  # what came before is there


def _mcap_messages(data: bytes, wants: Wants, bag: Bag) -> Iterator[tuple[str, int, bytes]]:
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


def _read_sqlite(path: Path, wants: Wants, bag: Bag) -> None:
    with open_ordinary(path, "the bag"):
        pass  # the library would open anything
    need_rosbags()
    from rosbags.rosbag2 import Reader

    try:
        with Reader(path) as reader:
            bag.types |= {one.topic: one.msgtype for one in reader.connections}
            chosen = [one for one in reader.connections if wants(one.topic, one.msgtype)]
            for connection, at_ns, data in reader.messages(chosen) if chosen else ():
                _take(bag, connection.topic, at_ns, bytes(data))
    except ConfigError:
        raise
    except Exception as error:  # the library lets everything through: SQLite, YAML, struct
        raise ConfigError(
            f"{format_path(path)} is damaged, or no bag of ROS 2: {quote_error(error)}"
        ) from error
