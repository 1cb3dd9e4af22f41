"""Files that never end, never begin, or unpack to an excessive size are refused in one line within seconds."""

import os
import sqlite3
import struct
import time
import zlib
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
import zstandard
from click.testing import CliRunner

from hil_bridge.cli.why import why
from hil_bridge.device_commands.s3.monitor import monitor_file
from hil_bridge.devices.robots.s3.program_folder import read_programs
from hil_bridge.errors import ConfigError
from hil_bridge.errors.text_files import TOML_LIMIT_BYTES, parse_toml, read_text
from hil_bridge.lab.campaign.store import FORMAT, Store
from hil_bridge.record import mcap_file, read
from hil_bridge.settings.configuration import load_config
from hil_bridge.site.traffic import is_recording
from protocol.devices.s3.arap import KNOWN

SOON_S = 20.0
"""Longest time for refusing a hostile file, also on a busy machine."""
READERS: dict[str, Callable[[Path], object]] = {
    "text": read_text,
    "configuration": lambda path: load_config(path, {}),
    "recording": read,
    "results": Store.open,
    "capture": lambda path: monitor_file(path, None, KNOWN, False),
    "program": lambda path: read_programs(path.parent, 240),
}


def refusal_of(act: Callable[[], object]) -> str:
    """Return the single line of the refusal, which must come soon."""
    began = time.monotonic()
    with pytest.raises(ConfigError) as caught:
        act()
    assert time.monotonic() - began < SOON_S
    text = str(caught.value)
    assert "\n" not in text
    assert len(text) < 1000
    return text


@pytest.mark.parametrize("name", READERS)
def test_pipe_as_text_file_is_refused(tmp_path: Path, name: str) -> None:
    path = tmp_path / "7.prg"
    os.mkfifo(path)
    assert "7.prg" in refusal_of(lambda: READERS[name](path))


@pytest.mark.parametrize("name", [name for name in READERS if name != "program"])
@pytest.mark.parametrize("device", ["/dev/zero", "/dev/full", "/dev/null"])
def test_device_as_text_file_is_refused(name: str, device: str) -> None:
    assert device in refusal_of(lambda: READERS[name](Path(device)))


def test_pipe_as_recording_is_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "p")
    assert not is_recording(tmp_path / "p")
    assert not is_recording(Path("/dev/zero"))


