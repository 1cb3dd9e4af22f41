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
    """A recording of a run that an emergency stop ended."""
    recording = recordings.path(WHOLE, faults=[EMERGENCY_STOP])
    return Path(shutil.copy(recording, tmp_path / "stopped.mcap"))


def told(*arguments: object, code: int = 0) -> Any:
    """The JSON that a command prints."""
    ended = CliRunner().invoke(cli, [*map(str, arguments), "--json"], catch_exceptions=False)
    assert ended.exit_code == code, ended.output
    return json.loads(ended.stdout)


def text(*arguments: object) -> str:
    return CliRunner().invoke(cli, [*map(str, arguments)], catch_exceptions=False).stdout


def test_why_has_the_values_of_its_paragraph(stopped: Path) -> None:
    found = told("why", stopped)
    assert found["outcome"] == "stopped"
    assert found["cause"] == Cause.ROBOT_STATE.value
    assert found["text"] == text("why", stopped).splitlines()[0]
    assert f"{found['after_s']:.2f} s after its start, in the phase {found['phase']}" in found["text"]
    good = found["last_good"]
    assert f"number {good['cycle']}, {good['before_s']:.2f} s before that" in found["text"]
    assert f"{good['force_n']:.1f} N at a depth of {good['depth_mm']:.1f} mm" in found["text"]
    assert (
        f"{found['first_symptom']['before_s']:.2f} s before that: {found['first_symptom']['text']}"
        in found["text"]
    )
    assert found["cycles"] == len(read(stopped).cycles)
    assert found["retracted"] is False
    assert found["promises_broken"] == []


def test_why_of_a_completed_run_tells_no_symptom(recordings: Recordings) -> None:
    found = told("why", recordings.path(WHOLE))
    assert (found["outcome"], found["cause"], found["fact"]) == ("completed", Cause.TIME_IS_UP.value, "")
    assert found["retracted"] is True
    assert found["first_symptom"] is None


def test_latency_has_every_hop_of_its_table(stopped: Path) -> None:
    found, latency = told("latency", stopped), latency_of(read(stopped))
    assert latency is not None
    assert [row["hop"] for row in found["chain"]] == [part.hop.name for part in latency.chain]
    assert [row["whose"] for row in found["chain"]] == [part.hop.owner.value for part in latency.chain]
    assert {row["hop"]: row["p99_ms"] for row in found["chain"]} == {
        part.hop.name: part.times.as_ms()["p99_ms"] for part in latency.chain
    }
    assert found["total"] == latency.total.as_ms()
    assert found["largest"] == latency.largest.hop.name


def test_compare_of_recordings_has_figures_and_settings(
    stopped: Path, recordings: Recordings, tmp_path: Path
) -> None:
    other = tmp_path / "other.mcap"
    shutil.copy(recordings.path(merged(WHOLE, {"task": {"force_n": 8.0}})), other)
    found = told("compare", stopped, other)
    for name, place in (("stopped", stopped), ("other", other)):
        summary = summarise(read(place))
        assert found["runs"][name] == {"outcome": summary.outcome, **summary.figures, **summary.contact}
    assert found["settings"]["task.force_n"] == {"stopped": "10.0", "other": "8.0"}
    assert not Path("compare.html").exists()


def test_doctor_has_a_row_for_each_line(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(doctor, "wake_ups", lambda realtime: facts.ok("wake-ups", "on time"))
    file = tmp_path / "site.toml"
    file.write_text('[robot]\nurl = "s3+serial:///dev/ttyUSB99"\n')
    found = told("doctor", file, code=3)
    assert found["can_work"] is False
    row = next(one for one in found["facts"] if one["subject"] == "robot.url" and one["level"] == "fail")
    assert row["text"].startswith("serial port /dev/ttyUSB99: no such port")
    rest = told("doctor")
    assert rest["can_work"] is True
    assert len(rest["facts"]) == len(text("doctor").splitlines())


def test_probe_tells_what_a_run_would_be_refused_for() -> None:
    found = probe_values(
        ProbeResult((("robot", "UR5e"), ("state", "off")), (Trouble("the arm is off", "switch it on"),))
    )
    assert found == {
        "would_begin": False,
        "rows": [{"name": "robot", "text": "UR5e"}, {"name": "state", "text": "off"}],
        "refusals": [{"fact": "the arm is off", "remedy": "switch it on"}],
    }
    assert probe_values(ProbeResult((("robot", "UR5e"),)))["would_begin"] is True
