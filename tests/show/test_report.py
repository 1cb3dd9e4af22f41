import dataclasses
import json
import math
import random
import re
import struct
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from msgspec import structs

import hil_bridge
from hil_bridge.devices.facts import MISSING, Devices, Sensor
from hil_bridge.devices.robots.streamed import STALE
from hil_bridge.errors import Cause, ConfigError, Reason
from hil_bridge.record import (
    EventKind,
    EventRecord,
    Outcome,
    Recording,
    RunEnd,
    SensorRecord,
    TruthRecord,
)
from hil_bridge.record.analysis.stream import stream_force
from hil_bridge.record.analysis.summary import summarise
from hil_bridge.record.records import FaultNote
from hil_bridge.runs.setup import Setup
from hil_bridge.show.report import write_report
from hil_bridge.show.report.differences import from_defaults
from hil_bridge.show.report.page import page
from hil_bridge.show.report.plots import draw
from protocol.faults import FaultStage
from protocol.wrench import SensorFacts
from tests.record.written_recordings import cycle_of

pytestmark = pytest.mark.sweep

EVIL = "<script>alert('1')</script> & $x^"
END = RunEnd(
    Outcome.STOPPED,
    Reason(Cause.FORCE, EVIL),
    0.156,
    {EVIL: 1},
    left=f"left {EVIL}",
    followed=(Reason(Cause.GATE, "first"), Reason(Cause.BUG, EVIL)),
)
NEWTON_PER_COUNT, BIAS_COUNTS = 0.025, 37


def run(seconds: float = 8.0) -> Recording:
    """Return a run with a noisy stream: the tool presses along −z, first without force, then up to 50 N."""
    chance, cycles, sensors = random.Random(3), [], []
    for k in range(round(seconds * 500)):
        pressed = 50.0 * (1 - math.exp(-max(0.0, k / 500 - 1)))
        z = round(-pressed / NEWTON_PER_COUNT + BIAS_COUNTS + chance.gauss(0, 20))
        sensors.append(SensorRecord(20.0 + k / 500, k, (round(chance.gauss(0, 9)), 4, z, 0, 0, 0)))
        if k % 80 == 79:
            at = sensors[-1].at
            cycles.append(
                cycle_of(
                    cycle=k // 80,
                    phase="track" if k > 500 else "approach",
                    started_at=at - 0.07,
                    status_at=at,
                    sensor_at=at,
                    controlled_at=at + 0.0005,
                    sent_at=at + 0.001,
                    answered_at=at + 0.09,
                    sensor_sequence=k,
                    force=-(z - BIAS_COUNTS) * NEWTON_PER_COUNT,
                    force_reference=50.0,
                    depth=pressed / 2e4,
                    depth_commanded=pressed / 2e4,
                    correction=1e-4,
                    stiffness=2e4 if k > 900 else None,
                    held=k > 2000,
                    in_contact=k > 500,
                    verdict="clamp" if k < 800 else "allow",
                    reasons=("step",) if k < 800 else (),
                )
            )
    events = (EventRecord(25.0, EventKind.STOP, EVIL), EventRecord(24.0, EVIL, EVIL))
    settings = {
        "sensor": {"quaternion": [1, 0, 0, 0], "mounting_deg": 90, "flip_fx_mx": False},
        "frame": {"approach": [0, 0, 1]},
        "limits": {"force_limit_n": 47.0, "pull_limit_n": 10.0},
        "unknown": {"key": EVIL},
    }
    facts = SensorFacts("", (NEWTON_PER_COUNT,) * 6, None, None, None, 0.0, "device")
    return Recording(
        tuple(cycles),
        tuple(sensors),
        events,
        {"controller": EVIL, "configuration": '{"a":[1,2]}', "config": json.dumps(settings)},
        devices=Devices(sensor=Sensor(facts=facts)).as_metadata(),
    )


def chart_data(page: str) -> dict[str, Any]:
    """Return the data of the page's charts."""
    (text,) = re.findall(r'<script type="application/json" id="data-run">(.*?)</script>', page, re.DOTALL)
    result: dict[str, Any] = json.loads(text)
    return result


