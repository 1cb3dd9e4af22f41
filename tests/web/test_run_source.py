"""Values of a run that a page receives: those of its recording, limited in number."""

import dataclasses
import json
from typing import Any

import msgspec
import pytest

from hil_bridge.api import load
from hil_bridge.errors import Cause, Reason
from hil_bridge.record import CycleRecord, EventKind, EventRecord, Recording, RunEnd
from hil_bridge.record.ending import Outcome
from hil_bridge.record.records import StepRecord
from hil_bridge.record.topics import TOPICS, Record
from hil_bridge.runs.setup import Setup
from hil_bridge.show.charts.columns import ROWS, Columns
from hil_bridge.show.charts.facts import start_time
from hil_bridge.show.charts.run import run_charts
from hil_bridge.show.terminal import Health, Scene
from hil_bridge.show.web import wire
from hil_bridge.show.web.run_source import EVENTS, REST_S, Cursor, RunSource
from tests.near_surface import EMERGENCY_STOP, WHOLE
from tests.recordings import Recordings


@pytest.fixture
def stopped(recordings: Recordings) -> tuple[Scene, Recording]:
    """Return a run with an emulated cell that an emergency stop ends."""
    config = load(WHOLE, faults=[EMERGENCY_STOP])
    scene = Scene(10.0, Setup(config).facts, cell=Setup(config).cell_name.words, limits=config.limits)
    return scene, recordings(WHOLE, faults=[EMERGENCY_STOP])


def in_order(recording: Recording) -> list[Record]:
    records: list[Record] = [*recording.cycles, *recording.truths, *recording.events, *recording.sensors]
    times = {topic.record: topic.time_of for topic in TOPICS}
    return sorted(records, key=lambda record: times[type(record)](record))


def test_web_messages_roundtrip_over_socket(stopped: tuple[Scene, Recording]) -> None:
    scene, recording = stopped
    begin = wire.decode_message(wire.encode_message(wire.Begin(scene, 123)))
    assert begin == wire.Begin(scene, 123)
    records = in_order(recording)[:200]
    message = wire.decode_message(wire.encode_records(records))
    assert isinstance(message, wire.Records)
    encode = {topic.record: topic.encode for topic in TOPICS}
    lines, received = (
        [json.loads(encode[type(record)](record)) for record in those]
        for those in (records, wire.records_of(message))
    )
    assert received == lines


def test_page_updates_match_recording(stopped: tuple[Scene, Recording]) -> None:
    scene, recording = stopped
    source = RunSource(wire.Begin(scene, 0), 0.0)
    cursor, update, rows = Cursor(), {}, 0
    events: list[Any] = []
    for number, record in enumerate(in_order(recording)):
        source.take(record)
        if number % 50 == 0:
            update = json.loads(msgspec.json.encode(source.update_for(cursor, 0.0)))
            rows += len(update.get("rows", {}).get("cycle", {}).get("x", ()))
            events += update["events"]
    source.end(
        wire.End(RunEnd(Outcome.STOPPED, Reason(Cause.ROBOT_STATE, "the emergency stop")).as_metadata())
    )
    update = json.loads(msgspec.json.encode(source.update_for(cursor, 0.0)))
    rows += len(update.get("rows", {}).get("cycle", {}).get("x", ()))
    events += update["events"]
    newest = recording.cycles[-1]
    assert rows == len(recording.cycles)  # no record is dropped at this pace, and none arrives twice
    assert update["now"]["force"] == pytest.approx(newest.force, rel=1e-4, abs=1e-5)
    assert update["now"]["depth_mm"] == pytest.approx(newest.depth * 1e3, rel=1e-4)
    stops = [event for event in recording.events if event.kind == EventKind.STOP]
    assert stops
    assert update["now"]["cause"] == stops[0].text
    assert update["now"]["stopped_s"] == pytest.approx(stops[0].at - start_time(recording), abs=1e-6)
    assert update["end"]["lines"][:2] == [
        ["Injected fault: robot emergency stop.", "lead"],
        ["The emergency stop.", ""],
    ]
    assert [event["kind"] for event in events] == [event.kind for event in recording.events]
    assert [event["weight"] for event in events if event["kind"] in ("stop", "fault")][:2] == [
        "caution",
        "alarm",
    ]
    assert "N·m; " in update["now"]["zero"]
    assert update["start"] == pytest.approx(newest.start)


def test_late_page_receives_complete_state(stopped: tuple[Scene, Recording]) -> None:
    scene, recording = stopped
    source = RunSource(wire.Begin(scene, 0), 0.0)
    for record in in_order(recording):
        source.take(record)
    update = source.update_for(Cursor(), 0.0)
    assert update["model"]["arm"] is None  # the facts of this run contain no geometry
    limits = {chart["id"]: chart.get("limits", ()) for chart in update["charts"]["charts"]}
    assert [limit["value"] for limit in limits["force"]] == [
        scene.limits.force_limit_n,
        -scene.limits.pull_limit_n,
    ]
    assert len(update["rows"]["cycle"]["x"]) == len(recording.cycles)
    assert update["scene"]["cell"].startswith("EMULATED")
    source.begin(wire.Begin(scene, 0))  # more is known: every page restarts
    again = source.update_for(Cursor(dict.fromkeys(("cycle", "truth"), 10**6), 10**6, 10**6), 0.0)
    assert len(again["rows"]["cycle"]["x"]) == len(recording.cycles)


SCALE = ("title", "unit", "zero", "least_span", "log", "quiet_span", "height_px")


