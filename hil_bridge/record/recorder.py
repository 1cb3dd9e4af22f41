"""The record of a run: an MCAP file written beside the control path, never on it.

Messages stand in the file in the order in which they were put, and that is not quite the order of their log times: a
cycle is placed by its decision and put at its end, a stretch of a wire's log by its first piece, and the truth of an
emulated cell waits for the robot's motion. No message is placed more than ORDER_WINDOW_S before one that stands before
it in the file. So a reader that sorts what it has read in this window has all messages in order. A message that is put
later still has the earliest log time that this allows; its publish time, and the times in it, stay its own.
"""

import contextlib
import ctypes
import json
import math
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, NamedTuple

from mcap.writer import CompressionType, Writer

from hil_bridge.errors import BridgeError
from hil_bridge.errors.event_kinds import EventKind
from hil_bridge.record.files import open_record
from hil_bridge.record.records import EventRecord
from hil_bridge.record.scenes import SCENE_TOPICS, Scenes, SceneTopic, encode
from hil_bridge.record.time_axis import TimeAxis
from hil_bridge.record.topics import RECORDS, TOPICS, Record, Topic

METADATA_NAME = "run"
DEVICES_NAME = "devices"
"""Facts of the devices once they are ready: JSON by device."""
END_NAME = "end"
"""Written by an orderly end only; its absence tells a reader that the run was cut off."""
DROPPED_PREFIX = "dropped"

QUEUE_RECORDS = 16384
"""Records that wait for the writer at most: about 16 s of a 1 kHz sensor stream, 5 MB."""
BATCH_RECORDS = 512
"""Records taken at once where writing happens in the caller's thread."""
WAKE_SECONDS = 0.05
"""The writer thread wakes by itself, so that putting a record never has to wake it."""
PATIENCE_SECONDS = 0.5
"""For so long the writer waits for the next pause of a loop that tells its pauses, and for pauses to empty the queue.
Chosen: a cycle of a slow line.
"""
JOIN_SECONDS = 10.0
MAPPED_FROM = 1 << 17
"""Buffers from this size on, bytes, have pages of their own. Standard: what glibc begins with."""
_M_MMAP_THRESHOLD = -3
"""Source: glibc, malloc.h."""


@dataclass(frozen=True, slots=True)
class Chunks:
    """When a chunk of the file is finished: what is not in a finished one is lost with a killed process.

    Every chunk stays in the index at the file's end, and so in memory until then: some 0.7 KiB each.
    """

    seconds: float
    """Longest time from its first record to its last, s on the run's clock."""
    size: int
    """Most bytes of its records before compression. The chunk that is being filled is in memory, some of it twice."""


CHUNKS = Chunks(seconds=1.0, size=1 << 20)
"""In real time: a killed process loses a second, and what waits for a pause. Chosen."""
VIRTUAL_CHUNKS = Chunks(seconds=math.inf, size=1 << 18)
"""In virtual time: a killed run can be had again. Chosen: all of one size, so that a long run soon has had the memory
that it takes.
"""


class Writing(NamedTuple):
    """The way from a record to the file."""

    threaded: bool
    """In a thread of its own. Without it the caller's `put` writes a batch now and then, and the file depends on the
    records alone.
    """
    chunks: Chunks = CHUNKS
    queue_records: int = QUEUE_RECORDS
    """Records that wait at most."""


REAL_TIME = Writing(threaded=True)
VIRTUAL = Writing(threaded=False, chunks=VIRTUAL_CHUNKS)


def map_buffers() -> None:
    """Let the buffers of chunks go back to the system one by one, where the C library can be told to (glibc).

    By itself it raises the threshold to the largest one freed, after which chunks of changing sizes leave holes in the
    heap between what stays. Reference: mallopt(3). It holds for the whole process, so it is for a program of our own.
    """
    if (mallopt := getattr(ctypes.CDLL(None), "mallopt", None)) is not None:
        mallopt(_M_MMAP_THRESHOLD, MAPPED_FROM)


