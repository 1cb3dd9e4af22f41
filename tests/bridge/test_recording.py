import errno
import io
import json
import math
import re
import struct
import threading
import time
import tracemalloc
from collections import Counter
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import jsonschema
import lz4.frame
import msgspec
import pytest
import zstandard
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from msgspec import structs

from hil_bridge import api
from hil_bridge.control import Predictive
from hil_bridge.control.course.intent import Phase
from hil_bridge.control.sample import Sample
from hil_bridge.devices.facts import Devices, RobotFacts
from hil_bridge.errors import BridgeError, ConfigError
from hil_bridge.lab.experiments import run_emulated
from hil_bridge.record import (
    VIRTUAL,
    VIRTUAL_CHUNKS,
    CycleRecord,
    EventRecord,
    Recorder,
    Recording,
    SensorRecord,
    Writing,
    mcap_file,
    read,
)
from hil_bridge.record import recorder as recorder_module
from hil_bridge.record.device_facts import devices_of
from hil_bridge.record.recorder import Chunks
from hil_bridge.record.records import TruthRecord, WireRecord
from hil_bridge.record.scenes import SCENE_TOPICS
from hil_bridge.record.stored_cycle import SHARED
from hil_bridge.record.time_axis import ORDER_WINDOW_S
from hil_bridge.record.topics import CYCLE, SENSOR, TOPICS, TRUTH, WIRE, Record, Topic
from hil_bridge.runs.outputs import Outputs
from hil_bridge.runs.session import execute
from hil_bridge.settings.configuration import read_config
from tests.near_surface import CLOSE, merged
from tests.recordings import Recordings

METADATA = {"seed": "7", "controller": "fuzzy-pi", "configuration": '{"force_n": 50.0}'}


def wall_ns(loop_time: float) -> int:
    return 1_700_000_000_000_000_000 + round(loop_time * 1e9)


def cycle(number: int, at: float, **changes: object) -> CycleRecord:
    values: dict[str, object] = {
        "cycle": number,
        "phase": "track",
        "started_at": at,
        "status_at": at + 0.07,
        "sensor_at": at + 0.069,
        "controlled_at": at + 0.0705,
        "sent_at": at + 0.071,
        "answered_at": at + 0.16,
        "sensor_sequence": number * 160,
        "force": 49.5,
        "force_reference": 50.0,
        "wrench": (0.1, -0.2, 49.5, 0.0, 0.01, 0.0),
        "position": (0.9, 0.1, 0.5),
        "quaternion": (0.0, 0.0, 1.0, 0.0),
        "depth": 0.0025,
        "depth_commanded": 0.002625,
        "travel_commanded": 0.01,
        "correction": -0.000125,
        "stiffness": 2e4,
        "gain": 0.5,
        "held": False,
        "in_contact": True,
        "verdict": "clamp",
        "reasons": ("step",),
        "explanation": {"error_level": -1.0},
    }
    return CycleRecord(**(values | changes))  # type: ignore[arg-type]


