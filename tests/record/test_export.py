"""Export of a recording to other formats, read back by their readers."""

import csv
import io
import math
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Sequence
from itertools import chain
from pathlib import Path
from typing import Any

import can
import cantools
import pytest
from click.testing import CliRunner

import hil_bridge
from hil_bridge.cli import cli
from hil_bridge.cli.export import FORMAT_NAMES
from hil_bridge.control.sample import Sample
from hil_bridge.device_commands.s3.capture import link_pieces, parse_capture
from hil_bridge.errors import ConfigError
from hil_bridge.record import (
    CycleRecord,
    LinkRecord,
    SensorRecord,
    WireRecord,
    read,
    read_link,
    read_with_traffic,
)
from hil_bridge.record.device_facts import devices_of
from hil_bridge.record.export import FORMATS, export
from hil_bridge.record.export.can_logs import asc, blf, candump
from hil_bridge.record.export.tables import COLUMNS_MAX, as_csv, cycle_table, sensor_table
from hil_bridge.record.export.traffic import WireFrame, can_frames, wire_text
from hil_bridge.transports.can.message import from_message
from protocol.can.frame import CanFrame
from protocol.wrench import AXES
from tests.near_surface import WHOLE, merged
from tests.recordings import Recordings

OLD = Path(__file__).parent / "recordings" / "version_0_1_0.mcap"
ZERO_NS = 1_700_000_000_123_456_789
ODD = (
    CanFrame(0x601, bytes(range(8))),
    CanFrame(0x18DAF110, b"\x02", extended=True),
    CanFrame(0x001, b""),
    CanFrame(0x123, remote=True),
)


def copy_recording(recordings: Recordings, folder: Path, emulated: str) -> Path:
    """Return the path of a recording with this sensor, under a separate name."""
    recording = recordings.path(merged(WHOLE, {"sensor": {"emulated": emulated}}))
    return Path(shutil.copy(recording, folder / "run.mcap"))