class Recorder:
    """Takes records without blocking and writes them to one file.

    `put`, `pause` and `close` belong to one thread, that of the event loop. A failing disk does not stop a run. The
    error is kept in `error` and told in `trouble`, later records are counted as dropped, and `close` raises it.
    """

    takes = RECORDS
    """Setting of a run's watcher: it takes all records."""

    def __init__(
        self,
        path: Path,
        wall_ns: Callable[[float], int],
        metadata: Mapping[str, str],
        writing: Writing,
        overwrite: bool = False,
    ) -> None:
        """Open the file and write what is known before the run.

        `wall_ns` turns a time of the run's clock into ns since the Unix epoch. A file that is there already is emptied
        only with `overwrite`. Raises ConfigError when the file cannot be opened.
        """
        self._path = path
        self._wall_ns = wall_ns
        self._capacity = writing.queue_records
        self._queue: deque[Record] = deque()
        self._devices: Mapping[str, str] = {}
        """Facts that wait to be written."""
        self._attachments: dict[str, tuple[str, bytes]] = {}
        self._topics: dict[type, Topic] = {topic.record: topic for topic in TOPICS}
        self._dropped = dict.fromkeys((topic.name for topic in TOPICS), 0)
        self._written = dict.fromkeys((topic.name for topic in TOPICS), 0)
        self._error: BridgeError | None = None
        self.trouble = ""
        """Why the file will not hold everything, in words that follow its name, as soon as that is known."""
        self._chunk_seconds = writing.chunks.seconds
        self._chunk_began: float | None = None
        self._axis = TimeAxis(wall_ns)
        self._closed = False
        self._file: BinaryIO = open_record(path, overwrite)
        self._writer = Writer(self._file, chunk_size=writing.chunks.size, compression=CompressionType.ZSTD)
        self._flush: Callable[[], None] = self._writer.flush
        self._channels: dict[type, int] = {}
        self._scenes = Scenes(wall_ns)
        self._scene_channels: dict[str, int] = {}
        self._guarded(lambda: self._begin(metadata))
        self._stopping = False
        self._pause_ends = 0.0
        """End of the pause on the system's monotonic clock, which the writer reads."""
        self._wake = threading.Lock()
        """Held while the writer has no reason to wake; only the loop's thread releases it."""
        self._wake.acquire()
        self._thread: threading.Thread | None = None
        if writing.threaded:
            self._thread = threading.Thread(target=self._work, name="recorder", daemon=True)
            self._thread.start()

    def _begin(self, metadata: Mapping[str, str]) -> None:
        self._writer.start(profile="", library="hil-bridge")
        self._writer.add_metadata(METADATA_NAME, dict(sorted(metadata.items())))
        self._channels = {topic.record: self._register(topic) for topic in TOPICS}
        self._scene_channels = {topic.name: self._register(topic) for topic in SCENE_TOPICS}
        self._flush()

    def _register(self, topic: Topic | SceneTopic) -> int:
        schema = json.dumps(topic.schema, separators=(",", ":"), ensure_ascii=False).encode()
        schema_id: int = self._writer.register_schema(topic.schema_name, "jsonschema", schema)
        channel_id: int = self._writer.register_channel(topic.name, "json", schema_id)
        return channel_id

    @property
    def error(self) -> BridgeError | None:
        """Error that ended the writing early, or None."""
        return self._error

    @property
    def dropped(self) -> Mapping[str, int]:
        """Records that did not reach the file, by topic."""
        return dict(self._dropped)

    def put(self, record: Record) -> None:
        """Take a record. The newest is dropped and counted when the queue is full or writing has failed."""
        if len(self._queue) >= self._capacity or self._error is not None or self._closed:
            self._dropped[self._topics[type(record)].name] += 1
            self.trouble = self.trouble or "has gaps: the disk does not keep up"
            return
        self._queue.append(record)
        if self._thread is None and len(self._queue) >= BATCH_RECORDS:
            self._drain()

    def devices(self, facts: Mapping[str, str]) -> None:
        """Take what is known of the devices, JSON by name; it is written before the records that wait."""
        self._devices = facts

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """Take an attachment, which is written at the end; a later one of the same name replaces it."""
        self._attachments[name] = (media_type, data)

    def pause(self, seconds: float) -> None:
        """Tell that the loop awaits nothing for so long: the writer thread works then. From one pause to the next it
        lets the loop have the interpreter to itself, unless the pauses do not suffice or no other comes.
        """
        if self._thread is not None:
            self._pause_ends = time.monotonic() + seconds
            self._let_write()

    def _let_write(self) -> None:
        if self._wake.locked():
            self._wake.release()

    def close(self, end: Mapping[str, str] | None = None) -> None:
        """Write what waits, the counts of dropped records and `end` (see `RunEnd.as_metadata`).

        Harmless when called again. Raises BridgeError when the file is incomplete because writing failed.
        """
        if self._closed:
            return
        self._closed = True
        if self._thread is not None:
            self._stopping = True
            self._let_write()
            self._thread.join(JOIN_SECONDS)
            if self._thread.is_alive():
                raise BridgeError(f"the recording {self._path} is incomplete: the disk does not take it")
        self._drain()
        if self._error is None:
            try:
                self._finish(end or {})
            except Exception as error:
                self._fail(error)
        if self._error is not None:
            for record in self._queue:
                self._dropped[self._topics[type(record)].name] += 1
            raise self._error

    def _finish(self, end: Mapping[str, str]) -> None:
        if any(self._dropped.values()):
            counts = ", ".join(f"{count} of {topic}" for topic, count in self._dropped.items() if count)
            self._write(EventRecord(self._axis.newest, EventKind.RECORDER, f"records dropped: {counts}"))
        self._flush()
        for name, (media_type, data) in self._attachments.items():
            at = self._wall_ns(self._axis.newest)
            self._writer.add_attachment(at, at, name, media_type, data)
        drops = {f"{DROPPED_PREFIX}{topic}": str(count) for topic, count in self._dropped.items()}
        self._writer.add_metadata(END_NAME, dict(sorted({**end, **drops}.items())))
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._file.close()

    def _work(self) -> None:
        """Write records in a thread: drain in bursts, and finish a chunk when nothing more comes."""
        idle, wait, emptied = 0.0, WAKE_SECONDS, time.monotonic()
        while True:
            paused = self._wake.acquire(timeout=wait)
            if self._stopping:
                return
            now = time.monotonic()
            if not self._queue:
                emptied = now
            idle = 0.0 if self._queue or paused else idle + wait
            wait = PATIENCE_SECONDS if paused else WAKE_SECONDS
            self._drain(self._pause_ends if paused and now - emptied < PATIENCE_SECONDS else math.inf)
            if not self._queue:
                emptied = time.monotonic()
            if idle >= self._chunk_seconds and self._chunk_began is not None:
                self._guarded(self._end_chunk)

    def _drain(self, ends: float = math.inf) -> None:
        """Write what waits, until this time of the system's monotonic clock."""
        if self._error is None:
            self._guarded(lambda: self._write_queue(ends))

    def _guarded(self, step: Callable[[], None]) -> None:
        """Keep any error for the end: nothing that happens to a file may stop a robot's control loop."""
        try:
            step()
        except Exception as error:
            self._fail(error)

    def _fail(self, error: Exception) -> None:
        cause = (error.strerror if isinstance(error, OSError) else None) or f"{type(error).__name__}: {error}"
        trouble = f"is incomplete: {cause}"
        self._error = BridgeError(f"the recording {self._path} {trouble}")
        self._error.__cause__ = error
        self.trouble = trouble
        with contextlib.suppress(OSError):  # the same full disk again; the first error is the one that tells
            self._file.close()

    def _write_queue(self, ends: float) -> None:
        queue = self._queue
        if self._devices:
            facts, self._devices = self._devices, {}
            self._end_chunk()
            self._writer.add_metadata(DEVICES_NAME, dict(sorted(facts.items())))
        while queue and (ends == math.inf or time.monotonic() < ends):
            self._write(queue.popleft())

    def _write(self, record: Record) -> None:
        topic = self._topics[type(record)]
        record, at, placed = self._axis.place(topic, record)
        if self._chunk_began is None:
            self._chunk_began = at
        self._writer.add_message(
            self._channels[type(record)],
            placed,
            topic.encode(record),
            self._wall_ns(at),
            self._written[topic.name],
        )
        self._written[topic.name] += 1
        for scene, message in self._scenes.of(record):
            self._writer.add_message(
                self._scene_channels[scene.name], placed, encode(message), self._wall_ns(at)
            )
        if at - self._chunk_began >= self._chunk_seconds:
            self._end_chunk()

    def _end_chunk(self) -> None:
        self._chunk_began = None
        self._flush()