def test_live_page_and_report_share_marks_and_scales(
    stopped: tuple[Scene, Recording],
) -> None:
    scene, recording = stopped
    first, last = recording.cycles[0].started_at, recording.cycles[len(recording.cycles) // 2].controlled_at
    step = StepRecord(last, 1, "1 (track)", first, word="track", text="done")
    recording = dataclasses.replace(recording, steps=(step,))
    source = RunSource(wire.Begin(scene, 0), 0.0)
    for record in in_order(recording):
        source.take(record)
    source.take(step)
    source.end(wire.End(recording.end))
    charts = run_charts(recording)
    report, live = msgspec.to_builtins(charts), source.update_for(Cursor(), 0.0)
    assert {mark["text"].partition(":")[0] for mark in live["marks"]} >= {"stop", "fault", "1 (track)"}
    marks = sorted(live["marks"], key=lambda mark: mark["x"])
    assert [{**mark, "x": round(mark["x"], 6)} for mark in marks] == [
        {**mark, "x": round(mark["x"], 6)} for mark in report["marks"]
    ]
    assert [(span["text"], span["kind"]) for span in live["spans"]] == [
        (span["text"], span["kind"]) for span in report["spans"]
    ]
    assert "fault" in {span["kind"] for span in live["spans"]}
    live_charts, report_charts = (
        {chart["id"]: chart for chart in page["charts"]} for page in (live["charts"], report)
    )
    common = live_charts.keys() & report_charts.keys()
    assert common >= {"force", "moments", "depth", "stiffness", "times"}
    for name in common:
        assert [live_charts[name].get(key) for key in SCALE] == [
            report_charts[name].get(key) for key in SCALE
        ], name
        assert [(limit["value"], limit["label"]) for limit in live_charts[name].get("limits", ())] == [
            (limit["value"], limit["label"]) for limit in report_charts[name].get("limits", ())
        ], name


def test_page_reports_silence_and_unexpected_end(stopped: tuple[Scene, Recording]) -> None:
    source = RunSource(wire.Begin(stopped[0], 0), 100.0)
    source.pulse(wire.Pulse(5.0, Health()), 100.0)
    assert source.update_for(Cursor(), 101.0)["now"]["silent_s"] == 0
    assert source.update_for(Cursor(), 107.5)["now"]["silent_s"] == 7.5
    source.lost()
    assert source.update_for(Cursor(), 107.5)["end"]["outcome"] == "gone"


def test_chart_continues_with_sensor_after_stop(stopped: tuple[Scene, Recording]) -> None:
    source = RunSource(wire.Begin(stopped[0], 0), 100.0)
    for cycle in stopped[1].cycles:
        source.take(cycle)
    last = cycle.answered_at

    def forces(*frames: tuple[float, float]) -> list[float | None]:
        for after_s, force in frames:
            source.pulse(wire.Pulse(last + after_s, Health(sensor_at=last + after_s, force=force)), 100.0)
        rows = source.update_for(Cursor(), 100.0)["rows"]["cycle"]
        return [force for force, depth in zip(rows["force"], rows["depth"], strict=True) if depth is None]

    assert forces((1.0, 7.0)) == [], "a run that is late has not stopped"
    source.take(EventRecord(last + 0.01, EventKind.STOP, "the motors are off", cause=Cause.ROBOT_STATE))
    assert forces((REST_S, 7.0), (1.2, 8.0), (1.2, 8.0), (1.4, 9.0)) == [8.0, 9.0]


def test_sensor_age_between_pulses_is_that_of_the_pulse(stopped: tuple[Scene, Recording]) -> None:
    """A page between two pulses knows of no frame since, which is no reason to call the sensor old."""
    source = RunSource(wire.Begin(stopped[0], 0), 100.0)
    source.pulse(wire.Pulse(5.0, Health(sensor_at=4.996)), 100.0)
    assert source.update_for(Cursor(), 100.2)["now"]["age_ms"] == pytest.approx(4.0)
    assert source.update_for(Cursor(), 103.0)["now"]["age_ms"] == pytest.approx(3004.0)


def test_long_fast_run_memory_is_bounded(stopped: tuple[Scene, Recording]) -> None:
    scene, recording = stopped
    cycle = next(cycle for cycle in recording.cycles if cycle.phase == "track")
    columns, source = Columns(0.0, scene.chart_facts), RunSource(wire.Begin(scene, 0), 0.0)
    for number in range(4 * ROWS):
        at, force = number * 0.01, 50.0 if number % 4 == 1 else 1.0
        record = msgspec.structs.replace(cycle, controlled_at=at, started_at=at, force=force)
        columns.cycle(record)
        if number % 20 == 0:
            source.take(EventRecord(at, EventKind.MARK, "m" * 10_000))
    result = columns.since({})["cycle"]
    assert len(result["x"]) == ROWS
    forces = result["force"]
    assert forces.count(50.0) == pytest.approx(ROWS / 2, rel=0.01)  # no peak between two rows is lost
    assert columns.counts["cycle"] == pytest.approx(2 * ROWS, rel=0.01)  # one row per 40 ms, and its peak
    assert result["x"] == sorted(result["x"], key=float)  # type: ignore[arg-type]
    update = source.update_for(Cursor(), 0.0)
    assert (len(update["events"]), len(update["marks"])) == (EVENTS, EVENTS)
    assert len(msgspec.json.encode(update)) < 200_000


def test_nan_becomes_a_gap_on_the_page(stopped: tuple[Scene, Recording]) -> None:
    scene, recording = stopped
    cycle = msgspec.structs.replace(recording.cycles[0], force=float("nan"))
    assert isinstance(cycle, CycleRecord)
    columns = Columns(0.0, scene.chart_facts)
    columns.cycle(cycle)
    assert columns.since({})["cycle"]["force"] == [None]