@pytest.mark.full
def test_page_is_deterministic_and_pictures_are_optional(tmp_path: Path) -> None:
    recording = run(1.5)
    summary = summarise(recording, END)
    page = write_report(recording, summary, tmp_path / "new" / "a")
    assert [file.name for file in page.parent.iterdir()] == ["report.html"]
    assert page == tmp_path / "new" / "a" / "report.html"
    again = write_report(recording, summary, tmp_path / "b", pictures=("png", "pdf"))
    assert again.read_bytes() == page.read_bytes()
    picture = again.with_name("report.png").read_bytes()
    assert struct.unpack(">II", picture[16:24])[0] == 1400
    assert again.with_name("report.pdf").read_bytes().startswith(b"%PDF-")


def test_picture_without_matplotlib_is_refused_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    recording = run(1.5)
    with pytest.raises(
        ConfigError,
        match=r"^picture files need matplotlib, which is not installed: pip install .*\[figures\]",
    ):
        write_report(recording, summarise(recording, END), tmp_path, pictures=("png",))
    assert write_report(recording, summarise(recording, END), tmp_path).exists()


def test_charts_match_recording() -> None:
    recording = run()
    truths = tuple(
        TruthRecord(
            cycle=cycle.cycle,
            at=cycle.answered_at,
            sampled_at=cycle.sample.sensor_at,
            motion_at=math.nan,
            position=(0.0, 0.0, cycle.depth + 1e-5),
            force=(0.0, 0.0, -cycle.force - 1.0),
            joints_deg=(0.0,) * 6,
        )
        for cycle in recording.cycles
    )
    faults = (
        EventRecord(22.0, EventKind.FAULT, "one", fault=FaultNote("bus", "errors", FaultStage.BEGINS)),
        EventRecord(24.0, EventKind.FAULT, "two", fault=FaultNote("bus", "errors", FaultStage.ENDS)),
    )
    recording = dataclasses.replace(recording, truths=truths, events=(*faults, *recording.events))
    result = chart_data(page(recording, summarise(recording, END)))
    zero = recording.cycles[0].started_at
    cycle = result["sources"]["cycle"]
    assert cycle["x"] == pytest.approx([c.controlled_at - zero for c in recording.cycles], abs=1e-5)
    columns: dict[str, list[float | None]] = {
        "force": [c.force for c in recording.cycles],
        "depth_commanded": [1e3 * c.depth_commanded for c in recording.cycles],
        "correction": [1e3 * c.correction for c in recording.cycles],
        "stiffness": [c.stiffness for c in recording.cycles],
        "clamped": [c.force if c.verdict == "clamp" else None for c in recording.cycles],
        "cycle_ms": [1e3 * (c.answered_at - c.started_at) for c in recording.cycles],
    }
    for name, expected in columns.items():
        assert cycle[name] == [None if v is None else pytest.approx(v, rel=1e-5) for v in expected], name
    truth = result["sources"]["truth"]
    assert truth["force"] == pytest.approx([c.force + 1.0 for c in recording.cycles], rel=1e-5)
    assert truth["depth"] == pytest.approx([1e3 * c.depth + 0.01 for c in recording.cycles], rel=1e-5)
    by_id = {chart["id"]: chart for chart in result["charts"]}
    assert by_id["force"]["limits"] == [
        {"value": 47.0, "label": "force limit"},
        {"value": -10.0, "label": "pull limit"},
    ]
    assert [s["label"] for s in by_id["force"]["series"] if s.get("layer") == "truth"] == ["true force"]
    assert {layer["id"] for layer in result["layers"]} == {"truth", "stream"}
    spans = {span["text"]: (span["begin"], span["end"]) for span in result["spans"]}
    assert spans["bus errors"] == pytest.approx((22.0 - zero, 24.0 - zero))
    assert list(spans)[:2] == ["approach", "track"]
    assert [mark["kind"] for mark in result["marks"] if "kind" in mark] == ["fault", "stop"]