def stream(seconds: float = 3.0) -> list[Record]:
    """A 200 Hz sensor stream with a cycle every 0.16 s, in the order in which a run puts them."""
    records: list[Record] = [EventRecord(100.0, "phase", "track – µ ü")]
    for k in range(round(seconds * 200)):
        at = 100.0 + k / 200
        records.append(SensorRecord(at, k, (k % 7, -k, 3, 4, 5, -16384)))
        if k % 32 == 31:
            records.append(cycle(k // 32, at))
    return records


def write(path: Path, records: list[Record], end: dict[str, str] | None = None) -> Path:
    recorder = Recorder(path, wall_ns, METADATA, Writing(threaded=False))
    for record in records:
        recorder.put(record)
    recorder.close(end)
    return path


def test_what_was_put_is_read_back(tmp_path: Path) -> None:
    records = stream()
    recording = read(write(tmp_path / "run.mcap", records, {"outcome": "completed"}))
    # by their texts: a time that is not known is NaN, which from Python 3.13 on makes two records differ
    assert [*map(repr, recording.cycles)] == [repr(r) for r in records if isinstance(r, CycleRecord)]
    assert [*recording.sensors] == [r for r in records if isinstance(r, SensorRecord)]
    assert [*recording.events] == [records[0]]
    assert recording.metadata == METADATA
    assert recording.end["outcome"] == "completed"
    assert not recording.truncated


def test_two_runs_of_one_input_give_the_same_bytes(tmp_path: Path) -> None:
    first = write(tmp_path / "a.mcap", stream()).read_bytes()
    assert write(tmp_path / "b.mcap", stream()).read_bytes() == first
    assert write(tmp_path / "c.mcap", stream(2.9)).read_bytes() != first


def test_a_thread_writes_the_same_records(tmp_path: Path) -> None:
    records = stream()
    recorder = Recorder(tmp_path / "run.mcap", wall_ns, METADATA, Writing(threaded=True))
    for record in records:
        recorder.put(record)
    recorder.close()
    by_thread, by_caller = read(tmp_path / "run.mcap"), read(write(tmp_path / "b.mcap", records))
    assert repr(by_thread.cycles) == repr(by_caller.cycles)
    assert len(by_thread.cycles) == len(by_caller.cycles) > 0
    assert not any(thread.name == "recorder" for thread in threading.enumerate())


def test_from_pause_to_pause_the_writer_lets_the_loop_be(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(recorder_module, "PATIENCE_SECONDS", 60.0)
    path, frames = tmp_path / "run.mcap", stream(0.1)[1:]
    # every record at once to the disk, where it is seen
    recorder = Recorder(path, wall_ns, {}, Writing(threaded=True, chunks=Chunks(seconds=0.0, size=1)))

    def grown(before: int, within_s: float) -> bool:
        """Whether the file is larger than it was before, or grows so within this time."""
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
    assert grown(before, 10.0), "a run that tells no pauses is written all the same"
    recorder.pause(0.0)  # over before the writer has woken; from now on it waits for another
    time.sleep(0.2)  # what had been put may be written in this time
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


def test_what_pauses_do_not_suffice_for_is_written_without_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
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


def test_half_a_character_is_written_out(tmp_path: Path) -> None:
    odd = EventRecord(math.nan, "phase", "no such file: caf\udce9")
    recording = read(
        write(
            tmp_path / "run.mcap",
            [cycle(0, 100.0, explanation={"\udc80": 1.0}), odd, EventRecord(101.0, "phase", "track")],
        )
    )
    assert [event.text for event in recording.events] == ["no such file: caf\\udce9", "track"]
    assert recording.cycles[0].explanation == {"\\udc80": 1.0}


def test_foreign_readers_find_topics_schemas_and_times(tmp_path: Path) -> None:
    """Through the library's own reader, as Foxglove does: index, summary, strict JSON, wall-clock times."""
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


def test_numbers_that_json_lacks_come_back_as_nan(tmp_path: Path) -> None:
    wrench = (math.nan, math.inf, 0.0, 0.0, 0.0, 0.0)
    odd = cycle(0, 100.0, status_at=math.nan, wrench=wrench, stiffness=None)
    (back,) = read(write(tmp_path / "run.mcap", [odd])).cycles
    assert math.isnan(back.status_at)
    assert math.isnan(back.wrench[0])
    assert math.isnan(back.wrench[1])
    assert back.wrench[2:] == (0.0, 0.0, 0.0, 0.0)
    assert back.stiffness is None


def test_a_record_without_a_time_gets_that_of_the_newest(tmp_path: Path) -> None:
    odd: list[Any] = [
        cycle(0, 100.0),
        EventRecord(math.nan, "phase", "track"),
        cycle(1, 101.0, controlled_at=math.inf),
    ]
    recording = read(write(tmp_path / "run.mcap", odd))
    assert recording.events[0].at == recording.cycles[0].controlled_at == recording.cycles[1].controlled_at


def test_a_full_queue_drops_the_newest_and_counts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
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
def test_a_full_disk_is_told_at_the_end_and_stops_nothing(tmp_path: Path, threaded: bool) -> None:
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


def test_a_place_that_cannot_be_written_is_told_before_the_run(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"cannot write .*: there is no such folder"):
        Recorder(tmp_path / "nowhere" / "run.mcap", wall_ns, {}, Writing(threaded=False))


def test_a_cut_file_gives_what_came_before(tmp_path: Path) -> None:
    """As a killed process leaves it: finished chunks are readable, the run counts as cut off."""
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


def test_chunks_of_a_virtual_run_have_one_size(tmp_path: Path) -> None:
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


def test_the_c_library_is_asked_for_buffers_with_pages_of_their_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[tuple[int, int]] = []
    library = SimpleNamespace(mallopt=lambda *wish: asked.append(wish))
    monkeypatch.setattr(recorder_module.ctypes, "CDLL", lambda name: library)
    write(tmp_path / "run.mcap", stream(1.0))
    assert asked == [], "a recording in a user's program sets nothing for the process"
    recorder_module.map_buffers()
    assert asked == [(-3, 131_072)]  # M_MMAP_THRESHOLD of glibc


def test_our_own_program_asks_it_and_a_program_of_a_user_does_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[tuple[int, int]] = []
    library = SimpleNamespace(mallopt=lambda *wish: asked.append(wish))
    monkeypatch.setattr(recorder_module, "ctypes", SimpleNamespace(CDLL=lambda name: library))
    config = read_config({"run": {"duration_s": 0.1}})
    api.simulate(config).save(tmp_path / "user.mcap")
    assert asked == []
    assert execute(config, True, Outputs(record=tmp_path / "ours.mcap"), view=False) == 0
    assert asked == [(-3, 131_072)]


def test_a_c_library_without_the_setting_records_all_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(recorder_module.ctypes, "CDLL", lambda name: object())
    recorder_module.map_buffers()
    assert read(write(tmp_path / "run.mcap", stream(1.0))).cycles


def test_every_cut_is_truncated_or_refused(tmp_path: Path) -> None:
    data = write(tmp_path / "run.mcap", stream(2.0)).read_bytes()
    path, seen = tmp_path / "cut.mcap", set()
    for size in [*range(0, len(data), 97), len(data) - 1]:
        path.write_bytes(data[:size])
        try:
            assert read(path).truncated
            seen.add("truncated")
        except ConfigError as error:
            seen.add("refused" if str(path) in str(error) and "\n" not in str(error) else f"odd: {error}")
    assert seen == {"truncated", "refused"}


@pytest.mark.parametrize("offset", [20, -20])  # in the compressed data; in the checksum before it
def test_garbage_in_the_middle_keeps_what_came_before(tmp_path: Path, offset: int) -> None:
    data = bytearray(write(tmp_path / "run.mcap", stream(6.0)).read_bytes())
    third = [i for i in range(len(data)) if data[i : i + 4] == b"\x28\xb5\x2f\xfd"][2]  # zstd frames
    data[third + offset] ^= 0xFF
    (tmp_path / "bad.mcap").write_bytes(data)
    recording = read(tmp_path / "bad.mcap")
    assert recording.truncated
    assert 100.9 < recording.cycles[-1].started_at < 102.1


# --- bombs


def zstd_bomb(size: int, *, told: bool) -> bytes:
    """Zeros, packed; `told`: the frame's header holds their number."""
    packer = zstandard.ZstdCompressor(write_content_size=told).compressobj(size if told else -1)
    zeros = bytes(1 << 20)
    return b"".join(packer.compress(zeros) for _ in range(size >> 20)) + packer.flush()


def lz4_bomb(size: int) -> bytes:
    packer = lz4.frame.LZ4FrameCompressor()
    zeros = bytes(1 << 20)
    return packer.begin() + b"".join(packer.compress(zeros) for _ in range(size >> 20)) + packer.flush()


def with_chunk(path: Path, claim: int, compression: str, packed: bytes) -> Path:
    """A recording with one more chunk behind its last, and nothing after that."""
    data, at = write(path, stream(1.0)).read_bytes(), 8
    while data[at] != 15:  # the record that ends the data
        at += 9 + int.from_bytes(data[at + 1 : at + 9], "little")
    head, name = data[:at], compression.encode()
    body = struct.pack("<QQQII", 0, 0, claim, 0, len(name)) + name + struct.pack("<Q", len(packed)) + packed
    path.write_bytes(head + struct.pack("<BQ", 6, len(body)) + body)
    return path


def peak_bytes(path: Path) -> tuple[str, int]:
    """Result of reading, and the most memory that Python and the unpackers took for it."""
    tracemalloc.start()
    try:
        said = "truncated" if read(path).truncated else "whole"
    except ConfigError as error:
        said = str(error)
    finally:
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    return said, peak


BOMB = 256 << 20
"""Large enough that taking it is seen, small enough that a reader which does take it survives."""
PACKERS = {
    "zstd": lambda: zstd_bomb(BOMB, told=False),
    "zstd whose header tells": lambda: zstd_bomb(BOMB, told=True),
    "lz4": lambda: lz4_bomb(BOMB),
}


@pytest.mark.parametrize("name", PACKERS)
@pytest.mark.parametrize("claim", [BOMB, 1 << 40, 1 << 63])
def test_a_chunk_that_claims_too_much_is_refused_while_packed(tmp_path: Path, name: str, claim: int) -> None:
    path = with_chunk(tmp_path / "bomb.mcap", claim, name.partition(" ")[0], PACKERS[name]())
    said, peak = peak_bytes(path)
    assert "bomb.mcap is refused: it says that it holds" in said
    assert "\n" not in said
    assert peak < BOMB / 4


@pytest.mark.parametrize("name", PACKERS)
def test_a_chunk_that_holds_more_than_it_claims_is_damage(tmp_path: Path, name: str) -> None:
    path = with_chunk(tmp_path / "bomb.mcap", 1000, name.partition(" ")[0], PACKERS[name]())
    said, peak = peak_bytes(path)
    assert said == "truncated"
    assert peak < BOMB / 4


def test_many_chunks_of_ordinary_size_are_refused_together(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write(tmp_path / "run.mcap", stream(10.0))
    monkeypatch.setattr(mcap_file, "UNPACKED_LIMIT_BYTES", 160_000)
    assert path.stat().st_size < 160_000
    with pytest.raises(ConfigError, match=r"it holds [0-9]+ bytes unpacked, but at most 160000"):
        read(path)


def test_a_file_that_hides_its_chunks_is_stopped_on_the_way(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write(tmp_path / "run.mcap", stream(10.0))
    monkeypatch.setattr(mcap_file, "UNPACKED_LIMIT_BYTES", 160_000)
    monkeypatch.setattr(mcap_file, "_claims", lambda data: ())
    with pytest.raises(ConfigError, match=r"a chunk of [0-9]+ bytes unpacked"):
        read(path)


def test_a_file_without_an_end_is_no_recording() -> None:
    with pytest.raises(ConfigError, match="it is a device; name an ordinary file"):
        read(Path("/dev/zero"))
    with pytest.raises(ConfigError, match=r"a NUL stands in it$"):
        read(Path("a\0b"))


@pytest.mark.parametrize("compression", ["lz4", ""])
def test_chunks_packed_by_other_programs_are_read(tmp_path: Path, compression: str) -> None:
    plain = struct.pack("<BQHIQQ", 5, 24, 999, 0, 0, 0) + b"{}"
    packed = lz4.frame.compress(plain) if compression else plain
    path = with_chunk(tmp_path / "run.mcap", len(plain), compression, packed)
    path.write_bytes(path.read_bytes() + struct.pack("<BQQQI", 2, 20, 0, 0, 0) + b"\x89MCAP0\r\n")
    assert not read(path).truncated


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "is empty"),
        (b"time,force\n0,1\n", "is not an MCAP file"),
        (b"\x89MCAP0\r\n", "is damaged before the first event"),
        (b"\x89MCAP0\r\n" + b"\xff" * 200, "is damaged before the first event"),
        (b"\x89MCAP0\r\n" + struct.pack("<BQ", 6, 1 << 62) + b"x" * 50, "is damaged before"),
    ],
)
def test_what_is_no_recording_is_refused_in_one_line(tmp_path: Path, content: bytes, message: str) -> None:
    path = tmp_path / "x.mcap"
    path.write_bytes(content)
    with pytest.raises(ConfigError, match=message) as caught:
        read(path)
    assert str(path) in str(caught.value)
    assert caught.value.exit_code == 2


def test_a_missing_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="No such file"):
        read(tmp_path / "missing.mcap")


def test_a_message_of_another_version_is_refused_by_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(type(CYCLE), "encode", lambda self, record: b'{"cycle":"one"}')
        write(tmp_path / "run.mcap", [cycle(0, 100.0)])
    with pytest.raises(ConfigError, match=r"message of /cycle: Expected `int`, got `str` - at `\$\.cycle`"):
        read(tmp_path / "run.mcap")


MESSAGES = st.fixed_dictionaries(
    {},
    optional={
        name: st.text(max_size=3)
        | st.floats(allow_nan=False, allow_infinity=False)
        | st.lists(st.integers(), max_size=6)
        for name in ("at", "kind", "text", "sequence", "counts", "data", "direction")
    },
).map(lambda values: json.dumps(values).encode())


@settings(max_examples=100)
@given(st.binary(max_size=300) | MESSAGES)
def test_an_arbitrary_message_is_a_record_or_a_value_error(data: bytes) -> None:
    for topic in TOPICS:
        try:
            record = topic.decode(data)
        except (ValueError, RecursionError):
            continue
        assert isinstance(record, topic.record)


@pytest.mark.parametrize(
    "message",
    [
        b'{"at":true,"sequence":1,"counts":[1,2,3,4,5,6]}',
        b'{"at":1,"sequence":1.5,"counts":[1,2,3,4,5,6]}',
        b'{"at":1,"sequence":1,"counts":[1,2,3,4,5]}',
        b'{"at":1,"sequence":1,"counts":{"a":1}}',
        b'{"at":NaN,"sequence":1,"counts":[1,2,3,4,5,6]}',
        b'{"at":1' + b"0" * 400 + b',"sequence":1,"counts":[1,2,3,4,5,6]}',
        b'{"sequence":1,"counts":[1,2,3,4,5,6]}',
        b"[1,2]",
    ],
)
def test_wrong_columns_are_refused(message: bytes) -> None:
    with pytest.raises(ValueError, match=r".+"):
        SENSOR.decode(message)


def test_what_a_controller_explains_is_recorded_as_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    step = Predictive.step

    def talkative(self: Predictive, *given: Any) -> Any:
        state, command = step(self, *given)
        return state, structs.replace(command, explanation={"why": "soft", "found": True})

    monkeypatch.setattr(Predictive, "step", talkative)
    cycles = run_emulated(read_config({"run": {"duration_s": 2.0}})).cycles
    told = [cycle.explanation for cycle in cycles if cycle.phase == "track"]
    assert told
    assert all(math.isnan(one["why"]) and one["found"] == 1.0 for one in told)


def test_a_cycle_says_each_fact_once_in_the_file(recorded: Path) -> None:
    cycles = read(recorded).cycles
    for record in cycles:
        message = json.loads(CYCLE.encode(record))
        assert not SHARED.keys() & message["sample"].keys()
        assert message.keys() >= {*SHARED.values()}
        assert repr(CYCLE.decode(CYCLE.encode(record))) == repr(record)
        assert record.sample is not None
        assert (record.sample.now, record.sample.wrench) == (record.status_at, record.wrench)


def test_a_fact_of_the_sample_that_differs_from_the_cycle_stays(recorded: Path) -> None:
    record = read(recorded).cycles[-1]
    assert record.sample is not None
    start = msgspec.structs.replace(record.sample, quaternion=(1.0, 0.0, 0.0, 0.0))
    other = msgspec.structs.replace(record, quaternion=(math.nan,) * 4, sample=start)
    assert json.loads(CYCLE.encode(other))["sample"]["quaternion"] == [1.0, 0.0, 0.0, 0.0]
    assert repr(CYCLE.decode(CYCLE.encode(other))) == repr(other)
    alone = msgspec.structs.replace(record, sample=None)
    assert repr(CYCLE.decode(CYCLE.encode(alone))) == repr(alone)


def test_the_schema_says_what_the_fields_say_of_themselves() -> None:
    schema: Any = CYCLE.schema
    columns = schema["properties"]
    assert columns["correction"] == {
        "type": "number",
        "description": "Change of the commanded depth in this cycle, m; the feedback law's part of it is in "
        "`explanation`.",
    }
    assert columns["stiffness"]["type"] == "number"
    assert columns["sample"]["type"] == "object"
    assert columns["sample"]["properties"]["position"]["items"] == {"type": "number"}
    assert columns["explanation"]["additionalProperties"] == {"type": ["number", "null"]}
    assert columns["verdict"]["enum"] == ["allow", "clamp", "stop"]
    assert columns["phase"]["enum"] == [*Phase]
    assert columns["wrench"] == {
        "type": "array",
        "prefixItems": [{"type": ["number", "null"]}] * 6,
        "items": {"type": "number"},
        "minItems": 6,
        "maxItems": 6,
        "description": "fx fy fz mx my mz on the tool in the tool frame, N and N·m, after bias and gravity.",
    }
    assert {"cycle", "phase", "controlled_at", "wrench"} <= {*schema["required"]}
    assert not {"force", "status_at", "stiffness", "sample"} & {*schema["required"]}
    sensor: Any = SENSOR.schema["properties"]
    assert sensor["counts"]["items"] == {"type": "number"}  # a device may tell N
    for topic in TOPICS:
        properties: Any = topic.schema["properties"]
        assert all(column["description"] for column in properties.values()), topic.name


# --- strict readers


def checked_messages(path: Path) -> tuple[dict[str, int], list[str]]:
    """How many messages of each topic are valid by their own schema, and what is wrong with the others."""
    valid: Counter[str] = Counter()
    wrong = []
    validators: dict[int, Any] = {}
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages(log_time_order=False):
            assert schema is not None
            if schema.id not in validators:
                rules = json.loads(schema.data)
                judge = jsonschema.validators.validator_for(rules, jsonschema.Draft202012Validator)
                judge.check_schema(rules)
                validators[schema.id] = judge(rules)
            told = json.loads(message.data, parse_constant=pytest.fail)
            flaws = [f"{channel.topic} {flaw.json_path}" for flaw in validators[schema.id].iter_errors(told)]
            valid[channel.topic] += not flaws
            wrong += flaws
    return dict(valid), wrong


def as_foxglove_takes_it(schema: Any) -> bool:
    """Whether its reader finds a type of one word everywhere. Source: parseJsonSchema.ts of foxglove/studio."""
    words = ("boolean", "string", "number", "integer", "object", "array")
    match schema["type"]:
        case "object":
            return all(map(as_foxglove_takes_it, schema["properties"].values()))
        case "array":
            return schema["items"]["type"] != "array" and as_foxglove_takes_it(schema["items"])
        case word:
            return isinstance(word, str) and word in words


@pytest.fixture(scope="module", params=["jr3", "jr3-uart", "jr3-board"])
def recorded(request: pytest.FixtureRequest, recordings: Recordings) -> Path:
    """A recording of a run with each of our sensors."""
    line = {"kind": "line", "length_mm": 20.0}
    steps = [{"do": "approach"}, {"do": "track", "path": line, "for_s": 4.0}, {"do": "retract"}]
    return recordings.path(merged(CLOSE, {"task": {"step": steps}, "sensor": {"emulated": request.param}}))


def test_every_message_of_a_run_is_valid_by_its_own_schema(recorded: Path) -> None:
    valid, wrong = checked_messages(recorded)
    assert wrong == []
    assert valid.keys() == {topic.name for topic in (*TOPICS, *SCENE_TOPICS)}
    assert valid["/cycle"] > 20
    assert valid["/sensor"] > 500


def test_schemas_are_those_that_foxglove_takes() -> None:
    assert all(as_foxglove_takes_it(topic.schema) for topic in (*TOPICS, *SCENE_TOPICS))
    assert not as_foxglove_takes_it({"type": "object", "properties": {"a": {"type": ["number", "null"]}}})


def test_log_times_fall_by_no_more_than_the_window(recorded: Path) -> None:
    newest, behind = 0, 0
    with recorded.open("rb") as file:
        for _, _, message in make_reader(file).iter_messages(log_time_order=False):
            newest = max(newest, message.log_time)
            behind = max(behind, newest - message.log_time)
            assert message.publish_time == message.log_time  # no usual run comes near the window
    assert 0 < behind < ORDER_WINDOW_S * 1e9


def test_a_record_that_was_put_too_late_is_placed_at_the_window(tmp_path: Path) -> None:
    late = EventRecord(100.0, "phase", "track")
    path = write(tmp_path / "run.mcap", [cycle(0, 150.0), late])
    with path.open("rb") as file:
        ((_, _, told),) = make_reader(file).iter_messages(topics="/event", log_time_order=False)
    assert told.log_time == wall_ns(150.0705 - ORDER_WINDOW_S)
    assert told.publish_time == wall_ns(100.0)
    assert [*read(path).events] == [late]


KNOWN = st.none() | st.floats(allow_nan=False, allow_infinity=False)


@given(
    st.lists(st.floats(), min_size=6, max_size=6),
    st.floats(),
    KNOWN,
    st.dictionaries(st.text(), st.floats()),
)
def test_no_number_makes_a_message_that_its_schema_refuses(
    six: list[float], force: float, stiffness: float | None, explanation: dict[str, float]
) -> None:
    sample = Sample(force, (force, 0.0, 0.0), force, 1.0, 1.0, 1, wrench=tuple(six), position_at=stiffness)
    sample = structs.replace(sample, peak_force=force, gap=six[0])
    odd = cycle(0, 1.0, wrench=tuple(six), force=force, stiffness=stiffness, gain=force, sample=sample)
    odd = structs.replace(odd, explanation=explanation)
    for topic, record in (
        (CYCLE, odd),
        (SENSOR, SensorRecord(1.0, 1, tuple(six))),
        (TRUTH, TruthRecord(1, 1.0, force, force, (force,) * 3, (force,) * 3, tuple(six))),
    ):
        told = json.loads(topic.encode(record))
        jsonschema.Draft202012Validator(topic.schema).validate(told)
        back = topic.decode(topic.encode(record))
        assert in_nan(back) == in_nan(record)


def in_nan(record: Record) -> str:
    """A record in words, as it is read back: what JSON lacks is NaN."""
    return re.sub(r"-?\binf\b", "nan", repr(msgspec.to_builtins(record)))


def test_a_null_is_nan_for_a_number_and_none_where_nothing_is_allowed() -> None:
    message = json.loads(CYCLE.encode(cycle(0, 100.0)))
    message["explanation"] = {"stiffness": None}
    message["stiffness"] = message["force"] = None
    message["position"] = [None, 1, 2]
    back = CYCLE.decode(json.dumps(message).encode())
    assert isinstance(back, CycleRecord)
    assert math.isnan(back.explanation["stiffness"])
    assert math.isnan(back.force)
    assert math.isnan(back.position[0])
    assert back.stiffness is None
    message["phase"] = None
    with pytest.raises(ValueError, match=r"\$\.phase"):
        CYCLE.decode(json.dumps(message).encode())


@pytest.mark.parametrize(
    ("emulated", "first"),
    [
        ("jr3", r"0\.000000 tx 401#"),
        ("jr3-uart", r"0\.000000 tx [0-9a-f]+$"),
        ("jr3-board", r"0\.000000 tx [0-9a-f]+$"),
    ],
)
def test_a_run_records_the_wire_of_its_sensor(tmp_path: Path, emulated: str, first: str) -> None:
    path = tmp_path / "run.mcap"
    config = read_config({"run": {"duration_s": 1.0}, "sensor": {"emulated": emulated}})
    assert execute(config, True, Outputs(record=path), view=False) == 0
    with path.open("rb") as file:
        told = [message for _, _, message in make_reader(file).iter_messages("/wire", log_time_order=False)]
    records = [WIRE.decode(message.data) for message in told]
    assert all(isinstance(record, WireRecord) and record.device == "sensor" for record in records)
    pieces = [piece for record in records for piece in record.pieces]  # type: ignore[union-attr]
    assert re.match(first, pieces[0])
    assert len(records) < len(pieces) / 10
    received = [piece for piece in pieces if " rx " in piece]
    assert len(received) >= len(read(path).sensors) / 2


@pytest.mark.parametrize("kind", ["jr3", "jr3-uart", "jr3-board"])
def test_a_run_records_what_its_devices_are(tmp_path: Path, kind: str) -> None:
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
    told = devices_of(recording)
    robot, sensor = told.robot, told.sensor
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


def test_facts_are_written_before_the_run_ends(tmp_path: Path) -> None:
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
def test_facts_that_cannot_be_are_no_facts(text: str) -> None:
    assert devices_of(Recording((), devices={"robot": text})) == Devices()


@pytest.mark.parametrize("topic", TOPICS, ids=lambda topic: topic.name)
def test_the_schema_speaks_of_any_robot_and_of_all_phases(topic: Topic) -> None:
    """Every recording carries it, whatever robot moved."""
    told = json.dumps(topic.schema).lower()
    for word in ("status order", "status answer", "move order", "its bid", "enq", "s3"):
        assert word not in told, word
    if topic is CYCLE:
        described = json.loads(json.dumps(topic.schema))["properties"]["phase"]["description"]
        assert all(str(phase) in described for phase in Phase)
