"""Recordings and campaigns on a page: the updates match the file."""

import json
import sys
from pathlib import Path
from typing import Any

import msgspec
import pytest
from click.testing import CliRunner

from hil_bridge.cli import cli
from hil_bridge.errors import ConfigError
from hil_bridge.errors.extras import install_command
from hil_bridge.record import EventKind, Recording
from hil_bridge.record.analysis.why import sentence
from hil_bridge.record.ending import reason_of
from hil_bridge.show.web import feed
from hil_bridge.show.web.recorded import Report, run_source_of
from hil_bridge.show.web.run_source import Cursor, RunSource
from tests.bags import pressed
from tests.near_surface import EMERGENCY_STOP, WHOLE
from tests.recordings import Recordings

OLD = Path(__file__).parents[1] / "record" / "recordings" / "version_0_1_0.mcap"


@pytest.fixture
def recording(recordings: Recordings) -> Recording:
    return recordings(WHOLE, faults=[EMERGENCY_STOP])


def update_of(source: RunSource, cursor: Cursor) -> Any:
    update = source.updates(cursor)
    assert update is not None
    return json.loads(msgspec.json.encode(update))


def test_slider_reaches_every_moment(recording: Recording) -> None:
    source = run_source_of(recording, "run.mcap")
    cursor = source.first()
    complete = update_of(source, cursor)
    assert source.updates(cursor) is None  # until a request arrives
    assert len(complete["rows"]["cycle"]["x"]) == len(recording.cycles)
    assert complete["end"]["outcome"] == "stopped"
    reason = reason_of(recording.end)
    assert reason is not None
    lines = [line for line, _ in complete["end"]["lines"]]
    assert {sentence(reason.fact), f"Next: {reason.remedy}."} <= {
        line.replace("\u00a0", " ") for line in lines
    }
    assert complete["end"]["repeats"][0] == reason.fact
    assert [command for _, command in complete["end"]["next"]] == [
        "hil-bridge why run.mcap",
        "hil-bridge report run.mcap",
    ]
    assert complete["scene"]["cell"].startswith("EMULATED")
    began = min(recording.cycles[0].started_at, recording.events[0].at)
    for cycle in recording.cycles[:: len(recording.cycles) // 7]:
        source.handle_request(cursor, {"at": cycle.controlled_at - began + 1e-6})
        now = update_of(source, cursor)
        assert now["now"]["cycle"] == cycle.cycle
        assert now["now"]["force"] == pytest.approx(cycle.force, rel=1e-4, abs=1e-5)
        assert now["now"]["cause"] == ""
        assert now["now"]["phase"] == cycle.phase
    source.handle_request(cursor, {"at": 1e9})
    assert update_of(source, cursor)["now"]["cause"] == next(
        one.text for one in recording.events if one.kind == EventKind.STOP
    )
    source.handle_request(cursor, {"at": -5})
    assert "cycle" not in update_of(source, cursor)["now"]


@pytest.mark.parametrize(
    "message", [{}, {"at": "1"}, {"at": True}, {"at": float("nan")}, {"at": 1, "do": "retract"}]
)
def test_recording_page_accepts_only_moment_requests(recording: Recording, message: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=r"invalid request|`at` must be"):
        run_source_of(recording, "run.mcap").handle_request(Cursor(at=0.0), message)


def test_report_page_is_sent_once_and_accepts_no_request() -> None:
    report = Report("press", "press.mcap", "<p>measured</p>")
    cursor = report.first()
    assert report.updates(cursor) == {
        "title": "press",
        "file": "press.mcap",
        "body": "<p>measured</p>",
        "trouble": "",
        "still": True,
    }
    assert report.updates(cursor) is None
    assert report.updates(report.first()) is not None
    with pytest.raises(ValueError, match="accepts no requests"):
        report.handle_request(cursor, {"at": 1.0})


def test_view_of_older_recording_is_refused_in_one_line() -> None:
    with pytest.raises(ConfigError, match=r"^[^\n]+; 0\.6 is the last version that reads it$"):
        CliRunner().invoke(cli, ["view", str(OLD)], catch_exceptions=False)


def test_view_refuses_other_files_and_missing_extra(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def error_of(*arguments: str) -> str:
        result = CliRunner().invoke(cli, ["view", *arguments])
        assert isinstance(result.exception, ConfigError), result
        return str(result.exception)

    assert error_of("notes.txt").endswith(
        "neither a recording (.mcap), nor results of a campaign (.sqlite), nor a ROS 2 bag"
    )
    assert "no such file" in error_of("none.sqlite")
    bag = pressed(tmp_path / "press")
    assert "has no topic /gone" in error_of(str(bag), "--topic", "wrench=/gone")
    assert "no file in it ends in .mcap or .db3" in error_of(str(tmp_path))
    monkeypatch.setattr(feed, "NEEDED", ("not_installed_at_all",))
    monkeypatch.setitem(sys.modules, "hil_bridge.show.web.serving", None)  # whose import needs the extra
    assert error_of("run.mcap") == f"hil-bridge view needs the extra web: {install_command('web')}"
