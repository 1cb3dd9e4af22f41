"""Recordings: round trips, also of a cut file; contents written by a run, and when they are written."""

import errno
import io
import json
import math
import re
import threading
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from mcap.reader import make_reader
from msgspec import structs

from hil_bridge import api
from hil_bridge.api import simulate
from hil_bridge.control import Predictive
from hil_bridge.devices.facts import Devices, RobotFacts
from hil_bridge.errors import BridgeError, ConfigError
from hil_bridge.record import (
    VIRTUAL,
    VIRTUAL_CHUNKS,
    CycleRecord,
    EventKind,
    EventRecord,
    Recorder,
    Recording,
    SensorRecord,
    Writing,
    read,
)
from hil_bridge.record import recorder as recorder_module
from hil_bridge.record.device_facts import devices_of
from hil_bridge.record.recorder import Chunks
from hil_bridge.record.records import WireRecord
from hil_bridge.record.scenes import SCENE_TOPICS
from hil_bridge.record.topics import WIRE
from hil_bridge.runs.outputs import Outputs
from hil_bridge.runs.session import execute
from hil_bridge.settings.configuration import read_config
from tests.record.written_recordings import METADATA, cycle, stream, wall_ns, write

pytestmark = pytest.mark.sweep


def test_recording_roundtrip(tmp_path: Path) -> None:
    records = stream()
    recording = read(write(tmp_path / "run.mcap", records, {"outcome": "completed"}))
    # compared as text: an unknown time is NaN, and since Python 3.13 records with NaN differ
    assert [*map(repr, recording.cycles)] == [repr(r) for r in records if isinstance(r, CycleRecord)]
    assert [*recording.sensors] == [r for r in records if isinstance(r, SensorRecord)]
    assert [*recording.events] == [records[0]]
    assert recording.metadata == METADATA
    assert recording.end["outcome"] == "completed"
    assert not recording.truncated


def test_recording_of_same_input_is_identical(tmp_path: Path) -> None:
    first = write(tmp_path / "a.mcap", stream()).read_bytes()
    assert write(tmp_path / "b.mcap", stream()).read_bytes() == first
    assert write(tmp_path / "c.mcap", stream(2.9)).read_bytes() != first


def test_threaded_recorder_writes_same_records(tmp_path: Path) -> None:
    records = stream()
    recorder = Recorder(tmp_path / "run.mcap", wall_ns, METADATA, Writing(threaded=True))
    for record in records:
        recorder.put(record)
    recorder.close()
    by_thread, by_caller = read(tmp_path / "run.mcap"), read(write(tmp_path / "b.mcap", records))
    assert repr(by_thread.cycles) == repr(by_caller.cycles)
    assert len(by_thread.cycles) == len(by_caller.cycles) > 0
    assert not any(thread.name == "recorder" for thread in threading.enumerate())


def test_writer_works_only_in_pauses(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recorder_module, "PATIENCE_SECONDS", 60.0)
    path, frames = tmp_path / "run.mcap", stream(0.1)[1:]
    # every record is written to disk at once, where it is visible
    recorder = Recorder(path, wall_ns, {}, Writing(threaded=True, chunks=Chunks(seconds=0.0, size=1)))

    def grown(before: int, within_s: float) -> bool:
        """Return whether the file is larger than before, or grows within this time."""
        ends = time.monotonic() + within_s
        while path.stat().st_size == before:
            if time.monotonic() > ends:
                return False
            time.sleep(0.005)
        return True

    def put() -> None:
        for frame in frames:
            recorder.put(frame)

    before = path.stat().st_size
    recorder.put(cycle(0, 100.0))
    put()
    assert grown(before, 10.0), "a run that reports no pauses is also written"
    recorder.pause(0.0)  # over before the writer woke; it now waits for the next pause
    time.sleep(0.2)  # queued records may be written in this time
    before = path.stat().st_size
    put()
    assert not grown(before, 0.4)
    recorder.pause(10.0)
    assert grown(before, 10.0)
    recorder.pause(0.0)
    time.sleep(0.2)
    before = path.stat().st_size
    put()
    assert not grown(before, 0.2)
    recorder.close()
    assert len(read(path).sensors) == 3 * len(frames)


