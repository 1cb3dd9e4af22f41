"""Recorder of a run: an MCAP file written outside the control path.

Messages are stored in the order in which `put` received them, which is not exactly the order of their log times.
The log time of a cycle is the time of its decision, but `put` receives the cycle at its end. A section of a wire's
log has the time of its first piece. The ground truth of an emulated cell waits for the robot's motion. No log time
is more than ORDER_WINDOW_S before the log time of an earlier message in the file, so a reader that sorts within
this window gets all messages in order. A message that arrives even later gets the earliest log time allowed; its
publish time, and the times in it, are unchanged.
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
from typing import Any, BinaryIO, NamedTuple

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
"""Name of the metadata that hold the facts of the devices, JSON by device, written once the devices are ready."""
END_NAME = "end"
"""Name of the metadata written only at an orderly end. If they are missing, the run was cut off."""
DROPPED_PREFIX = "dropped"

QUEUE_RECORDS = 16384
"""Maximum number of records that wait for the writer: about 16 s of a 1 kHz sensor stream, 5 MB."""
BATCH_RECORDS = 512
"""Number of records per batch when records are written in the caller's thread."""
WAKE_SECONDS = 0.05
"""Interval at which the writer thread wakes, so that `put` never has to wake it, s."""
PATIENCE_SECONDS = 0.5
"""Longest time that the writer waits for the next pause of the loop, and for pauses to empty the queue, s.

Chosen: one cycle of a slow link.
"""
JOIN_SECONDS = 10.0
MMAP_MIN_BYTES = 1 << 17
"""Smallest buffer that gets its own memory mapping, bytes. Standard: the initial value of glibc."""
_M_MMAP_THRESHOLD = -3
"""Parameter number of the threshold in mallopt. Source: glibc, malloc.h."""


@dataclass(frozen=True, slots=True)
class Chunks:
    """Limits at which a chunk of the file is finished; a killed process loses the unfinished chunk.

    The index entry of every chunk, about 0.7 KiB, stays in memory until the end of the file.
    """

    seconds: float
    """Longest time from the first record of a chunk to the last one, s on the run's clock."""
    size: int
    """Maximum size of the records of a chunk before compression, bytes. The current chunk is in memory, parts of it
    twice.
    """


CHUNKS = Chunks(seconds=1.0, size=1 << 20)
"""Limits in real time: a killed process loses one second and the records that wait for a pause. Chosen."""
VIRTUAL_CHUNKS = Chunks(seconds=math.inf, size=1 << 18)
"""Limits in virtual time, where a killed run can be repeated.

Chosen: all chunks have the same size, so that the memory use of a long run soon stops growing.
"""


class Writing(NamedTuple):
    """Settings of how records are written to the file."""

    threaded: bool
    """Whether a separate thread writes. If not, `put` occasionally writes a batch in the caller's thread.

    The file contents then depend only on the records.
    """
    chunks: Chunks = CHUNKS
    queue_records: int = QUEUE_RECORDS
    """Maximum number of waiting records."""


REAL_TIME = Writing(threaded=True)
VIRTUAL = Writing(threaded=False, chunks=VIRTUAL_CHUNKS)


def map_buffers() -> None:
    """Let the C library return the buffers of chunks to the system one by one, if it supports this (glibc).

    By default, glibc raises the threshold to the largest freed buffer, and chunks of varying size then fragment the
    heap. Reference: mallopt(3). The call affects the entire process, so only the program itself may make it, not a
    library.
    """
    if (mallopt := getattr(ctypes.CDLL(None), "mallopt", None)) is not None:
        mallopt(_M_MMAP_THRESHOLD, MMAP_MIN_BYTES)


