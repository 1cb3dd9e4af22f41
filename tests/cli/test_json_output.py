"""`--json` of the commands: the values of their tables, and nothing else on standard output."""

import json
import shutil
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

from hil_bridge.cli import cli
from hil_bridge.devices.robots.probe import ProbeResult
from hil_bridge.errors.causes import Cause
from hil_bridge.record import read
from hil_bridge.record.analysis.latency import latency_of
from hil_bridge.record.analysis.summary import summarise
from hil_bridge.site import doctor, facts
from hil_bridge.site.robot_probe import probe_values
from protocol.endpoint import Trouble
from tests.near_surface import EMERGENCY_STOP, WHOLE, merged
from tests.recordings import Recordings


@pytest.fixture
def stopped(recordings: Recordings, tmp_path: Path) -> Path:
    """Return a recording of a run that an emergency stop ended."""
    recording = recordings.path(WHOLE, faults=[EMERGENCY_STOP])
    return Path(shutil.copy(recording, tmp_path / "stopped.mcap"))


def json_of(*arguments: object, code: int = 0) -> Any:
    """Return the JSON that a command prints."""
    ended = CliRunner().invoke(cli, [*map(str, arguments), "--json"], catch_exceptions=False)
    assert ended.exit_code == code, ended.output
    return json.loads(ended.stdout)


def text(*arguments: object) -> str:
    return CliRunner().invoke(cli, [*map(str, arguments)], catch_exceptions=False).stdout


def test_why_json_has_values_of_text(stopped: Path) -> None:
    values = json_of("why", stopped)
    assert values["outcome"] == "stopped"
    assert values["cause"] == Cause.ROBOT_STATE.value
    assert values["text"] == text("why", stopped).splitlines()[0]
    assert f"{values['after_s']:.2f} s after its start, in the phase {values['phase']}" in values["text"]
    good = values["last_good"]
    assert f"number {good['cycle']}, {good['before_s']:.2f} s before that" in values["text"]
    assert f"{good['force_n']:.1f} N at a depth of {good['depth_mm']:.1f} mm" in values["text"]
    assert (
        f"{values['first_symptom']['before_s']:.2f} s before that: {values['first_symptom']['text']}"
        in values["text"]
    )
    assert values["cycles"] == len(read(stopped).cycles)
    assert values["retracted"] is False
    assert values["promises_broken"] == []


def test_why_json_of_completed_run_has_no_symptom(recordings: Recordings) -> None:
    values = json_of("why", recordings.path(WHOLE))
    assert (values["outcome"], values["cause"], values["fact"]) == ("completed", Cause.TIME_IS_UP.value, "")
    assert values["retracted"] is True
    assert values["first_symptom"] is None


def test_latency_json_has_every_hop(stopped: Path) -> None:
    values, latency = json_of("latency", stopped), latency_of(read(stopped))
    assert latency is not None
    assert [row["hop"] for row in values["chain"]] == [part.hop.name for part in latency.chain]
    assert [row["whose"] for row in values["chain"]] == [part.hop.owner.value for part in latency.chain]
    assert {row["hop"]: row["p99_ms"] for row in values["chain"]} == {
        part.hop.name: part.times.as_ms()["p99_ms"] for part in latency.chain
    }
    assert values["total"] == latency.total.as_ms()
    assert values["largest"] == latency.largest.hop.name


def test_compare_json_has_figures_and_settings(stopped: Path, recordings: Recordings, tmp_path: Path) -> None:
    other = tmp_path / "other.mcap"
    shutil.copy(recordings.path(merged(WHOLE, {"task": {"force_n": 8.0}})), other)
    values = json_of("compare", stopped, other)
    for name, path in (("stopped", stopped), ("other", other)):
        summary = summarise(read(path))
        figures = {**summary.figures, **summary.response, **summary.contact}
        assert values["runs"][name] == {"outcome": summary.outcome, **figures}
    assert values["settings"]["task.force_n"] == {"stopped": "10", "other": "8"}
    assert not Path("compare.html").exists()


def test_doctor_json_has_row_for_each_line(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(doctor, "wake_ups", lambda realtime: facts.ok("wake-ups", "on time"))
    file = tmp_path / "site.toml"
    file.write_text('[robot]\nurl = "s3+serial:///dev/ttyUSB99"\n')
    values = json_of("doctor", file, code=3)
    assert values["can_work"] is False
    row = next(one for one in values["facts"] if one["subject"] == "robot.url" and one["level"] == "fail")
    assert row["text"].startswith("serial port /dev/ttyUSB99: no such port")
    rest = json_of("doctor")
    assert rest["can_work"] is True
    assert len(rest["facts"]) == len(text("doctor").splitlines())


def test_probe_json_has_refusals() -> None:
    values = probe_values(
        ProbeResult((("robot", "UR5e"), ("state", "off")), (Trouble("the arm is off", "switch it on"),))
    )
    assert values == {
        "would_begin": False,
        "rows": [{"name": "robot", "text": "UR5e"}, {"name": "state", "text": "off"}],
        "refusals": [{"fact": "the arm is off", "remedy": "switch it on"}],
    }
    assert probe_values(ProbeResult((("robot", "UR5e"),)))["would_begin"] is True