@pytest.mark.full
def test_writer_works_without_sufficient_pauses(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recorder_module, "PATIENCE_SECONDS", 0.1)
    recorder = Recorder(tmp_path / "run.mcap", wall_ns, {}, Writing(threaded=True, queue_records=100))
    recorder.put(cycle(0, 100.0))
    for k in range(300):  # three times the queue
        recorder.put(SensorRecord(101.0 + k, k, (0,) * 6))
        recorder.pause(0.0)
        time.sleep(0.01)
    recorder.close()
    assert not any(recorder.dropped.values())
    assert [sensor.sequence for sensor in read(tmp_path / "run.mcap").sensors] == list(range(300))


def test_lone_surrogate_is_recorded_escaped(tmp_path: Path) -> None:
    odd = EventRecord(math.nan, EventKind.PHASE, "no such file: caf\udce9")
    recording = read(
        write(
            tmp_path / "run.mcap",
            [cycle(0, 100.0, explanation={"\udc80": 1.0}), odd, EventRecord(101.0, EventKind.PHASE, "track")],
        )
    )
    assert [event.text for event in recording.events] == ["no such file: caf\\udce9", "track"]
    assert recording.cycles[0].explanation == {"\\udc80": 1.0}


def test_mcap_reader_finds_topics_schemas_and_times(tmp_path: Path) -> None:
    """Read by the library's own reader, as Foxglove does: index, summary, strict JSON, wall-clock times."""
    data = write(tmp_path / "run.mcap", [*stream(), cycle(99, 104.0, force=math.nan)]).read_bytes()
    reader = make_reader(io.BytesIO(data), validate_crcs=True)
    summary = reader.get_summary()
    assert summary is not None
    assert {channel.topic for channel in summary.channels.values()} == {
        "/cycle",
        "/sensor",
        "/link",
        "/wire",
        "/truth",
        "/event",
        "/step",
        *(topic.name for topic in SCENE_TOPICS),
    }
    assert all(schema.encoding == "jsonschema" for schema in summary.schemas.values())
    for schema in summary.schemas.values():
        for column in json.loads(schema.data)["properties"].values():
            assert isinstance(column["type"], str)
            assert column["type"] != "object" or "properties" in column
    messages = [
        (channel.topic, message.log_time, json.loads(message.data, parse_constant=pytest.fail))
        for _, channel, message in reader.iter_messages()
    ]
    assert messages[0][:2] == ("/event", wall_ns(100.0))
    assert "force" not in messages[-1][2]
    assert len(summary.chunk_indexes) >= 3  # one a second


def test_non_finite_numbers_are_read_back_as_nan(tmp_path: Path) -> None:
    wrench = (math.nan, math.inf, 0.0, 0.0, 0.0, 0.0)
    odd = cycle(0, 100.0, status_at=math.nan, wrench=wrench, stiffness=None)
    (recorded,) = read(write(tmp_path / "run.mcap", [odd])).cycles
    assert math.isnan(recorded.sample.now)
    assert math.isnan(recorded.sample.wrench[0])
    assert math.isnan(recorded.sample.wrench[1])
    assert recorded.sample.wrench[2:] == (0.0, 0.0, 0.0, 0.0)
    assert recorded.stiffness is None


def test_record_without_time_gets_newest_time(tmp_path: Path) -> None:
    odd: list[Any] = [
        cycle(0, 100.0),
        EventRecord(math.nan, EventKind.PHASE, "track"),
        cycle(1, 101.0, controlled_at=math.inf),
    ]
    recording = read(write(tmp_path / "run.mcap", odd))
    assert recording.events[0].at == recording.cycles[0].controlled_at == recording.cycles[1].controlled_at


def test_full_queue_drops_and_counts_newest(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recorder_module, "WAKE_SECONDS", 60.0)  # the writer sleeps: nothing is drained
    recorder = Recorder(tmp_path / "run.mcap", wall_ns, {}, Writing(threaded=True, queue_records=10))
    recorder.put(cycle(0, 100.0))
    for k in range(15):
        recorder.put(SensorRecord(100.0 + k, k, (0,) * 6))
    recorder.put(cycle(1, 120.0))
    assert recorder.dropped == {
        "/cycle": 1,
        "/sensor": 6,
        "/link": 0,
        "/wire": 0,
        "/truth": 0,
        "/event": 0,
        "/step": 0,
    }
    recorder.close()
    recording = read(tmp_path / "run.mcap")
    assert [sensor.sequence for sensor in recording.sensors] == list(range(9))
    assert recording.events[-1].text == "records dropped: 1 of /cycle, 6 of /sensor"
    assert recording.end["dropped/sensor"] == "6"
    recorder.put(cycle(2, 121.0))
    assert recorder.dropped["/cycle"] == 2
    recorder.close()


