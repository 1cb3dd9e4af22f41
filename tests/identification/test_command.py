"""`hil-bridge identify cell` on the command line: text, JSON, profile, and errors."""

import json
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from hil_bridge.cli import cli
from hil_bridge.errors import ConfigError
from hil_bridge.lab.identification.values import Part, Why
from tests.recordings import Recordings
from tools.identified_cells import CELLS, cell

S3 = CELLS.index(("s3", "jr3"))
MAPPING = """\
[time]
column = "t"
unit = "s"
[columns]
position = { columns = ["x", "y", "z"], unit = "mm" }
depth = { columns = ["z"], unit = "mm", sign = -1 }
press = { columns = ["fz"], unit = "N" }
"""


@pytest.fixture
def site(recordings: Recordings) -> Path:
    return recordings.path(cell(S3))


def identify(*arguments: object) -> Result:
    return CliRunner().invoke(cli, ["identify", "cell", *map(str, arguments)])


@pytest.mark.full
def test_text_has_interval_or_reason_for_each_value(site: Path) -> None:
    result = identify(site)
    assert result.exit_code == 0
    assert [line for line in result.output.splitlines() if line in set(Part)] == list(Part)
    (stiffness,) = (line for line in result.output.splitlines() if "stiffness of the contact" in line)
    assert stiffness.count("N/m") == 2
    assert "…" in stiffness
    assert Why.BEHIND_DELAY in result.output


@pytest.mark.full
def test_json_has_null_for_unidentified_values(site: Path) -> None:
    values = {value["key"]: value for value in json.loads(identify(site, "--json").stdout)["values"]}
    assert values["surface.damping"]["value"] is None
    assert values["surface.damping"]["why"] == Why.BEHIND_DELAY
    friction = values["surface.friction"]
    assert friction["low"] < friction["value"] < friction["high"]
    assert friction["why"] is None
    assert friction["method"]
    assert friction["interval"]


@pytest.mark.full
def test_profile_runs_and_is_not_overwritten(site: Path, tmp_path: Path) -> None:
    profile = tmp_path / "profile.toml"
    assert identify(site, "-o", profile).exit_code == 0
    arguments = ["run", str(profile), "--virtual", "--duration", "0.5", "--no-record"]
    result = CliRunner().invoke(cli, arguments)
    assert "completed" in result.output, result.output
    before = profile.read_text(encoding="utf-8")
    refused = identify(site, "-o", profile)
    assert isinstance(refused.exception, ConfigError)
    assert profile.read_text(encoding="utf-8") == before


def test_identify_command_refuses_unusable_input(site: Path, tmp_path: Path) -> None:
    table = tmp_path / "log.csv"
    table.write_text("t,x,y,z,fz\n" + "".join(f"{k * 0.01},0,0,0,nan\n" for k in range(100)))
    mapping = tmp_path / "columns.toml"
    mapping.write_text(MAPPING)
    half = tmp_path / "half.mcap"
    half.write_bytes(site.read_bytes()[:200])
    for arguments in (
        (table,),
        (half,),
        (tmp_path / "none.mcap",),
        (table, "--columns", mapping),
        (site, "--between", 0, 1),
    ):
        result = identify(*arguments)
        assert isinstance(result.exception, ConfigError), arguments
        assert len(str(result.exception).splitlines()) == 1


def test_truncated_recording_is_identified(site: Path, tmp_path: Path) -> None:
    cut = tmp_path / "cut.mcap"
    data = site.read_bytes()
    cut.write_bytes(data[: len(data) * 2 // 3])
    result = identify(cut, "--json")
    assert result.exit_code == 0, result.output
    values = {value["key"]: value for value in json.loads(result.stdout)["values"]}
    assert values["robot.turnaround.move"]["value"] == pytest.approx(
        cell(S3)["cell"]["s3"]["robot"]["turnaround_ms"] * 1e-3, rel=0.1
    )
    assert values["line.robot.damaged"]["why"] == Why.NO_COUNTERS


def test_stationary_table_identifies_no_surface(tmp_path: Path) -> None:
    table, mapping = tmp_path / "log.csv", tmp_path / "columns.toml"
    table.write_text("t,x,y,z,fz\n" + "".join(f"{k * 0.01},0,0,0,0\n" for k in range(200)))
    mapping.write_text(MAPPING)
    values = json.loads(identify(table, "--columns", mapping, "--json").stdout)["values"]
    assert {value["why"] is None for value in values if value["part"] == "surface"} == {False}
