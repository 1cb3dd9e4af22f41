"""Complete runs by the command line, in virtual time: printed and written output, also if a run ends early."""

import asyncio
import io
import json
import shutil
import signal
import sys
from pathlib import Path

import pytest

from hil_bridge import api
from hil_bridge.errors import DeviceError
from hil_bridge.record import CycleRecord, EventKind, read, read_with_traffic
from hil_bridge.runs.cycle import Run
from hil_bridge.runs.notes import Notes
from hil_bridge.runs.outputs import Outputs
from hil_bridge.runs.sampling import Sampler
from hil_bridge.runs.session import execute
from hil_bridge.settings.configuration import read_config
from hil_bridge.show.web.recorded import run_source_of
from protocol.devices.s3.adlp import HEADER_SIZE
from tests.command_line import VIRTUAL, Command, refused

RECORDED = ("--no-view", "--record", "r.mcap")

FIRST_DAY = {
    "report r.mcap --overwrite": "report.html",
    "why r.mcap": "There was no control cycle",
    "latency r.mcap": "no times: the run ended before its first control cycle",
    "replay r.mcap": "no cycle to replay: the run ended before its first control cycle",
    "compare r.mcap copy.mcap -o c.html": "c.html",
    "monitor r.mcap": "",
}
"""Commands on a recording that ended before its first cycle, and part of their output."""


def test_refused_run_keeps_earlier_recording(hil: Command) -> None:
    Path("keep.mcap").write_bytes(b"an hour of work")
    Path("rt.toml").write_text("[realtime]\ncpus = [999]\n")
    code, _, errors = hil("run", "rt.toml", "--no-view", "--record", "keep.mcap")
    assert (code, errors.count("\n")) == (2, 1)
    assert "realtime.cpus" in errors
    assert Path("keep.mcap").read_bytes() == b"an hour of work"


