"""Files that are no recording, or hide too much: refused in one line, and in little memory."""

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


def zstd_bomb(size: int, *, told: bool) -> bytes:
    """Zeros, packed; `told`: the frame's header holds their number."""
    packer = zstandard.ZstdCompressor(write_content_size=told).compressobj(size if told else -1)
    zeros = bytes(1 << 20)
    return b"".join(packer.compress(zeros) for _ in range(size >> 20)) + packer.flush()


def lz4_bomb(size: int) -> bytes:
    packer = lz4.frame.LZ4FrameCompressor()
    zeros = bytes(1 << 20)
    return packer.begin() + b"".join(packer.compress(zeros) for _ in range(size >> 20)) + packer.flush()


def with_chunk(path: Path, claim: int, compression: str, packed: bytes) -> Path:
    """A recording with one more chunk behind its last, and nothing after that."""
    data, at = write(path, stream(1.0)).read_bytes(), 8
    while data[at] != 15:  # the record that ends the data
        at += 9 + int.from_bytes(data[at + 1 : at + 9], "little")
    head, name = data[:at], compression.encode()
    body = struct.pack("<QQQII", 0, 0, claim, 0, len(name)) + name + struct.pack("<Q", len(packed)) + packed
    path.write_bytes(head + struct.pack("<BQ", 6, len(body)) + body)
    return path


def peak_bytes(path: Path) -> tuple[str, int]:
    """Result of reading, and the most memory that Python and the unpackers took for it."""
    tracemalloc.start()
    try:
        said = "truncated" if read(path).truncated else "whole"
    except ConfigError as error:
        said = str(error)
    finally:
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    return said, peak


BOMB = 256 << 20
"""Large enough that taking it is seen, small enough that a reader which does take it survives."""
PACKERS = {
    "zstd": lambda: zstd_bomb(BOMB, told=False),
    "zstd whose header tells": lambda: zstd_bomb(BOMB, told=True),
    "lz4": lambda: lz4_bomb(BOMB),
}


@pytest.mark.parametrize("name", PACKERS)
@pytest.mark.parametrize("claim", [BOMB, 1 << 40, 1 << 63])
def test_a_chunk_that_claims_too_much_is_refused_while_packed(tmp_path: Path, name: str, claim: int) -> None:
    path = with_chunk(tmp_path / "bomb.mcap", claim, name.partition(" ")[0], PACKERS[name]())
    said, peak = peak_bytes(path)
    assert "bomb.mcap is refused: it says that it holds" in said
    assert "\n" not in said
    assert peak < BOMB / 4


@pytest.mark.parametrize("name", PACKERS)
def test_a_chunk_that_holds_more_than_it_claims_is_damage(tmp_path: Path, name: str) -> None:
    path = with_chunk(tmp_path / "bomb.mcap", 1000, name.partition(" ")[0], PACKERS[name]())
    said, peak = peak_bytes(path)
    assert said == "truncated"
    assert peak < BOMB / 4


def test_many_chunks_of_ordinary_size_are_refused_together(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write(tmp_path / "run.mcap", stream(10.0))
    monkeypatch.setattr(mcap_file, "UNPACKED_LIMIT_BYTES", 160_000)
    assert path.stat().st_size < 160_000
    with pytest.raises(ConfigError, match=r"it holds [0-9]+ bytes unpacked, but at most 160000"):
        read(path)


def test_a_file_that_hides_its_chunks_is_stopped_on_the_way(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write(tmp_path / "run.mcap", stream(10.0))
    monkeypatch.setattr(mcap_file, "UNPACKED_LIMIT_BYTES", 160_000)
    monkeypatch.setattr(mcap_file, "_claims", lambda data: ())
    with pytest.raises(ConfigError, match=r"a chunk of [0-9]+ bytes unpacked"):
        read(path)


def test_a_file_without_an_end_is_no_recording() -> None:
    with pytest.raises(ConfigError, match="it is a device; name an ordinary file"):
        read(Path("/dev/zero"))
    with pytest.raises(ConfigError, match=r"a NUL stands in it$"):
        read(Path("a\0b"))


@pytest.mark.parametrize("compression", ["lz4", ""])
def test_chunks_packed_by_other_programs_are_read(tmp_path: Path, compression: str) -> None:
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
def test_what_is_no_recording_is_refused_in_one_line(tmp_path: Path, content: bytes, message: str) -> None:
    path = tmp_path / "x.mcap"
    path.write_bytes(content)
    with pytest.raises(ConfigError, match=message) as caught:
        read(path)
    assert str(path) in str(caught.value)
    assert caught.value.exit_code == 2


def test_a_missing_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="No such file"):
        read(tmp_path / "missing.mcap")


def test_a_message_of_another_version_is_refused_by_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
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
def test_an_arbitrary_message_is_a_record_or_a_value_error(data: bytes) -> None:
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
def test_wrong_columns_are_refused(message: bytes) -> None:
    with pytest.raises(ValueError, match=r".+"):
        SENSOR.decode(message)
