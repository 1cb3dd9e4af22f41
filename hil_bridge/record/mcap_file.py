"""The records of an MCAP file within bounds of memory and time, whatever the file says that it holds."""

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
MAGIC = b"\x89MCAP0\r\n"
"""First and last bytes of a file. Source: MCAP specification, version 0."""
ROS_PROFILE = "ros2"
"""Profile of a file that ROS 2 has written. Source: registry of the MCAP specification."""

_TOO_MANY = f"more than {RECORD_LIMIT} records"
_RECORD = struct.Struct("<BQ")
"""Opcode and length before every record. Source: MCAP specification, version 0."""
_CHUNK = struct.Struct("<QQQ")
"""Begin of a chunk: the times of its first and last message, and its size unpacked. Source: as above."""


class TooMuch(Exception):
    """The file unpacks to more than is read."""


class Damage(Exception):
    """The file cannot be read from here on."""


def read_mcap(path: Path, what: str) -> bytes:
    """Read a file; of one that is too long, or is no MCAP file, only as much as shows that. `what` says what it
    is, as "the recording". Raises ConfigError.
    """
    with open_ordinary(path, what) as file:
        head = file.read(len(MAGIC))
        return head + read_up_to(file, UNPACKED_LIMIT_BYTES) if head == MAGIC else head


def check_size(data: bytes) -> None:
    """Raise TooMuch for a file that is too long, or whose chunks are by what they state."""
    if (size := max(len(data), sum(_claims(data)))) > UNPACKED_LIMIT_BYTES:
        raise TooMuch(f"{size} bytes unpacked")


def refusal(path: Path, error: TooMuch, advice: str) -> ConfigError:
    """Return the error for a refused file."""
    return ConfigError(
        f"{format_path(path)} is refused: it says that it holds {error}, but at most {UNPACKED_LIMIT_BYTES} bytes "
        f"are read, {CHUNK_LIMIT_BYTES} of them in a chunk; {advice}"
    )


def mcap_records(data: bytes) -> Iterator[McapRecord]:
    """Every record up to the closing magic, those in chunks too. Raises Damage, TooMuch."""
    unpacked = count = 0
    try:
        for item in StreamReader(
            io.BytesIO(data), emit_chunks=True, validate_crcs=True, record_size_limit=len(data)
        ).records:
            count += 1
            if count > RECORD_LIMIT:
                raise TooMuch(_TOO_MANY)
            if not isinstance(item, Chunk):
                yield item
                continue
            unpacked += item.uncompressed_size
            if item.uncompressed_size > CHUNK_LIMIT_BYTES or unpacked > UNPACKED_LIMIT_BYTES:
                raise TooMuch(f"a chunk of {item.uncompressed_size} bytes unpacked")
            plain = replace(item, compression="", data=_unpack(item))
            inside = sum(1 for _ in _records(plain.data, 0))
            if inside * MESSAGE_BYTES > len(plain.data) + CHUNK_EXCESS_BYTES:
                raise ValueError("a chunk of records that are too short for messages")
            count += inside
            if count > RECORD_LIMIT:
                raise TooMuch(_TOO_MANY)
            yield from breakup_chunk(plain, validate_crc=True)
    except TooMuch:
        raise
    except Exception as error:  # the library lets everything through: struct, zstd, lz4, Unicode, memory
        raise Damage from error


def _claims(data: bytes) -> Iterator[int]:
    """Unpacked size that each chunk states, as far as the file can be followed."""
    for opcode, at, length in _records(data, len(MAGIC)):
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
    """Return a chunk's records.

    No more memory is taken than the chunk claims, whatever its data unpack to: a frame's own header is not asked.
    Raises ValueError when that is not what it claims, and what the libraries raise.
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
