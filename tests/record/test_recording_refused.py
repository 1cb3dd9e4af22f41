"""Files that are not recordings, or hide excessive data, are refused in one line with little memory."""

import json
import struct
import tracemalloc
from pathlib import Path

import lz4.frame
import pytest
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st

from hil_bridge.errors import ConfigError
from hil_bridge.record import mcap_file, read
from hil_bridge.record.topics import CYCLE, SENSOR, TOPICS
from tests.record.written_recordings import cycle, stream, write


def zstd_bomb(size: int, *, has_size: bool) -> bytes:
    """Return compressed zeros; with `has_size`, the frame's header states their number."""
    packer = zstandard.ZstdCompressor(write_content_size=has_size).compressobj(size if has_size else -1)
    zeros = bytes(1 << 20)
    return b"".join(packer.compress(zeros) for _ in range(size >> 20)) + packer.flush()


def lz4_bomb(size: int) -> bytes:
    packer = lz4.frame.LZ4FrameCompressor()
    zeros = bytes(1 << 20)
    return packer.begin() + b"".join(packer.compress(zeros) for _ in range(size >> 20)) + packer.flush()


def with_chunk(path: Path, claim: int, compression: str, packed: bytes) -> Path:
    """Return a recording with one more chunk after its last, and nothing after that."""
    data, at = write(path, stream(1.0)).read_bytes(), 8
    while data[at] != 15:  # the record that ends the data
        at += 9 + int.from_bytes(data[at + 1 : at + 9], "little")
    head, name = data[:at], compression.encode()
    body = struct.pack("<QQQII", 0, 0, claim, 0, len(name)) + name + struct.pack("<Q", len(packed)) + packed
    path.write_bytes(head + struct.pack("<BQ", 6, len(body)) + body)
    return path


def peak_bytes(path: Path) -> tuple[str, int]:
    """Return the result of reading, and the peak memory of Python and the decompressors."""
    tracemalloc.start()
    try:
        outcome = "truncated" if read(path).truncated else "whole"
    except ConfigError as error:
        outcome = str(error)
    finally:
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    return outcome, peak


BOMB = 256 << 20
"""Large enough that reading it is noticed, small enough that a reader that does read it survives."""
PACKERS = {
    "zstd": lambda: zstd_bomb(BOMB, has_size=False),
    "zstd with size in header": lambda: zstd_bomb(BOMB, has_size=True),
    "lz4": lambda: lz4_bomb(BOMB),
}


@pytest.mark.parametrize("name", PACKERS)
@pytest.mark.parametrize("claim", [BOMB, 1 << 40, 1 << 63])
def test_chunk_stating_excessive_size_is_refused_unread(tmp_path: Path, name: str, claim: int) -> None:
    path = with_chunk(tmp_path / "bomb.mcap", claim, name.partition(" ")[0], PACKERS[name]())
    outcome, peak = peak_bytes(path)
    assert "bomb.mcap is refused: it states" in outcome
    assert "\n" not in outcome
    assert peak < BOMB / 4


@pytest.mark.parametrize("name", PACKERS)
def test_chunk_larger_than_stated_is_damage(tmp_path: Path, name: str) -> None:
    path = with_chunk(tmp_path / "bomb.mcap", 1000, name.partition(" ")[0], PACKERS[name]())
    outcome, peak = peak_bytes(path)
    assert outcome == "truncated"
    assert peak < BOMB / 4


def test_many_ordinary_chunks_exceed_total_limit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write(tmp_path / "run.mcap", stream(10.0))
    monkeypatch.setattr(mcap_file, "UNPACKED_LIMIT_BYTES", 160_000)
    assert path.stat().st_size < 160_000
    with pytest.raises(ConfigError, match=r"it states [0-9]+ bytes unpacked, but at most 160000"):
        read(path)