@pytest.mark.parametrize("threaded", [False, True])
def test_full_disk_is_reported_at_end_without_stopping(tmp_path: Path, threaded: bool) -> None:
    path = tmp_path / "run.mcap"
    recorder = Recorder(path, wall_ns, {}, Writing(threaded=threaded))
    full = OSError(errno.ENOSPC, "No space left on device")
    recorder._flush = lambda: (_ for _ in ()).throw(full)
    for record in stream():
        recorder.put(record)
    with pytest.raises(BridgeError, match=r"run\.mcap is incomplete: No space left on device"):
        recorder.close()
    assert recorder.error is not None
    recorder.put(cycle(5, 200.0))
    assert recorder.dropped["/cycle"] >= 1


def test_unwritable_path_is_refused_before_run(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"cannot write .*: no such folder"):
        Recorder(tmp_path / "nowhere" / "run.mcap", wall_ns, {}, Writing(threaded=False))


def test_cut_file_yields_records_before_the_cut(tmp_path: Path) -> None:
    """After a killed process, finished chunks are readable, and the run counts as cut off."""
    recorder = Recorder(tmp_path / "run.mcap", wall_ns, METADATA, Writing(threaded=False))
    for record in stream(10.0):
        recorder.put(record)
    data = (tmp_path / "run.mcap").read_bytes()
    recorder.close()
    (tmp_path / "killed.mcap").write_bytes(data)
    recording = read(tmp_path / "killed.mcap")
    assert recording.truncated
    assert recording.metadata == METADATA
    assert recording.end == {}
    assert recording.cycles[-1].started_at > 107.0


def test_virtual_run_chunks_have_one_size(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path / "virtual.mcap", wall_ns, {}, VIRTUAL)
    for k in range(10_000):
        recorder.put(SensorRecord(100.0 + 3.0 * k, k, (k, 0, -870, 0, 0, 0)))
    recorder.close()
    with (tmp_path / "virtual.mcap").open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    *full, last = (index.uncompressed_size for index in summary.chunk_indexes)
    assert len(full) >= 3
    assert last <= VIRTUAL_CHUNKS.size
    assert all(VIRTUAL_CHUNKS.size < size < VIRTUAL_CHUNKS.size + 200 for size in full)


