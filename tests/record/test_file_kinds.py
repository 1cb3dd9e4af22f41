"""Known files passed to the wrong reader: one line names the kind of file and the command that reads it."""

import codecs
import os
import sqlite3
from pathlib import Path

import pytest
from click.testing import CliRunner

from hil_bridge.cli import cli
from hil_bridge.errors import ConfigError
from hil_bridge.errors.file_kinds import HEAD_BYTES, describe_content, refuse_table
from hil_bridge.record import read
from hil_bridge.settings.configuration import load_config
from tests.record.written_recordings import stream, write

FILES: dict[str, tuple[bytes, str, str]] = {
    "drive.bag": (b"#ROSBAG V2.0\n\x45\0\0\0\x08\0\0\0", "a bag of ROS 1", "`rosbags-convert --src"),
    "RSI.xml": (
        b'<?xml version="1.0"?>\r\n<!-- cell 4 -->\r\n<ROOT><CONFIG><IP_NUMBER>192.168.1.10</IP_NUMBER>'
        b"<PORT>49152</PORT><SENTYPE>ImFree</SENTYPE>",
        "KUKA's Ethernet configuration of RSI",
        "`hil-bridge doctor CONFIG.toml FILE`",
    ),
    "flow.rsi.xml": (b'<rSIModel xmlns:dm0="x">', "a signal flow of KUKA's RSI", "[robot.rsi]"),
    "console.txt": (
        b"  can0  123   [8]  11 22 33 44 55 66 77 88\n",
        "a log of candump",
        "`hil-bridge monitor",
    ),
    "extra.txt": (b" (012.3)  vcan0  RX - -  123   [1]  11\n", "a log of candump", "`hil-bridge decode"),
    "can.log": (b"(1436509052.249713) can0 123#1122\n", "a log of candump", "`hil-bridge monitor"),
    "arm.urdf": (
        b'\n<?xml version="1.0"?><robot name="ur5">',
        "a robot description (URDF)",
        "`hil-bridge config",
    ),
    "FT1234.cal": (
        b'<?xml version="1.0" encoding="utf-8"?>\n<FTSensor SerialNumber="FT1234">',
        "a calibration of an ATI sensor",
        "`factor`",
    ),
    "press.src": (
        b"&ACCESS RVP\r\n&REL 3\r\nDEF press( )\r\n",
        "a KUKA program (KRL)",
        "--robot rsi+udp-bind",
    ),
    "plain.src": (b"; made by hand\nDEF press(a:IN)\n", "a KUKA program (KRL)", "--robot rsi+udp-bind"),
    "egm.mod": (
        b"%%%\n  VERSION:1\n  LANGUAGE:ENGLISH\n%%%\n\nMODULE egm\n",
        "an ABB program module (RAPID)",
        "--robot egm+udp-bind",
    ),
    "small.mod": (b"! comment\nModule egm(SYSMODULE)\n", "an ABB program module (RAPID)", "--robot egm"),
    "push.script": (
        b"# push\ndef push():\n  movej(p)\nend\n",
        "a URScript program",
        "cell.rtde.program_folder",
    ),
    "log.xlsx": (b"PK\x03\x04\x14\0", "a ZIP archive", "as CSV"),
    "log.mat": (b"MATLAB 5.0 MAT-file, Platform", "a binary table", "as CSV"),
    "log.blf": (b"LOGG\x90\0\0\0", "a CAN log in BLF", "`can_logconvert"),
}


@pytest.mark.parametrize("name", FILES)
def test_readers_identify_known_file_kinds(tmp_path: Path, name: str) -> None:
    content, what, advice = FILES[name]
    file, mapping = tmp_path / name, tmp_path / "map.toml"
    file.write_bytes(content)
    mapping.write_text('[time]\ncolumn = "t"\n[columns]\npress = { columns = ["f"], unit = "N" }\n')
    for arguments in (
        ["run", str(file), "--virtual"],
        ["report", str(file)],
        ["view", str(file)],
        ["identify", "cell", str(file)],
        ["identify", "cell", str(file), "--columns", str(mapping)],
        ["identify", "tool", "--from", str(file)],
    ):
        error = CliRunner().invoke(cli, arguments).exception
        assert isinstance(error, ConfigError), arguments
        assert f"{name} is {what}" in str(error), arguments
        assert advice in str(error)
        assert "\n" not in str(error)
    if "candump" not in what:
        error = CliRunner().invoke(cli, ["monitor", str(file)]).exception
        assert f"{name} is {what}" in str(error)