@pytest.mark.parametrize(
    ("retracted", "style", "label"), [(False, "alarm", "retract, failed"), (True, "", "retract")]
)
def test_failed_retraction_depends_on_value_only(retracted: bool, style: str, label: str) -> None:
    end = dataclasses.replace(END, left="somewhere", rest={"retracted": retracted})
    events = (EventRecord(20.5, EventKind.PHASE, "retract"), EventRecord(21.0, EventKind.PHASE, "end"))
    recording = dataclasses.replace(run(), end=end.as_metadata(), events=events)
    text = page(recording, summarise(recording))
    assert f'<p class="{style}">The tool was somewhere' in text
    assert f'"text":"{label}"' in text
    assert [span["text"] for span in chart_data(text)["spans"] if span["kind"] == "retract"] == [label]


def test_report_gives_command_for_a_tool_left_in_contact() -> None:
    place = "NOT retracted: left at 1 mm"
    end = dataclasses.replace(END, left=f"{place}, because x", place=place, rest={"retracted": False})
    recording = dataclasses.replace(run(), end=end.as_metadata())
    line = "NOT retracted: left at 1\u00a0mm; <code>hil-bridge free</code> lifts it off.</p>"
    assert line in page(recording, summarise(recording))


def test_page_of_stopped_run_names_fault_and_command() -> None:
    fault = FaultNote("robot", "emergency-stop", FaultStage.BEGINS)
    events = (EventRecord(24.0, EventKind.FAULT, "text", fault=fault),)
    recording = dataclasses.replace(run(), end=END.as_metadata(), events=events, file="my run.mcap")
    text = page(recording, summarise(recording))
    lines = re.findall(
        r'<p class="(\w*)">(.*?)</p>', text.partition('class="bar end alarm"')[2].partition("</section>")[0]
    )
    assert [style for style, _ in lines] == ["lead", "", "", "", "", "quiet"]
    assert lines[0] == ("lead", "Injected fault: robot emergency stop.")
    assert "<code>hil-bridge why &#x27;my run.mcap&#x27;</code><button" in text
    assert "[data-copy]" in text


def test_page_of_long_run_is_bounded_and_keeps_peaks() -> None:
    recording = run()
    base = recording.cycles[0]
    cycles = []
    for k in range(60_000):
        at, force = 20.0 + 0.004 * k, 40.0 + math.sin(k) + (33.3 if k == 31_234 else 0.0)
        cycles.append(structs.replace(base, cycle=k, started_at=at, controlled_at=at, force=force))
    recording = dataclasses.replace(recording, cycles=tuple(cycles), sensors=())
    text = page(recording, summarise(recording, END))
    assert len(text) < 2_000_000
    force = chart_data(text)["sources"]["cycle/force"]
    assert len(force["x"]) <= 4000
    assert force["x"] == sorted(force["x"])
    peak = cycles[31_234]
    assert force["force"][force["x"].index(round(peak.controlled_at - 20.0, 5))] == float(f"{peak.force:.6g}")
    for name in ("min", "max"):
        assert getattr(np, name)(force["force"]) == pytest.approx(
            getattr(np, name)([c.force for c in cycles]), rel=1e-5
        )


def test_page_escapes_all_text_and_loads_nothing(tmp_path: Path) -> None:
    recording = dataclasses.replace(run(), end=END.as_metadata())
    text = write_report(recording, summarise(recording), tmp_path).read_text()
    assert text.count("<script") == text.count("</script>") == 3
    assert text.count("&lt;script&gt;") >= 8
    then = '<p class="">Then: first.</p>\n<p class="">Then: &lt;script'
    assert text.index(then) < text.index('<p class="">The tool was left &lt;script')
    assert not re.search(r"(src|href|srcset)=", text)
    assert "http:" not in text.split("<body>")[1].rpartition("<script>")[0]
    assert f"stop: {EVIL}"[:160] in [mark["text"] for mark in chart_data(text)["marks"]]


def test_page_lists_settings_that_differ_from_defaults() -> None:
    rows = {key: (value, default) for key, value, default in from_defaults(run())}
    assert rows == {
        "limits.force_limit_n": ("47.0", "50.0"),
        "sensor.mounting_deg": ("90", "0.0"),
        "frame.approach": ("[0, 0, 1]", "[0.0, 0.0, -1.0]"),
        "unknown.key": (EVIL, ""),
    }