SLOW = {
    "dotted key": ".".join("a" * (TOML_LIMIT_BYTES // 2 - 2)) + "=1",
    "dotted header": f"[{'.'.join('a' * (TOML_LIMIT_BYTES // 2 - 4))}]\n",
    "quoted parts": "x={" + " . ".join(['"a"'] * 150_000) + "=1}",
    "nested arrays": "x=" + "[" * 500_000,
    "many headers": "[[a]]\n" * 170_000,
    "many keys": "\n".join(f"a{k}=1" for k in range(100_000)),
    "long text": 'x="' + "\\u0041" * 170_000 + '"',
    "no end": 'x="""' + "a" * 1_000_000,
    "digits": f"x={'1_' * 500_000}1",
}


@pytest.mark.full
@pytest.mark.parametrize("text", SLOW.values(), ids=SLOW)
def test_largest_toml_text_is_parsed_quickly(text: str) -> None:
    assert len(text) <= TOML_LIMIT_BYTES
    began = time.monotonic()
    with suppress(ConfigError):
        parse_toml(text, "h.toml")
    assert time.monotonic() - began < SOON_S


def test_toml_key_with_too_many_parts_is_refused() -> None:
    assert "more than 32 levels deep" in refusal_of(lambda: parse_toml(f"{'.'.join('a' * 33)} = 1", "h.toml"))
    numbers = ", ".join(f"{k}.5" for k in range(2000))
    assert len(parse_toml(f"x = [{numbers}]", "h.toml")["x"]) == 2000


def record(opcode: int, data: bytes) -> bytes:
    return struct.pack("<BQ", opcode, len(data)) + data


def text_of(value: str) -> bytes:
    return struct.pack("<I", len(value)) + value.encode()


def chunk(data: bytes) -> bytes:
    """Return a chunk with these records, compressed."""
    packed = zstandard.ZstdCompressor().compress(data)
    head = struct.pack("<QQQI", 0, 0, len(data), zlib.crc32(data))
    return record(6, head + text_of("zstd") + struct.pack("<Q", len(packed)) + packed)


HEADER = b"\x89MCAP0\r\n" + record(1, text_of("") + text_of(""))


@pytest.mark.parametrize("packed", [False, True], ids=["plain", "packed"])
def test_recording_with_endless_records_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, packed: bool
) -> None:
    monkeypatch.setattr(mcap_file, "RECORD_LIMIT", 100_000)
    message = record(5, struct.pack("<HIQQ", 1, 0, 0, 0))
    inside = record(3, struct.pack("<H", 1) + text_of("s") + text_of("") + struct.pack("<I", 0))
    inside += record(4, struct.pack("<HH", 1, 1) + text_of("/x") + text_of("") + struct.pack("<I", 0))
    inside += message * 60_000
    body = chunk(inside) * 3 if packed else inside + message * 60_000
    (tmp_path / "r.mcap").write_bytes(HEADER + body)
    assert "records, but at most" in refusal_of(lambda: read(tmp_path / "r.mcap"))


def test_recording_of_empty_records_ends_quickly(tmp_path: Path) -> None:
    (tmp_path / "r.mcap").write_bytes(HEADER + chunk(bytes(9) * 1_800_000) * 8)
    assert "ends or is damaged before the first event" in refusal_of(lambda: read(tmp_path / "r.mcap"))


def results(path: Path, *statements: str) -> Path:
    """Return a results file made by another program."""
    with sqlite3.connect(path) as connection:
        connection.execute("CREATE TABLE facts (name TEXT PRIMARY KEY, value TEXT NOT NULL)")
        connection.execute("INSERT INTO facts VALUES ('format', ?)", (FORMAT,))
        for statement in statements:
            connection.execute(statement)
    connection.close()
    return path


ENDLESS = "WITH RECURSIVE c(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM c) SELECT * FROM c"


@pytest.mark.parametrize(
    "statement",
    [
        f"CREATE VIEW runs AS {ENDLESS}",
        "CREATE TABLE runs (key TEXT, number TEXT GENERATED ALWAYS AS (zeroblob(900000000)))",
        "CREATE TRIGGER t AFTER INSERT ON facts BEGIN DELETE FROM facts; END",
    ],
    ids=["view", "made-column", "trigger"],
)
def test_results_with_computed_columns_are_refused(tmp_path: Path, statement: str) -> None:
    path = results(tmp_path / "r.sqlite", statement)
    assert "is not a results file" in refusal_of(lambda: Store.open(path))


def test_results_with_view_instead_of_table_are_refused(tmp_path: Path) -> None:
    with sqlite3.connect(tmp_path / "r.sqlite") as connection:
        connection.execute(f"CREATE VIEW facts(name, value) AS SELECT x, x FROM ({ENDLESS})")
    connection.close()
    assert "is not a results file of a campaign" in refusal_of(lambda: Store.open(tmp_path / "r.sqlite"))


def test_results_with_giant_text_are_refused(tmp_path: Path) -> None:
    path = results(tmp_path / "r.sqlite", "INSERT INTO facts VALUES ('seeds', printf('%.*c', 20000000, 'x'))")

    def seeds() -> Any:
        with Store.open(path) as store:
            return store.seeds()

    assert "too big" in refusal_of(seeds)


def test_results_locked_by_other_program_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hil_bridge.lab.campaign.store.READ_BUSY_S", 0.2)
    path = results(tmp_path / "r.sqlite")
    holder = sqlite3.connect(path)
    holder.execute("BEGIN EXCLUSIVE")
    assert "r.sqlite" in refusal_of(lambda: Store.open(path))
    holder.close()


def test_why_escapes_terminal_control_characters(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("hil_bridge.record.read_with_traffic", lambda path: (None, None))
    monkeypatch.setattr(
        "hil_bridge.record.analysis.why.why", lambda record, file: "cause: \x1b[2J\x07gone\nthen \u202e"
    )
    monkeypatch.setattr("hil_bridge.lab.invariants.promises_broken", lambda record: ["\x1b[2J"])
    monkeypatch.setattr(
        "hil_bridge.record.analysis.why.tracebacks", lambda record: ["Traceback \x1b]0;x\x07\n"]
    )
    output = CliRunner().invoke(why, ["r.mcap"]).output
    broken = "A promise was broken. \\x1b[2J.\n"
    assert output == f"cause: \\x1b[2J\\x07gone\nthen \\u202e\n{broken}\nTraceback \\x1b]0;x\\x07\n"