@pytest.fixture(scope="module")
def on_can(recordings: Recordings, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return copy_recording(recordings, tmp_path_factory.mktemp("gateway"), "jr3")


@pytest.fixture(scope="module")
def on_bytes(recordings: Recordings, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return copy_recording(recordings, tmp_path_factory.mktemp("uart"), "jr3-uart")


# --- DBC


@pytest.mark.parametrize("sensor", ["jr3", "ati-can"])
def test_dbc_file_decodes_recorded_frames(sensor: str, recordings: Recordings, tmp_path: Path) -> None:
    path = copy_recording(recordings, tmp_path, sensor)
    export(path, ["dbc"], tmp_path)
    database: Any = cantools.database.load_file(tmp_path / "run.dbc")
    known = {message.frame_id for message in database.messages}
    frames = can_frames(read_with_traffic(path)[1].sensor)
    assert {one.frame.identifier for one in frames if not one.sent} <= known
    received = [one.frame for one in frames if sensor == "jr3" or not one.sent]
    counted = [database.decode_message(one.identifier, one.data) for one in received]
    name = "fz" if sensor == "jr3" else "sg0"
    values = {values[name] for values in counted if name in values}
    assert len(values) > 10
    assert all(math.isfinite(value) for value in values)


# --- CAN logs

READERS: dict[str, Callable[[Path], Any]] = {
    ".log": can.CanutilsLogReader,
    ".blf": can.BLFReader,
    ".asc": can.ASCReader,
}
RESOLUTION_S = 2e-6
"""One microsecond, plus the rounding of a UNIX time as floating-point number."""


def read_back(path: Path) -> list[tuple[float, bool, CanFrame | None]]:
    with READERS[path.suffix](path) as reader:
        return [(one.timestamp, not one.is_rx, from_message(one, 0.0)) for one in reader]


@pytest.mark.parametrize("suffix", READERS)
def test_can_log_contains_every_recorded_frame(on_can: Path, tmp_path: Path, suffix: str) -> None:
    export(on_can, ("candump", "blf", "asc"), tmp_path)
    recording, traffic = read_with_traffic(on_can)
    recorded = can_frames(traffic.sensor)
    exported = read_back(tmp_path / f"run{suffix}")
    assert len(exported) > 1000
    assert [frame for _, _, frame in exported] == [one.frame for one in recorded]
    if suffix != ".log":
        assert [sent for _, sent, _ in exported] == [one.sent for one in recorded]
        assert {sent for _, sent, _ in exported} == {True, False}
    begin = recorded[0].at if suffix == ".asc" else -recording.unix_zero_ns / 1e9
    assert [at for at, _, _ in exported] == pytest.approx(
        [one.at - begin for one in recorded], abs=RESOLUTION_S
    )


def test_candump_log_has_can_utils_format(on_can: Path, tmp_path: Path) -> None:
    """Format of candump -l: time, interface and frame, and nothing after the frame."""
    export(on_can, ("candump",), tmp_path)
    lines = (tmp_path / "run.log").read_text().splitlines()
    assert len(lines) > 1000
    assert all(re.fullmatch(r"\(\d+\.\d{6}\) can0 [0-9A-F]{3}#[0-9A-F]{0,16}", line) for line in lines)


@pytest.mark.skipif(shutil.which("tshark") is None, reason="Wireshark's tshark is not installed")
def test_candump_log_is_readable_by_wireshark(on_can: Path, tmp_path: Path) -> None:
    export(on_can, ("candump",), tmp_path)
    fields = ("frame.time_epoch", "can.id", "can.len", "data.data")
    output = subprocess.run(
        ["tshark", "-r", tmp_path / "run.log", "-T", "fields", *chain(*(("-e", name) for name in fields))],
        capture_output=True,
        check=True,
        text=True,
    ).stdout
    recorded = can_frames(read_with_traffic(on_can)[1].sensor)
    exported = [line.split("\t")[1:] for line in output.splitlines()]
    assert exported == [
        [str(one.frame.identifier), str(len(one.frame.data)), one.frame.data.hex()] for one in recorded
    ]


@pytest.mark.skipif(shutil.which("log2asc") is None, reason="can-utils are not installed")
def test_candump_log_is_readable_by_log2asc(on_can: Path, tmp_path: Path) -> None:
    export(on_can, ("candump",), tmp_path)
    command = ["log2asc", "-I", str(tmp_path / "run.log"), "can0"]
    output = subprocess.run(command, capture_output=True, check=True, text=True).stdout
    rows = [line.split() for line in output.splitlines() if " Rx " in line]
    recorded = can_frames(read_with_traffic(on_can)[1].sensor)
    assert [(int(row[2], 16), "".join(row[6:])) for row in rows] == [
        (one.frame.identifier, one.frame.data.hex().upper()) for one in recorded
    ]


def test_can_log_frames_match_recorded_samples(on_can: Path) -> None:
    """Values by the gateway's own layout: 601 holds three forces, little-endian."""
    recording, traffic = read_with_traffic(on_can)
    forces = [
        (one.at, tuple(int.from_bytes(one.frame.data[k : k + 2], "little", signed=True) for k in (0, 2, 4)))
        for one in can_frames(traffic.sensor)
        if one.frame.identifier == 0x601 and not one.sent
    ]
    exported = {values for _, values in forces}
    assert {sample.counts[:3] for sample in recording.sensors} <= exported
    assert len(recording.sensors) <= len(forces) <= len(recording.sensors) + 30


@pytest.mark.parametrize("write", [lambda f: candump(f, ZERO_NS, "vcan7"), lambda f: blf(f, ZERO_NS)])
@pytest.mark.parametrize("at", [0.0, 12345.678901])
def test_can_log_unusual_frames_are_complete(
    tmp_path: Path, write: Callable[[Sequence[WireFrame]], bytes], at: float
) -> None:
    frames = [WireFrame(at + k / 1000, k % 2 == 0, frame) for k, frame in enumerate(ODD)]
    data = write(frames)
    path = tmp_path / ("odd.log" if data.startswith(b"(") else "odd.blf")
    path.write_bytes(data)
    exported = read_back(path)
    assert [frame for _, _, frame in exported] == list(ODD)
    if path.suffix == ".blf":
        assert [sent for _, sent, _ in exported] == [True, False, True, False]
    assert [when for when, _, _ in exported] == pytest.approx(
        [ZERO_NS / 1e9 + one.at for one in frames], abs=RESOLUTION_S
    )


def test_can_log_bus_error_has_candump_format() -> None:
    error = CanFrame(0x4, bytes([0, 0x11, 0, 0, 0, 0, 0, 0]), error=True)
    assert candump([WireFrame(0.0, False, error)], 0, "can0") == (
        b"(0.000000) can0 20000004#0011000000000000\n"
    )
    (message,) = can.BLFReader(io.BytesIO(blf([WireFrame(0.0, False, error)], ZERO_NS)))
    assert from_message(message, 0.0) == error


def test_can_log_is_in_order_of_time() -> None:
    record = WireRecord(10.0, "sensor", ("0.000000 tx 401#", "-0.000500 rx 601#01 681#02", "0.1 -- told"))
    frames = can_frames([record])
    assert [(one.sent, str(one.frame)) for one in frames] == [
        (False, "601#01"),
        (False, "681#02"),
        (True, "401#"),
    ]


def test_export_of_same_recording_is_identical(
    on_can: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    export(on_can, (), tmp_path / "a")
    monkeypatch.setattr(
        can.ASCWriter, "_format_header_datetime", lambda self, at: "Mon Jan 1 00:00:00.0 2024"
    )
    frames = [WireFrame(0.0, False, ODD[0])]
    assert asc(frames, ZERO_NS).splitlines()[0] == b"date Mon Jan 1 00:00:00.0 2024"
    monkeypatch.undo()
    export(on_can, (), tmp_path / "b")
    names = sorted(path.name for path in (tmp_path / "a").iterdir())
    expected = ["run.asc", "run.blf", "run.cycle.csv", "run.log", "run.robot.txt", "run.sensor.csv"]
    assert names == expected
    for name in names:
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


# --- bytes


def test_exported_link_capture_is_readable_by_monitor(on_can: Path, tmp_path: Path) -> None:
    export(on_can, ("bytes",), tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["run.robot.txt"]
    records, _ = read_link(on_can)
    expected = list(link_pieces(records, "run"))
    exported = list(parse_capture((tmp_path / "run.robot.txt").read_text(), "capture"))
    assert [(one.sender, one.data) for one in exported] == [(one.sender, one.data) for one in expected]
    assert [one.at for one in exported] == pytest.approx([one.at for one in expected], abs=2e-6)
    lines = CliRunner().invoke(cli, ["monitor", str(tmp_path / "run.robot.txt")])
    of_record = CliRunner().invoke(cli, ["monitor", str(on_can)])
    assert lines.exit_code == 0
    assert lines.output.splitlines()[-1] == of_record.output.splitlines()[-1]


def test_export_contains_bytes_of_non_can_sensor(on_bytes: Path, tmp_path: Path) -> None:
    export(on_bytes, (), tmp_path)
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == ["run.cycle.csv", "run.robot.txt", "run.sensor.csv", "run.sensor.txt"]
    _, traffic = read_with_traffic(on_bytes)
    expected = [piece.split()[1:] for record in traffic.sensor for piece in record.pieces]
    lines = (tmp_path / "run.sensor.txt").read_text().splitlines()
    exported = [line.split(maxsplit=2)[1:] for line in lines if not line.startswith("#")]
    assert [[who, data.replace(" ", "").lower()] for who, data in exported] == expected


def test_exported_datagrams_have_one_line_each() -> None:
    record = LinkRecord(1.0, ("0.000000 rx 1002 ff", "0.004000 -- a line\nof text", "0.003999 tx 05"))
    exported = wire_text([record], "x")
    assert exported.pieces == 3
    assert exported.text.splitlines()[2:] == [
        "1.000000 rx 10 02",
        "1.000000 rx FF",
        "# 1.004000 a line of text",
        "1.004000 tx 05",
    ]


# --- tables


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_cycle_table_contains_every_field(on_can: Path, tmp_path: Path) -> None:
    export(on_can, ("csv",), tmp_path)
    exported, cycles = rows(tmp_path / "run.cycle.csv"), read(on_can).cycles
    assert len(exported) == len(cycles) > 20
    for row, cycle in zip(exported, cycles, strict=True):
        assert float(row["time_s"]) == cycle.controlled_at
        assert (row["phase"], row["verdict"], int(row["cycle"])) == (cycle.phase, cycle.verdict, cycle.cycle)
        assert row["reasons"] == "; ".join(cycle.reasons)
        assert (float(row["force"]), row["held"]) == (cycle.force, str(cycle.held))
        assert (float(row["stiffness"]) if row["stiffness"] else None) == cycle.stiffness
        assert tuple(float(row[f"wrench_{axis}"]) for axis in AXES) == cycle.sample.wrench
        assert tuple(float(row[f"quaternion_{axis}"]) for axis in "wxyz") == cycle.sample.quaternion
        assert tuple(float(row[f"position_{axis}"]) for axis in "xyz") == cycle.sample.position
        assert (float(row["sample_force"]), row["sample_held"]) == (
            cycle.sample.force,
            str(cycle.sample.held),
        )
        assert float(row["explanation_feedback_m"]) == cycle.explanation["feedback_m"]
    fields = {*CycleRecord.__struct_fields__, *Sample.__struct_fields__} - {"sample"}
    assert {name.split("_")[0] for name in fields} <= {name.split("_")[0] for name in exported[0]}


def test_cycle_table_columns_match_arrays(on_can: Path) -> None:
    recording = hil_bridge.read(on_can)
    assert list(cycle_table(recording.cycles)) == [
        "time_s",
        *(name for name in recording.arrays.flat() if name != "time"),
    ]


def test_sensor_table_contains_raw_values_and_newtons(on_can: Path, tmp_path: Path) -> None:
    export(on_can, ("csv",), tmp_path)
    recording = read(on_can)
    facts = devices_of(recording).sensor.facts
    assert facts is not None
    exported = rows(tmp_path / "run.sensor.csv")
    assert len(exported) == len(recording.sensors) > 500
    for row, sample in zip(exported, recording.sensors, strict=True):
        assert (float(row["time_s"]), int(row["sequence"])) == (sample.at, sample.sequence)
        assert tuple(int(row[f"counts_{axis}"]) for axis in AXES) == sample.counts
        expected = tuple(value * scale for value, scale in zip(sample.counts, facts.scales, strict=True))
        assert tuple(float(row[f"wrench_{axis}"]) for axis in AXES) == expected


def test_unknown_value_is_empty_cell() -> None:
    table = sensor_table([SensorRecord(1.0, 2, (math.nan, 1, 2, 3, 4, -5))], None)
    assert as_csv(table).decode().splitlines() == [
        "time_s,sequence,counts_fx,counts_fy,counts_fz,counts_mx,counts_my,counts_mz",
        "1.0,2,,1,2,3,4,-5",
    ]


def test_table_with_too_many_columns_is_refused(on_can: Path) -> None:
    from msgspec.structs import replace

    (cycle, *_) = read(on_can).cycles
    odd = replace(cycle, explanation={f"name {k}": 0.0 for k in range(COLUMNS_MAX)})
    with pytest.raises(ConfigError, match="reduce the explanation values"):
        cycle_table([odd])


def test_parquet_and_csv_have_same_contents(on_can: Path, tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    export(on_can, ("csv", "parquet"), tmp_path)
    for name in ("cycle", "sensor"):
        columns = parquet.read_table(tmp_path / f"run.{name}.parquet").to_pydict()
        exported = rows(tmp_path / f"run.{name}.csv")
        assert [*columns] == [*exported[0]]
        for column, values in columns.items():
            assert ["" if one is None else str(one) for one in values] == [row[column] for row in exported]


def test_parquet_without_pyarrow_is_refused_in_one_line(
    on_can: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(
        ConfigError, match=r"Parquet needs the package pyarrow; pip install .*, or export csv"
    ):
        export(on_can, ("csv", "parquet"), tmp_path / "out")
    assert not (tmp_path / "out").exists()


# --- what an operator may do wrong


def test_export_writes_next_to_recording_without_overwriting(on_can: Path, tmp_path: Path) -> None:
    path = tmp_path / "one.mcap"
    path.write_bytes(on_can.read_bytes())
    result = CliRunner().invoke(cli, ["export", str(path), "--to", "candump, csv", "--channel", "vcan3"])
    assert result.exit_code == 0, result.output
    *files, zero = result.output.splitlines()
    assert [line.partition(":")[0] for line in files] == [
        str(tmp_path / f"one{end}") for end in (".log", ".cycle.csv", ".sensor.csv")
    ]
    assert zero == "the run's clock was 0 at UNIX time 1599992080.700000"
    assert " vcan3 " in (tmp_path / "one.log").read_text()
    (tmp_path / "one.log").write_text("mine")
    (tmp_path / "one.cycle.csv").unlink()
    again = CliRunner().invoke(cli, ["export", str(path), "--to", "csv,candump"], standalone_mode=False)
    assert isinstance(again.exception, ConfigError)
    assert "already exists; name another file, or give --overwrite" in str(again.exception)
    assert (tmp_path / "one.log").read_text() == "mine"
    assert not (tmp_path / "one.cycle.csv").exists()
    assert CliRunner().invoke(cli, ["export", str(path), "--overwrite"]).exit_code == 0
    assert (tmp_path / "one.log").read_text() != "mine"


@pytest.mark.parametrize("name", ["candump", "blf", "asc"])
def test_export_can_log_of_non_can_sensor_is_refused(on_bytes: Path, tmp_path: Path, name: str) -> None:
    with pytest.raises(ConfigError) as caught:
        export(on_bytes, (name,), tmp_path)
    assert str(caught.value) == (
        f"cannot export {on_bytes}: it has no CAN frames, because its sensor (jr3-uart) is not on CAN; "
        "give --to bytes or csv"
    )


def test_export_of_version_0_1_0_is_refused_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"^[^\n]+; 0\.6 is the last version that reads it$"):
        export(OLD, (), tmp_path)
    assert not [*tmp_path.iterdir()]


def test_export_of_cut_off_recording_is_partial(on_can: Path, tmp_path: Path) -> None:
    path = tmp_path / "cut.mcap"
    data = on_can.read_bytes()
    path.write_bytes(data[: len(data) * 3 // 4])
    lines = export(path, ("candump",), tmp_path)
    assert "ends early or is damaged: what came before is exported" in lines[1]
    assert len(read_back(tmp_path / "cut.log")) > 100


@pytest.mark.parametrize(
    "piece", ["0.0 rx 601#0", "0.0 rx 6#01", "x rx 601#", "0.0 up 601#", "0.0 rx 601#01 zz"]
)
def test_export_of_invalid_traffic_is_refused_in_one_line(piece: str) -> None:
    with pytest.raises(
        ConfigError, match=r"is not a (CAN frame|piece of a wire's traffic).*record the run again"
    ):
        can_frames([WireRecord(1.0, "sensor", (piece,))])
    with pytest.raises(ConfigError, match="is not a piece"):
        can_frames([WireRecord(math.inf, "sensor", ("0.0 rx 601#",))])


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (
            ["--to", "candump,xls"],
            "'xls' is not a format; choose from candump,blf,asc,dbc,bytes,csv,parquet,rosbag2,mf4,layouts",
        ),
        (["--channel", "a b"], "is not the name of a CAN interface"),
        (["--output", "\0"], "a path must not contain a NUL character"),
    ],
)
def test_export_command_refuses_invalid_options(on_can: Path, arguments: list[str], text: str) -> None:
    result = CliRunner().invoke(cli, ["export", str(on_can), *arguments], standalone_mode=False)
    assert text in str(result.exception)


def test_export_command_lists_every_format() -> None:
    assert tuple(FORMATS) == FORMAT_NAMES