def test_file_hiding_its_chunks_is_stopped_while_reading(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write(tmp_path / "run.mcap", stream(10.0))
    monkeypatch.setattr(mcap_file, "UNPACKED_LIMIT_BYTES", 160_000)
    monkeypatch.setattr(mcap_file, "_stated_sizes", lambda data: ())
    with pytest.raises(ConfigError, match=r"a chunk of [0-9]+ bytes unpacked"):
        read(path)


def test_file_without_end_is_refused() -> None:
    with pytest.raises(ConfigError, match="it is a device, not a regular file"):
        read(Path("/dev/zero"))
    with pytest.raises(ConfigError, match=r"its path contains a NUL$"):
        read(Path("a\0b"))


@pytest.mark.parametrize("compression", ["lz4", ""])
def test_chunks_compressed_by_other_programs_are_read(tmp_path: Path, compression: str) -> None:
    plain = struct.pack("<BQHIQQ", 5, 24, 999, 0, 0, 0) + b"{}"
    packed = lz4.frame.compress(plain) if compression else plain
    path = with_chunk(tmp_path / "run.mcap", len(plain), compression, packed)
    path.write_bytes(path.read_bytes() + struct.pack("<BQQQI", 2, 20, 0, 0, 0) + b"\x89MCAP0\r\n")
    assert not read(path).truncated


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "is empty"),
        (b"time,force\n", "is not an MCAP file"),
        (b"\x89MCAP0\r\n", "is damaged before the first event"),
        (b"\x89MCAP0\r\n" + b"\xff" * 200, "is damaged before the first event"),
        (b"\x89MCAP0\r\n" + struct.pack("<BQ", 6, 1 << 62) + b"x" * 50, "is damaged before"),
    ],
)
def test_non_recording_is_refused_in_one_line(tmp_path: Path, content: bytes, message: str) -> None:
    path = tmp_path / "x.mcap"
    path.write_bytes(content)
    with pytest.raises(ConfigError, match=message) as caught:
        read(path)
    assert str(path) in str(caught.value)
    assert caught.value.exit_code == 2


def test_missing_recording_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="No such file"):
        read(tmp_path / "missing.mcap")


def test_message_of_other_version_is_refused_by_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(type(CYCLE), "encode", lambda self, record: b'{"cycle":"one"}')
        write(tmp_path / "run.mcap", [cycle(0, 100.0)])
    with pytest.raises(ConfigError, match=r"message of /cycle: Expected `int`, got `str` - at `\$\.cycle`"):
        read(tmp_path / "run.mcap")


MESSAGES = st.fixed_dictionaries(
    {},
    optional={
        name: st.text(max_size=3)
        | st.floats(allow_nan=False, allow_infinity=False)
        | st.lists(st.integers(), max_size=6)
        for name in ("at", "kind", "text", "sequence", "counts", "data", "direction")
    },
).map(lambda values: json.dumps(values).encode())


@settings(max_examples=100)
@given(st.binary(max_size=300) | MESSAGES)
def test_arbitrary_message_decodes_or_raises_value_error(data: bytes) -> None:
    for topic in TOPICS:
        try:
            record = topic.decode(data)
        except (ValueError, RecursionError):
            continue
        assert isinstance(record, topic.record)


@pytest.mark.parametrize(
    "message",
    [
        b'{"at":true,"sequence":1,"counts":[1,2,3,4,5,6]}',
        b'{"at":1,"sequence":1.5,"counts":[1,2,3,4,5,6]}',
        b'{"at":1,"sequence":1,"counts":[1,2,3,4,5]}',
        b'{"at":1,"sequence":1,"counts":{"a":1}}',
        b'{"at":NaN,"sequence":1,"counts":[1,2,3,4,5,6]}',
        b'{"at":1' + b"0" * 400 + b',"sequence":1,"counts":[1,2,3,4,5,6]}',
        b'{"sequence":1,"counts":[1,2,3,4,5,6]}',
        b"[1,2]",
    ],
)
def test_invalid_columns_are_refused(message: bytes) -> None:
    with pytest.raises(ValueError, match=r".+"):
        SENSOR.decode(message)