def test_utf_16_text_is_identified(tmp_path: Path) -> None:
    file = tmp_path / "arm.urdf"
    file.write_text('<robot name="ur5">', encoding="utf-16")
    with pytest.raises(ConfigError, match="is a robot description"):
        load_config(file, {})


def test_recording_used_as_configuration_is_identified(tmp_path: Path) -> None:
    path = write(tmp_path / "run.mcap", stream())
    for arguments in (["run", str(path)], ["list", "facts", str(path)], ["doctor", str(path)]):
        error = CliRunner().invoke(cli, arguments).exception
        assert isinstance(error, ConfigError), arguments
        assert "run.mcap is a recording of a run; `hil-bridge view`" in str(error)


def test_large_recording_as_configuration_is_identified(tmp_path: Path) -> None:
    path = write(tmp_path / "run.mcap", stream())
    os.truncate(path, 1 << 30)
    with pytest.raises(ConfigError, match=r"run\.mcap is a recording of a run"):
        load_config(path, {})


def test_results_used_as_recording_are_identified(tmp_path: Path) -> None:
    path = tmp_path / "results.mcap"
    with sqlite3.connect(path) as results:
        results.execute("create table a (b)")
    with pytest.raises(ConfigError, match=r"results\.mcap is an SQLite database; `hil-bridge view`"):
        read(path)


@pytest.mark.parametrize(
    "head",
    [
        b"",
        b"[run]\nseed = 1\n",
        b"# a comment\n[sensor]\n",
        b"time,force\n0,1\n",
        b"0.013402 S3 06\n",
        b"0 PC 1002 # begin\n",
        b"module = 3\n",
        b"def = 1\n",
        b"<",
        b"<!--" * 2000,
        b"<?" * 3000,
        b"# " * HEAD_BYTES,
        b"\xff\xfe",
        b"(" * HEAD_BYTES,
    ],
)
def test_unknown_file_is_not_misidentified(head: bytes) -> None:
    assert describe_content(head) == ""


TABLES = [
    b"time,force\n0,1\n",
    b"Messung vom 3.4.2026\r\nZeit [s];Fx [N]\r\n0,000;-0,0644\r\n",
    b"\xef\xbb\xbf# cell 4\nt\tfx\tfy\n 1e-3\t 2.5\t-3\n",
    b'"0.1","2"\n',
    codecs.BOM_UTF16_LE + "t;f\n0;1\n".encode("utf-16-le"),
]


@pytest.mark.parametrize("content", TABLES)
@pytest.mark.parametrize("command", ["run", "report", "view", "why", "identify cell", "doctor"])
def test_table_passed_to_other_reader_is_identified(tmp_path: Path, command: str, content: bytes) -> None:
    file = tmp_path / "force.csv"
    file.write_bytes(content)
    error = CliRunner().invoke(cli, [*command.split(), str(file)]).exception
    assert isinstance(error, ConfigError)
    assert "force.csv is a text table; `hil-bridge identify fidelity` and `identify cell`" in str(error)


@pytest.mark.parametrize("command", ["report", "view", "why"])
def test_configuration_used_as_recording_is_identified(tmp_path: Path, command: str) -> None:
    file = tmp_path / "cell.toml"
    file.write_text("[run]\nseed = 1\n")
    error = CliRunner().invoke(cli, [command, str(file)]).exception
    assert isinstance(error, ConfigError)
    assert str(error).endswith("cell.toml is a TOML file; `hil-bridge run` takes a configuration")


@pytest.mark.parametrize(
    "head",
    [
        b"[run]\nx = [\n  1.0, 2.0,\n  3.0, 4.0\n",
        b"x = [\n1, 2\n",
        b"0.013402 S3 06\n",
        b"1," * HEAD_BYTES,
        b"\n" * HEAD_BYTES,
    ],
)
def test_text_with_assignment_is_not_a_table(head: bytes) -> None:
    refuse_table("file", head)