class Recorder:
    """Recorder that accepts records without blocking and writes them to one file.

    Call `put`, `pause` and `close` only from the event loop's thread. A failing disk does not stop a run: the error
    is stored in `error` and described in `trouble`, later records are counted as dropped, and `close` raises the
    error.
    """

    def __init__(
        self,
        path: Path,
        wall_ns: Callable[[float], int],
        metadata: Mapping[str, str],
        writing: Writing,
        overwrite: bool = False,
    ) -> None:
        """Open the file and write the metadata that are known before the run.

        `wall_ns` converts a time on the run's clock to ns since the Unix epoch. An existing file is truncated only
        with `overwrite`. Raises ConfigError if the file cannot be opened.
        """
        self._path = path
        self._wall_ns = wall_ns
        self._capacity = writing.queue_records
        self._queue: deque[Record] = deque()
        self._devices: Mapping[str, str] = {}
        """Facts of the devices that are not yet written."""
        self._attachments: dict[str, tuple[str, bytes]] = {}
        self._topics: dict[type, Topic] = {topic.record: topic for topic in TOPICS}
        self._dropped = dict.fromkeys((topic.name for topic in TOPICS), 0)
        self._written = dict.fromkeys((topic.name for topic in TOPICS), 0)
        self._error: BridgeError | None = None
        self.trouble = ""
        """Reason why the file will be incomplete, as text to follow the file name; set as soon as it is known."""
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
        self._keep_error(lambda: self._begin(metadata))
        self._stopping = False
        self._pause_ends = 0.0
        """End of the pause on the system's monotonic clock, which the writer reads."""
        self._wake = threading.Lock()
        """Lock held while the writer has no reason to wake. Only the loop's thread releases it."""
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
        """Error that ended the writing early; None if there was no error."""
        return self._error

    @property
    def dropped(self) -> Mapping[str, int]:
        """Number of records that did not reach the file, by topic."""
        return dict(self._dropped)

    @property
    def takes(self) -> Mapping[type, Callable[[Any], object]]:
        """Function that accepts records, for all types of records."""
        return dict.fromkeys(RECORDS, self.put)

    def put(self, record: Record) -> None:
        """Add a record. It is dropped and counted if the queue is full or writing has failed."""
        if len(self._queue) >= self._capacity or self._error is not None or self._closed:
            self._dropped[self._topics[type(record)].name] += 1
            self.trouble = self.trouble or "has gaps: the disk does not keep up"
            return
        self._queue.append(record)
        if self._thread is None and len(self._queue) >= BATCH_RECORDS:
            self._drain()

    def devices(self, facts: Mapping[str, str]) -> None:
        """Store the facts of the devices, JSON by name; they are written before the waiting records."""
        self._devices = facts

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """Add an attachment, which is written at the end; it replaces an earlier attachment with the same name."""
        self._attachments[name] = (media_type, data)

    def pause(self, seconds: float) -> None:
        """Report that the loop will be idle for this time, so that the writer thread can work.

        Between pauses, the writer leaves the interpreter to the loop, unless the pauses are too short or no longer
        occur.
        """
        if self._thread is not None:
            self._pause_ends = time.monotonic() + seconds
            self._let_write()

    def _let_write(self) -> None:
        if self._wake.locked():
            self._wake.release()

    def close(self, end: Mapping[str, str] | None = None) -> None:
        """Write the waiting records, the counts of dropped records and `end` (see `RunEnd.as_metadata`).

        Idempotent. Raises BridgeError if the file is incomplete because writing failed.
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
        """Write records in a thread: drain the queue in bursts, and finish a chunk when no more records come."""
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
                self._keep_error(self._end_chunk)

    def _drain(self, ends: float = math.inf) -> None:
        """Write waiting records until this time on the system's monotonic clock."""
        if self._error is None:
            self._keep_error(lambda: self._write_queue(ends))

    def _keep_error(self, step: Callable[[], None]) -> None:
        """Store any error until the end, because no file error may stop a robot's control loop."""
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
        with contextlib.suppress(OSError):  # the disk is still full; the first error is the informative one
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
