"""Reader of an MCAP file's records with limits on memory and time that hold for any sizes stated in the file."""

import io
import struct
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import lz4.frame
import zstandard
from mcap.opcode import Opcode
from mcap.records import Chunk, McapRecord
from mcap.stream_reader import StreamReader, breakup_chunk

from hil_bridge.errors import ConfigError
from hil_bridge.errors.text_files import format_path, open_ordinary, read_up_to

CHUNK_LIMIT_BYTES = 1 << 24
"""Largest size of a chunk, uncompressed, bytes. Chosen: 16 times the largest chunk of a run, 4 times the largest
chunk of other programs.
"""
UNPACKED_LIMIT_BYTES = 1 << 31
"""Largest total size of all chunks of a recording, uncompressed, and largest file size, bytes.

Chosen: half a day of the default run. Reading such a recording needs several times that much memory.
"""
RECORD_LIMIT = UNPACKED_LIMIT_BYTES // 128
"""Maximum number of records in a recording. Derived: the mean record of a run is longer, and reading this many
takes minutes.
"""
MESSAGE_BYTES = 31
"""Smallest size of a message, bytes. Source: MCAP specification, version 0: opcode, length and header of a message."""
CHUNK_EXCESS_BYTES = 4096
"""Total number of bytes by which other kinds of records in a chunk, which may be shorter than a message, may fall
short. Chosen.
"""
MAGIC = b"\x89MCAP0\r\n"
"""First and last bytes of a file. Source: MCAP specification, version 0."""
ROS_PROFILE = "ros2"
"""Profile in the header of a file written by ROS 2. Source: registry of the MCAP specification."""

_TOO_MANY = f"more than {RECORD_LIMIT} records"
_RECORD = struct.Struct("<BQ")
"""Format of the opcode and length before every record. Source: MCAP specification, version 0."""
_CHUNK = struct.Struct("<QQQ")
"""Format of the start of a chunk: times of its first and last message, and its uncompressed size. Source: MCAP
specification, version 0.
"""


class LimitExceeded(Exception):
    """The file or its uncompressed contents exceed a size limit."""


class Damage(Exception):
    """The rest of the file is unreadable."""


def read_mcap(path: Path, what: str) -> bytes:
    """Read a file; stop as soon as it is known to be too long or not an MCAP file.

    `what` names the file in messages, such as "the recording". Raises ConfigError.
    """
    with open_ordinary(path, what) as file:
        head = file.read(len(MAGIC))
        return head + read_up_to(file, UNPACKED_LIMIT_BYTES) if head == MAGIC else head


def check_size(data: bytes) -> None:
    """Raise LimitExceeded if the file is too long, or if the sizes that its chunks state are too large."""
    if (size := max(len(data), sum(_stated_sizes(data)))) > UNPACKED_LIMIT_BYTES:
        raise LimitExceeded(f"{size} bytes unpacked")


def refusal(path: Path, error: LimitExceeded, advice: str) -> ConfigError:
    """Return the error for a file that exceeds a limit."""
    return ConfigError(
        f"{format_path(path)} is refused: it states {error}, but at most {UNPACKED_LIMIT_BYTES} bytes "
        f"are read, {CHUNK_LIMIT_BYTES} of them in a chunk; {advice}"
    )


def mcap_records(data: bytes) -> Iterator[McapRecord]:
    """Yield every record up to the closing magic, including the records in chunks. Raises Damage, LimitExceeded."""
    unpacked = count = 0
    try:
        for item in StreamReader(
            io.BytesIO(data), emit_chunks=True, validate_crcs=True, record_size_limit=len(data)
        ).records:
            count += 1
            if count > RECORD_LIMIT:
                raise LimitExceeded(_TOO_MANY)
            if not isinstance(item, Chunk):
                yield item
                continue
            unpacked += item.uncompressed_size
            if item.uncompressed_size > CHUNK_LIMIT_BYTES or unpacked > UNPACKED_LIMIT_BYTES:
                raise LimitExceeded(f"a chunk of {item.uncompressed_size} bytes unpacked")
            plain = replace(item, compression="", data=_unpack(item))
            inside = sum(1 for _ in _records(plain.data, 0))
            if inside * MESSAGE_BYTES > len(plain.data) + CHUNK_EXCESS_BYTES:
                raise ValueError("a chunk of records that are too short for messages")
            count += inside
            if count > RECORD_LIMIT:
                raise LimitExceeded(_TOO_MANY)
            yield from breakup_chunk(plain, validate_crc=True)
    except LimitExceeded:
        raise
    except Exception as error:  # the library passes all exceptions on: struct, zstd, lz4, Unicode, memory
        raise Damage from error


def _stated_sizes(data: bytes) -> Iterator[int]:
    """Return the uncompressed size that each chunk states, up to the first unreadable record."""
    for opcode, at, length in _records(data, len(MAGIC)):
        if opcode == Opcode.CHUNK and _CHUNK.size <= length <= len(data) - at:
            yield _CHUNK.unpack_from(data, at)[2]


def _records(data: bytes, at: int) -> Iterator[tuple[int, int, int]]:
    """Yield opcode, offset and length of each record up to the first unreadable one.

    At most one more record than the limit is yielded.
    """
    for _ in range(RECORD_LIMIT + 1):
        if at + _RECORD.size > len(data):
            return
        opcode, length = _RECORD.unpack_from(data, at)
        at += _RECORD.size
        yield opcode, at, length
        at += length


def _unpack(chunk: Chunk) -> bytes:
    """Return the records of a chunk.

    Memory use is limited to the size that the chunk states, because the header of the compressed frame is not
    trusted. Raises ValueError if the data do not have that size, and the errors of the compression libraries.
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