def test_run_writes_outputs_before_printing(hil: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    """The reader of standard output may have exited, as with `| head`."""
    files_exist: list[bool] = []

    class Left(io.StringIO):
        def write(self, text: str) -> int:
            files_exist.append(all(path.exists() for path in (Path("s.json"), Path("rep/report.html"))))
            raise BrokenPipeError

    config = read_config({"run": {"duration_s": 1.0}})
    with monkeypatch.context() as patched:
        patched.setattr(sys, "stdout", Left())
        assert execute(config, True, Outputs(Path("r.mcap"), Path("s.json"), Path("rep")), False) == 0
    assert files_exist
    assert all(files_exist)
    assert json.loads(Path("s.json").read_text())["outcome"] == "completed"
    assert Path("rep/report.html").exists()


def test_run_prints_figures_and_report_is_reproducible(hil: Command) -> None:
    code, output, errors = hil(
        *VIRTUAL, "--duration", "2", "--record", "r.mcap", "--summary", "s.json", "--report", "rep"
    )
    lines = output.splitlines()
    assert (code, errors) == (0, "")
    assert lines[0] == "completed"
    assert lines[-4:-1] == ["record: r.mcap", "summary: s.json", "report: rep/report.html"]
    assert lines[-1] == "left: retracted, 0.0 N"
    assert any(line.startswith("  tracked") and "predictive" in line for line in lines)
    assert json.loads(Path("s.json").read_text())["outcome"] == "completed"
    assert hil("report", "r.mcap", "-o", "again") == (0, "again/report.html\n", "")
    assert Path("again/report.html").read_bytes() == Path("rep/report.html").read_bytes()
    Path("cut.mcap").write_bytes(Path("r.mcap").read_bytes()[:3000])
    Path("empty.mcap").touch()
    assert "before the first event" in refused(hil("report", "cut.mcap"))
    assert "empty.mcap is empty" in refused(hil("report", "empty.mcap"))


def test_run_with_observed_client_profile_works(hil: Command) -> None:
    """Telegrams of this profile state only the length of their data, and a move has 60 bytes."""
    assert hil("run", "--virtual", "--link-profile", "observed-client", "--duration", "1", *RECORDED)[0] == 0
    recording, traffic = read_with_traffic(Path("r.mcap"))
    sent = [piece for link in traffic.robot for piece in link.pieces if " tx 1002" in piece]
    moves = [piece.partition(" tx ")[2] for piece in sent if "0100180" in piece]
    framed = 60 + 5  # preceded by DLE STX, followed by DLE ETX and the checksum
    assert {(move[4:8], len(move) // 2) for move in moves} == {(f"{60 - HEADER_SIZE:04x}", framed)}
    assert recording.end["outcome"] == "completed"


def test_run_does_not_record_end_of_emulator(hil: Command) -> None:
    assert hil(*VIRTUAL, "--duration", "0.3", "--record", "r.mcap")[0] == 0
    assert not [event for event in read(Path("r.mcap")).events if event.kind == EventKind.EMULATOR]


def test_run_with_dead_sensor_keeps_recording(hil: Command) -> None:
    Path("c.toml").write_text("[cell.jr3.sensor]\nconnected = false\n")
    code, output, errors = hil(
        *VIRTUAL, "c.toml", "--record", "r.mcap", "--report", "rep", "--summary", "s.json"
    )
    assert (code, errors.count("\n")) == (3, 1)
    assert output.splitlines() == ["record: r.mcap", "summary: s.json", "report: rep/report.html"]
    assert "force sensor on can+memory:sensor" in errors
    assert "sensor unplugged?" in errors
    assert json.loads(Path("s.json").read_text())["cause"] == "sensor-failed"
    assert (Path("rep") / "report.html").exists()
    shutil.copy("r.mcap", "copy.mcap")
    for command, text in FIRST_DAY.items():
        code, output, errors = hil(*command.split())
        assert (code, errors) == (0, ""), command
        assert text in output, command
    source = run_source_of(api.read("r.mcap"), "r.mcap")
    assert source.update_for(source.first(), 0.0)


def test_run_reports_device_failure_before_first_cycle(hil: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*arguments: object) -> None:
        raise DeviceError("the robot said no")

    monkeypatch.setattr(Sampler, "take", fail)
    code, output, errors = hil(*VIRTUAL, "--record", "r.mcap", "--report", "rep", "--summary", "s.json")
    assert (code, errors) == (3, "hil-bridge: stopped: the robot said no\n")
    assert output == "stopped\nrecord: r.mcap\nnext: hil-bridge why r.mcap\nleft: retracted, 0.0 N\n"


def test_stopped_run_reports_cause_and_writes_outputs(hil: Command) -> None:
    Path("c.toml").write_text("[task]\napproach_depth_limit_mm = 1.0\n")
    code, output, errors = hil(*VIRTUAL, "c.toml", "--summary", "s.json", "--report", "rep")
    assert code == 3
    assert errors.startswith("hil-bridge: stopped: no contact found within 1 mm: ")
    assert output.startswith("stopped\n")
    *_, report, command, left = output.splitlines()
    assert (report, left) == ("report: rep/report.html", "left: retracted, 0.0 N")
    assert command.startswith("next: hil-bridge why runs/")
    assert json.loads(Path("s.json").read_text())["text"].startswith("no contact found within 1 mm")


def test_interruption_before_movement_ends_at_once(hil: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(*arguments: object, **options: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("hil_bridge.devices.wiring.opening.connect_bytes", interrupted)
    code, output, errors = hil(*VIRTUAL, "--report", "rep")
    assert (code, output, errors.strip()) == (130, "", "")


# --- Ctrl-C


def test_ctrl_c_in_virtual_time_retracts(hil: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    cycle = Notes._cycle

    def interrupt(self: Notes, record: CycleRecord) -> None:
        cycle(self, record)
        if record.cycle == 30:
            signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(Notes, "_cycle", interrupt)
    before = signal.getsignal(signal.SIGINT)
    code, output, errors = hil(*VIRTUAL, "--record", "r.mcap", "--summary", "s.json")
    assert (code, errors) == (130, "")
    assert output.startswith("interrupted\n")
    recording = read(Path("r.mcap"))
    assert (recording.cycles[-1].phase, recording.end["outcome"]) == ("retract", "interrupted")
    assert json.loads(Path("s.json").read_text())["outcome"] == "interrupted"
    assert signal.getsignal(signal.SIGINT) is before


def test_ctrl_c_before_movement_is_reported(hil: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    async def connecting(self: Run) -> None:
        signal.raise_signal(signal.SIGINT)
        await asyncio.Event().wait()

    monkeypatch.setattr(Run, "__call__", connecting)
    code, output, errors = hil(*VIRTUAL, "--record", "r.mcap")
    assert (code, errors) == (130, "")
    assert output == "interrupted: before the movement began\nrecord: r.mcap\n"