def test_map_buffers_sets_mmap_threshold(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    requested: list[tuple[int, int]] = []
    library = SimpleNamespace(mallopt=lambda *parameters: requested.append(parameters))
    monkeypatch.setattr(recorder_module.ctypes, "CDLL", lambda name: library)
    write(tmp_path / "run.mcap", stream(1.0))
    assert requested == [], "a recording in a user's program changes no process settings"
    recorder_module.map_buffers()
    assert requested == [(-3, 131_072)]  # M_MMAP_THRESHOLD of glibc


def test_map_buffers_is_called_by_own_program_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    requested: list[tuple[int, int]] = []
    library = SimpleNamespace(mallopt=lambda *parameters: requested.append(parameters))
    monkeypatch.setattr(recorder_module, "ctypes", SimpleNamespace(CDLL=lambda name: library))
    config = read_config({"run": {"duration_s": 0.1}})
    api.simulate(config).save(tmp_path / "user.mcap")
    assert requested == []
    assert execute(config, True, Outputs(record=tmp_path / "ours.mcap"), view=False) == 0
    assert requested == [(-3, 131_072)]


def test_recorder_works_without_mallopt(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recorder_module.ctypes, "CDLL", lambda name: object())
    recorder_module.map_buffers()
    assert read(write(tmp_path / "run.mcap", stream(1.0))).cycles


@pytest.mark.full
def test_recording_cut_anywhere_is_truncated_or_refused(tmp_path: Path) -> None:
    data = write(tmp_path / "run.mcap", stream(2.0)).read_bytes()
    path, observed = tmp_path / "cut.mcap", set()
    for size in [*range(0, len(data), 97), len(data) - 1]:
        path.write_bytes(data[:size])
        try:
            assert read(path).truncated
            observed.add("truncated")
        except ConfigError as error:
            observed.add("refused" if str(path) in str(error) and "\n" not in str(error) else f"odd: {error}")
    assert observed == {"truncated", "refused"}


@pytest.mark.parametrize("offset", [20, -20])  # in the compressed data; in the checksum before it
def test_garbage_in_file_keeps_records_before_it(tmp_path: Path, offset: int) -> None:
    data = bytearray(write(tmp_path / "run.mcap", stream(6.0)).read_bytes())
    third = [i for i in range(len(data)) if data[i : i + 4] == b"\x28\xb5\x2f\xfd"][2]  # zstd frames
    data[third + offset] ^= 0xFF
    (tmp_path / "bad.mcap").write_bytes(data)
    recording = read(tmp_path / "bad.mcap")
    assert recording.truncated
    assert 100.9 < recording.cycles[-1].started_at < 102.1


def test_controller_explanation_is_recorded(monkeypatch: pytest.MonkeyPatch) -> None:
    step = Predictive.step

    def talkative(self: Predictive, *arguments: Any) -> Any:
        state, command = step(self, *arguments)
        return state, structs.replace(command, explanation={"why": "soft", "found": True})

    monkeypatch.setattr(Predictive, "step", talkative)
    cycles = simulate(read_config({"run": {"duration_s": 2.0}})).cycles
    reported = [cycle.explanation for cycle in cycles if cycle.phase == "track"]
    assert reported
    assert all(math.isnan(one["why"]) and one["found"] == 1.0 for one in reported)


@pytest.mark.parametrize(
    ("emulated", "first"),
    [
        ("jr3", r"0\.000000 tx 401#"),
        ("jr3-uart", r"0\.000000 tx [0-9a-f]+$"),
        ("jr3-board", r"0\.000000 tx [0-9a-f]+$"),
    ],
)
def test_run_records_sensor_traffic(tmp_path: Path, emulated: str, first: str) -> None:
    path = tmp_path / "run.mcap"
    config = read_config({"run": {"duration_s": 1.0}, "sensor": {"emulated": emulated}})
    assert execute(config, True, Outputs(record=path), view=False) == 0
    with path.open("rb") as file:
        reported = [
            message for _, _, message in make_reader(file).iter_messages("/wire", log_time_order=False)
        ]
    records = [WIRE.decode(message.data) for message in reported]
    assert all(isinstance(record, WireRecord) and record.device == "sensor" for record in records)
    pieces = [piece for record in records for piece in record.pieces]  # type: ignore[union-attr]
    assert re.match(first, pieces[0])
    assert len(records) < len(pieces) / 10
    received = [piece for piece in pieces if " rx " in piece]
    assert len(received) >= len(read(path).sensors) / 2


@pytest.mark.parametrize("kind", ["jr3", "jr3-uart", "jr3-board"])
def test_run_records_device_facts(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "run.mcap"
    config = read_config(
        {
            "run": {"duration_s": 1.0},
            "sensor": {"emulated": kind},
            "cell": {"s3": {"servo": {"resolution_mm": 0.25}}},
        }
    )
    assert execute(config, True, Outputs(record=path), view=False) == 0
    recording = read(path)
    reported = devices_of(recording)
    robot, sensor = reported.robot, reported.sensor
    assert (robot.kind, robot.emulated, robot.position_step_m) == ("s3", True, 0.25e-3)
    assert robot.servo is not None
    assert robot.servo.marks["interpolation_s"] == "assumed"
    assert robot.servo.marks["dead_band_steps"] == "observed"
    assert robot.line_floor_s == json.loads(recording.end["line_floor_s"])
    assert sensor.kind == kind
    assert sensor.facts is not None
    assert sensor.facts.full_scales is not None
    assert sensor.facts.scales == tuple(scale / 16384 for scale in sensor.facts.full_scales)
    assert sensor.delay_s == json.loads(recording.end["sensor_delay_s"])
    assert sensor.facts.period is not None


def test_device_facts_are_written_before_end(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path / "run.mcap", wall_ns, METADATA, Writing(threaded=False))
    recorder.put(cycle(0, 100.0))
    recorder.devices({"robot": '{"position_step_m":0.00025}', "sensor": "{"})
    for record in stream(10.0):
        recorder.put(record)
    (tmp_path / "killed.mcap").write_bytes((tmp_path / "run.mcap").read_bytes())
    recorder.close()
    killed = read(tmp_path / "killed.mcap")
    assert killed.truncated
    assert devices_of(killed) == Devices(RobotFacts(position_step_m=0.25e-3))


@pytest.mark.parametrize(
    "text", ["", "[]", '{"position_step_m":0}', '{"servo":{"interpolation_s":-1}}', '{"kind":1}']
)
def test_invalid_device_facts_are_ignored(text: str) -> None:
    assert devices_of(Recording((), devices={"robot": text})) == Devices()
