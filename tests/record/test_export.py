"""A recording in the formats of other programs, read back by their readers."""

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


def made(recordings: Recordings, folder: Path, emulated: str) -> Path:
    """A recording of a run with this sensor, under a name of its own."""
    recording = recordings.path(merged(WHOLE, {"sensor": {"emulated": emulated}}))
    return Path(shutil.copy(recording, folder / "run.mcap"))


@pytest.fixture(scope="module")
def on_can(recordings: Recordings, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return made(recordings, tmp_path_factory.mktemp("gateway"), "jr3")


@pytest.fixture(scope="module")
def on_bytes(recordings: Recordings, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return made(recordings, tmp_path_factory.mktemp("uart"), "jr3-uart")


# --- DBC


@pytest.mark.parametrize("sensor", ["jr3", "ati-can"])
def test_the_dbc_file_decodes_the_frames_of_its_recording(
    sensor: str, recordings: Recordings, tmp_path: Path
) -> None:
    path = made(recordings, tmp_path, sensor)
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
"""A microsecond, and what a UNIX time loses as a floating-point number."""


def read_back(path: Path) -> list[tuple[float, bool, CanFrame | None]]:
    with READERS[path.suffix](path) as reader:
        return [(one.timestamp, not one.is_rx, from_message(one, 0.0)) for one in reader]


@pytest.mark.parametrize("suffix", READERS)
def test_a_log_of_a_run_holds_every_recorded_frame(on_can: Path, tmp_path: Path, suffix: str) -> None:
    export(on_can, ("candump", "blf", "asc"), tmp_path)
    recording, traffic = read_with_traffic(on_can)
    recorded = can_frames(traffic.sensor)
    told = read_back(tmp_path / f"run{suffix}")
    assert len(told) > 1000
    assert [frame for _, _, frame in told] == [one.frame for one in recorded]
    if suffix != ".log":
        assert [sent for _, sent, _ in told] == [one.sent for one in recorded]
        assert {sent for _, sent, _ in told} == {True, False}
    begin = recorded[0].at if suffix == ".asc" else -recording.unix_zero_ns / 1e9
    assert [at for at, _, _ in told] == pytest.approx([one.at - begin for one in recorded], abs=RESOLUTION_S)


def test_candump_log_has_the_form_of_can_utils(on_can: Path, tmp_path: Path) -> None:
    """As candump -l writes it: time, interface and frame, and nothing behind the frame."""
    export(on_can, ("candump",), tmp_path)
    lines = (tmp_path / "run.log").read_text().splitlines()
    assert len(lines) > 1000
    assert all(re.fullmatch(r"\(\d+\.\d{6}\) can0 [0-9A-F]{3}#[0-9A-F]{0,16}", line) for line in lines)


@pytest.mark.skipif(shutil.which("tshark") is None, reason="Wireshark's tshark is not installed")
def test_candump_log_is_read_by_wireshark(on_can: Path, tmp_path: Path) -> None:
    export(on_can, ("candump",), tmp_path)
    fields = ("frame.time_epoch", "can.id", "can.len", "data.data")
    shown = subprocess.run(
        ["tshark", "-r", tmp_path / "run.log", "-T", "fields", *chain(*(("-e", name) for name in fields))],
        capture_output=True,
        check=True,
        text=True,
    ).stdout
    recorded = can_frames(read_with_traffic(on_can)[1].sensor)
    told = [line.split("\t")[1:] for line in shown.splitlines()]
    assert told == [
        [str(one.frame.identifier), str(len(one.frame.data)), one.frame.data.hex()] for one in recorded
    ]


@pytest.mark.skipif(shutil.which("log2asc") is None, reason="can-utils are not installed")
def test_candump_log_is_read_by_log2asc(on_can: Path, tmp_path: Path) -> None:
    export(on_can, ("candump",), tmp_path)
    command = ["log2asc", "-I", str(tmp_path / "run.log"), "can0"]
    shown = subprocess.run(command, capture_output=True, check=True, text=True).stdout
    rows = [line.split() for line in shown.splitlines() if " Rx " in line]
    recorded = can_frames(read_with_traffic(on_can)[1].sensor)
    assert [(int(row[2], 16), "".join(row[6:])) for row in rows] == [
        (one.frame.identifier, one.frame.data.hex().upper()) for one in recorded
    ]


def test_frames_of_a_log_are_the_samples_of_the_record(on_can: Path) -> None:
    """By the gateway's own layout: 601 holds three forces, little-endian."""
    recording, traffic = read_with_traffic(on_can)
    forces = [
        (one.at, tuple(int.from_bytes(one.frame.data[k : k + 2], "little", signed=True) for k in (0, 2, 4)))
        for one in can_frames(traffic.sensor)
        if one.frame.identifier == 0x601 and not one.sent
    ]
    told = {values for _, values in forces}
    assert {sample.counts[:3] for sample in recording.sensors} <= told
    assert len(recording.sensors) <= len(forces) <= len(recording.sensors) + 30


@pytest.mark.parametrize("write", [lambda f: candump(f, ZERO_NS, "vcan7"), lambda f: blf(f, ZERO_NS)])
@pytest.mark.parametrize("at", [0.0, 12345.678901])
def test_odd_frames_are_whole(
    tmp_path: Path, write: Callable[[Sequence[WireFrame]], bytes], at: float
) -> None:
    frames = [WireFrame(at + k / 1000, k % 2 == 0, frame) for k, frame in enumerate(ODD)]
    data = write(frames)
    path = tmp_path / ("odd.log" if data.startswith(b"(") else "odd.blf")
    path.write_bytes(data)
    told = read_back(path)
    assert [frame for _, _, frame in told] == list(ODD)
    if path.suffix == ".blf":
        assert [sent for _, sent, _ in told] == [True, False, True, False]
    assert [when for when, _, _ in told] == pytest.approx(
        [ZERO_NS / 1e9 + one.at for one in frames], abs=RESOLUTION_S
    )


def test_an_error_of_the_bus_is_told_as_candump_tells_it() -> None:
    error = CanFrame(0x4, bytes([0, 0x11, 0, 0, 0, 0, 0, 0]), error=True)
    assert candump([WireFrame(0.0, False, error)], 0, "can0") == (
        b"(0.000000) can0 20000004#0011000000000000\n"
    )
    (back,) = can.BLFReader(io.BytesIO(blf([WireFrame(0.0, False, error)], ZERO_NS)))
    assert from_message(back, 0.0) == error


def test_a_frame_that_came_before_one_that_was_sent_stands_before_it() -> None:
    record = WireRecord(10.0, "sensor", ("0.000000 tx 401#", "-0.000500 rx 601#01 681#02", "0.1 -- told"))
    frames = can_frames([record])
    assert [(one.sent, str(one.frame)) for one in frames] == [
        (False, "601#01"),
        (False, "681#02"),
        (True, "401#"),
    ]


def test_the_same_recording_gives_the_same_files(
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
    wanted = ["run.asc", "run.blf", "run.cycle.csv", "run.log", "run.robot.txt", "run.sensor.csv"]
    assert names == wanted
    for name in names:
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


# --- bytes


def test_bytes_of_a_computer_link_are_a_capture_that_the_monitor_reads(on_can: Path, tmp_path: Path) -> None:
    export(on_can, ("bytes",), tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["run.robot.txt"]
    records, _ = read_link(on_can)
    wanted = list(link_pieces(records, "run"))
    told = list(parse_capture((tmp_path / "run.robot.txt").read_text(), "capture"))
    assert [(one.sender, one.data) for one in told] == [(one.sender, one.data) for one in wanted]
    assert [one.at for one in told] == pytest.approx([one.at for one in wanted], abs=2e-6)
    lines = CliRunner().invoke(cli, ["monitor", str(tmp_path / "run.robot.txt")])
    of_record = CliRunner().invoke(cli, ["monitor", str(on_can)])
    assert lines.exit_code == 0
    assert lines.output.splitlines()[-1] == of_record.output.splitlines()[-1]


def test_bytes_of_a_sensor_that_is_not_on_can_are_told_too(on_bytes: Path, tmp_path: Path) -> None:
    export(on_bytes, (), tmp_path)
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == ["run.cycle.csv", "run.robot.txt", "run.sensor.csv", "run.sensor.txt"]
    _, traffic = read_with_traffic(on_bytes)
    wanted = [piece.split()[1:] for record in traffic.sensor for piece in record.pieces]
    lines = (tmp_path / "run.sensor.txt").read_text().splitlines()
    told = [line.split(maxsplit=2)[1:] for line in lines if not line.startswith("#")]
    assert [[who, data.replace(" ", "").lower()] for who, data in told] == wanted


def test_every_datagram_has_a_line_of_its_own() -> None:
    record = LinkRecord(1.0, ("0.000000 rx 1002 ff", "0.004000 -- a line\nof text", "0.003999 tx 05"))
    told = wire_text([record], "x")
    assert told.pieces == 3
    assert told.text.splitlines()[2:] == [
        "1.000000 rx 10 02",
        "1.000000 rx FF",
        "# 1.004000 a line of text",
        "1.004000 tx 05",
    ]


# --- tables


def rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_a_table_of_cycles_holds_every_field_of_the_record(on_can: Path, tmp_path: Path) -> None:
    export(on_can, ("csv",), tmp_path)
    told, cycles = rows(tmp_path / "run.cycle.csv"), read(on_can).cycles
    assert len(told) == len(cycles) > 20
    for row, cycle in zip(told, cycles, strict=True):
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
    assert {name.split("_")[0] for name in fields} <= {name.split("_")[0] for name in told[0]}


def test_table_of_cycles_has_the_columns_of_the_arrays(on_can: Path) -> None:
    recording = hil_bridge.read(on_can)
    assert list(cycle_table(recording.cycles)) == [
        "time_s",
        *(name for name in recording.arrays.flat() if name != "time"),
    ]


def test_a_table_of_the_sensor_holds_raw_values_and_newtons(on_can: Path, tmp_path: Path) -> None:
    export(on_can, ("csv",), tmp_path)
    recording = read(on_can)
    facts = devices_of(recording).sensor.facts
    assert facts is not None
    told = rows(tmp_path / "run.sensor.csv")
    assert len(told) == len(recording.sensors) > 500
    for row, sample in zip(told, recording.sensors, strict=True):
        assert (float(row["time_s"]), int(row["sequence"])) == (sample.at, sample.sequence)
        assert tuple(int(row[f"counts_{axis}"]) for axis in AXES) == sample.counts
        wanted = tuple(value * scale for value, scale in zip(sample.counts, facts.scales, strict=True))
        assert tuple(float(row[f"wrench_{axis}"]) for axis in AXES) == wanted


def test_what_is_not_known_is_an_empty_cell() -> None:
    table = sensor_table([SensorRecord(1.0, 2, (math.nan, 1, 2, 3, 4, -5))], None)
    assert as_csv(table).decode().splitlines() == [
        "time_s,sequence,counts_fx,counts_fy,counts_fz,counts_mx,counts_my,counts_mz",
        "1.0,2,,1,2,3,4,-5",
    ]


def test_a_controller_with_too_many_names_is_refused(on_can: Path) -> None:
    from msgspec.structs import replace

    (cycle, *_) = read(on_can).cycles
    odd = replace(cycle, explanation={f"name {k}": 0.0 for k in range(COLUMNS_MAX)})
    with pytest.raises(ConfigError, match="too many names"):
        cycle_table([odd])


def test_parquet_holds_what_the_csv_holds(on_can: Path, tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    export(on_can, ("csv", "parquet"), tmp_path)
    for name in ("cycle", "sensor"):
        columns = parquet.read_table(tmp_path / f"run.{name}.parquet").to_pydict()
        told = rows(tmp_path / f"run.{name}.csv")
        assert [*columns] == [*told[0]]
        for column, values in columns.items():
            assert ["" if one is None else str(one) for one in values] == [row[column] for row in told]


def test_without_pyarrow_parquet_is_refused_in_one_line(
    on_can: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(
        ConfigError, match=r"Parquet needs the package pyarrow; pip install .*, or export csv"
    ):
        export(on_can, ("csv", "parquet"), tmp_path / "out")
    assert not (tmp_path / "out").exists()


# --- what an operator may do wrong


def test_the_command_writes_beside_the_recording_and_keeps_what_is_there(
    on_can: Path, tmp_path: Path
) -> None:
    path = tmp_path / "one.mcap"
    path.write_bytes(on_can.read_bytes())
    done = CliRunner().invoke(cli, ["export", str(path), "--to", "candump, csv", "--channel", "vcan3"])
    assert done.exit_code == 0, done.output
    *files, zero = done.output.splitlines()
    assert [line.partition(":")[0] for line in files] == [
        str(tmp_path / f"one{end}") for end in (".log", ".cycle.csv", ".sensor.csv")
    ]
    assert zero == "the run's clock was 0 at UNIX time 1599992080.700000"
    assert " vcan3 " in (tmp_path / "one.log").read_text()
    (tmp_path / "one.log").write_text("mine")
    (tmp_path / "one.cycle.csv").unlink()
    again = CliRunner().invoke(cli, ["export", str(path), "--to", "csv,candump"], standalone_mode=False)
    assert isinstance(again.exception, ConfigError)
    assert "is there already; name another file, or give --overwrite" in str(again.exception)
    assert (tmp_path / "one.log").read_text() == "mine"
    assert not (tmp_path / "one.cycle.csv").exists()
    assert CliRunner().invoke(cli, ["export", str(path), "--overwrite"]).exit_code == 0
    assert (tmp_path / "one.log").read_text() != "mine"


@pytest.mark.parametrize("name", ["candump", "blf", "asc"])
def test_a_sensor_that_is_not_on_can_has_no_can_log(on_bytes: Path, tmp_path: Path, name: str) -> None:
    with pytest.raises(ConfigError) as caught:
        export(on_bytes, (name,), tmp_path)
    assert str(caught.value) == (
        f"cannot export {on_bytes}: it holds no CAN frames, for its sensor (jr3-uart) is not on CAN; "
        "give --to bytes or csv"
    )


def test_a_recording_of_version_0_1_0_is_refused_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"^[^\n]+; 0\.6 is the last version that reads it$"):
        export(OLD, (), tmp_path)
    assert not [*tmp_path.iterdir()]


def test_a_recording_that_was_cut_off_is_exported_as_far_as_it_goes(on_can: Path, tmp_path: Path) -> None:
    path = tmp_path / "cut.mcap"
    data = on_can.read_bytes()
    path.write_bytes(data[: len(data) * 3 // 4])
    lines = export(path, ("candump",), tmp_path)
    assert "ends early or is damaged: what came before is exported" in lines[1]
    assert len(read_back(tmp_path / "cut.log")) > 100


@pytest.mark.parametrize(
    "piece", ["0.0 rx 601#0", "0.0 rx 6#01", "x rx 601#", "0.0 up 601#", "0.0 rx 601#01 zz"]
)
def test_a_wire_that_makes_no_sense_is_refused_in_one_line(piece: str) -> None:
    with pytest.raises(
        ConfigError, match=r"is no (CAN frame|piece of a wire's traffic).*record the run again"
    ):
        can_frames([WireRecord(1.0, "sensor", (piece,))])
    with pytest.raises(ConfigError, match="is no piece"):
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
def test_what_the_command_cannot_take(on_can: Path, arguments: list[str], text: str) -> None:
    done = CliRunner().invoke(cli, ["export", str(on_can), *arguments], standalone_mode=False)
    assert text in str(done.exception)


def test_the_command_knows_every_format() -> None:
    assert tuple(FORMATS) == FORMAT_NAMES