def test_partial_run_still_gives_page_and_picture() -> None:
    """The run has one cycle, no stream, no estimate, and no known figures."""
    only = structs.replace(run().cycles[0], force=math.nan, answered_at=math.nan)
    recording = Recording((only,), truncated=True)
    assert draw(recording, summarise(recording)).startswith(b"\x89PNG")
    result = chart_data(page(recording, summarise(recording)))
    assert result["charts"][0]["id"] == "force", "the force chart exists even without force data"
    assert "force" not in result["sources"]["cycle"]


def test_run_report_and_replay_work_without_matplotlib(tmp_path: Path) -> None:
    commands = (
        ["run", "--virtual", "--duration", "1", "--record", "r.mcap", "--report", ".", "--no-view"],
        ["report", "r.mcap", "--overwrite"],
        ["replay", "r.mcap"],
    )
    code = (
        "import sys, click\nsys.modules['matplotlib'] = None\nfrom hil_bridge.cli import main\n"
        f"for command in {commands!r}:\n"
        "    sys.argv[1:] = command\n    try: main()\n    except SystemExit as end: assert not end.code, command\n"
    )
    process = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert process.returncode == 0, process.stderr
    assert (tmp_path / "report.html").exists()


def test_stream_is_scaled_and_shifted_to_cycles() -> None:
    recording = run()
    stream = stream_force(recording)
    assert stream is not None
    at, low, high = stream
    true = np.array([-(s.counts[2] - BIAS_COUNTS) * NEWTON_PER_COUNT for s in recording.sensors])
    assert len(at) <= 3000
    assert (low <= high).all()
    assert low.min() == pytest.approx(true.min())
    assert high.max() == pytest.approx(true.max())


def test_stream_inconsistent_with_cycles_is_not_drawn() -> None:
    recording = run()
    turned = tuple(
        structs.replace(cycle, force=-cycle.force if cycle.cycle % 2 else cycle.force)
        for cycle in recording.cycles
    )
    assert stream_force(dataclasses.replace(recording, cycles=turned)) is None
    assert stream_force(dataclasses.replace(recording, sensors=())) is None


@pytest.mark.parametrize("unknown", [{"devices": {}}, {"metadata": {}}])
def test_stream_without_scale_or_direction_is_not_drawn(unknown: dict[str, Any]) -> None:
    assert stream_force(dataclasses.replace(run(), **unknown)) is None


def test_unwritable_report_path_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    recording = run(1.5)
    with pytest.raises(ConfigError, match="cannot make the directory"):
        write_report(recording, summarise(recording, END), tmp_path / "file")


def test_virtual_run_has_date_of_its_file() -> None:
    virtual = dataclasses.replace(run(1.0), metadata={"time": "virtual"})
    dated = dataclasses.replace(virtual, written_at=1_700_000_000.0)
    assert "2023-11-14 22:13:20 UTC; in virtual time" in page(dated, summarise(dated))
    assert '<td class="value">in virtual time</td>' in page(virtual, summarise(virtual))


def test_page_title_and_heading_agree() -> None:
    recording = run(1.0)
    text = page(recording, summarise(recording))
    (head,) = re.findall("<h1>(.*?)</h1>", text)
    assert text.partition("<title>")[2].startswith(f"{head}, ")


@pytest.mark.parametrize(("kind", "label"), [("rtde", "cycles missing"), ("egm", "packets missing")])
def test_report_counts_cycles_skipped_by_tcp_robot(kind: str, label: str) -> None:
    """TCP loses no packets; the recording keeps the counter's own name."""
    end = dataclasses.replace(END, link={MISSING: 3, STALE: 0}).as_metadata()
    devices = Devices(robot=Setup(hil_bridge.load({"robot": {"emulated": kind}})).facts)
    recording = dataclasses.replace(run(1.0), devices=devices.as_metadata(), end=end)
    summary = summarise(recording)
    text = page(recording, summary).partition("Link counters")[2]
    assert summary.link[MISSING] == 3
    assert re.findall(r"(?:cycles|packets) missing", text) == [label]
