"""In-memory record of a run, with the interface of `Recorder`. It is saved to a file on request, or if it gets too
long.
"""

import math
from collections import defaultdict
from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

from hil_bridge.record import records
from hil_bridge.record.reader import RawTraffic, Recording
from hil_bridge.record.recorder import DROPPED_PREFIX, VIRTUAL, Recorder
from hil_bridge.record.removed_map import REMOVED_NAME, from_json
from hil_bridge.record.topics import RECORDS, TOPICS, Record

_TIMES: Mapping[type, Callable[[Any], float]] = {topic.record: topic.time_of for topic in TOPICS}
READ_RECORDS = (
    records.CycleRecord,
    records.SensorRecord,
    records.TruthRecord,
    records.EventRecord,
    records.StepRecord,
)
"""Record types that `read` returns. The first record of these types defines the UNIX time at the zero of the clock."""


class _Attachment(NamedTuple):
    name: str
    media_type: str
    data: bytes


_Step: TypeAlias = Record | _Attachment | Mapping[str, str]
"""Input of a recorder; a mapping holds the facts of the devices."""


class KeptRecords:
    """Recorder that keeps the records in memory. Nothing is encoded before `save` is called."""

    def __init__(
        self,
        wall_ns: Callable[[float], int],
        metadata: Mapping[str, str],
        takes: Collection[type] = RECORDS,
        most: int | None = None,
        spill: Path | None = None,
    ) -> None:
        """Arguments as for `Recorder`: `wall_ns` converts a time on the run's clock to ns since the Unix epoch.

        `takes` holds the types of records to keep. If there are more than `most` records, all are moved to the new
        file `spill`, where those that follow are written as well, or discarded if there is no such file.
        """
        self._most = most
        self._spill = spill
        self._file: Recorder | None = None
        self.is_whole = True
        """Whether the memory contains all records; False once they have been moved or discarded."""
        self._kinds = takes
        self._wall_ns = wall_ns
        self._metadata = dict(sorted(metadata.items()))
        self._steps: list[_Step] = []
        self._end: Mapping[str, str] | None = None

    @property
    def takes(self) -> Mapping[type, Callable[[Any], object]]:
        """Function that accepts records, by the types of records to keep."""
        return dict.fromkeys(self._kinds, self.put)

    def put(self, record: Record) -> None:
        """Add a record. Records after the end are ignored."""
        if self._end is not None:
            return
        if self.is_whole:
            self._steps.append(record)
            if self._most is not None and len(self._steps) > self._most:
                self._leave_memory()
        elif self._file is not None:
            self._file.put(record)

    def _leave_memory(self) -> None:
        """Move all records to the file, or discard them if there is none. Raises ConfigError for an invalid path."""
        if self._spill is not None:
            self._file = self._written(self._spill, overwrite=False)
        self._steps, self.is_whole = [], False

    def devices(self, facts: Mapping[str, str]) -> None:
        """Store the facts of the devices, JSON by name."""
        if self._file is not None:
            self._file.devices(facts)
        self._steps.append(dict(facts))

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """Add an attachment; it replaces an earlier attachment with the same name."""
        if self._file is not None:
            self._file.attach(name, media_type, data)
        self._steps.append(_Attachment(name, media_type, data))

    def pause(self, seconds: float) -> None:
        """Do nothing, because there is no writer thread."""

    def close(self, end: Mapping[str, str]) -> None:
        """Store the metadata of the end. Idempotent. Raises BridgeError if the file is incomplete."""
        if self._end is None:
            self._end = dict(end)
            self._steps = _add_times(self._steps)
        if self._file is not None:
            self._file.close(end)

    @property
    def traffic(self) -> RawTraffic:
        """Raw traffic of the wires."""
        return RawTraffic(
            tuple(step for step in self._steps if type(step) is records.LinkRecord),
            tuple(step for step in self._steps if type(step) is records.WireRecord),
        )

    def recording(self) -> Recording:
        """Return the recording that `read` would return for the file that `save` writes."""
        assert self._end is not None, "the run has not ended"
        kept: defaultdict[type, list[Any]] = defaultdict(list)
        for step in self._steps:
            kept[type(step)].append(step)
        devices = kept[dict][-1] if kept[dict] else {}
        removed = [from_json(one.data) for one in kept[_Attachment] if one.name == REMOVED_NAME]
        drops = {f"{DROPPED_PREFIX}{topic.name}": "0" for topic in TOPICS}
        return Recording(
            tuple(kept[records.CycleRecord]),
            tuple(kept[records.SensorRecord]),
            tuple(kept[records.EventRecord]),
            self._metadata,
            dict(sorted({**self._end, **drops}.items())),
            truths=tuple(kept[records.TruthRecord]),
            devices=dict(sorted(devices.items())),
            unix_zero_ns=self._unix_zero_ns(),
            steps=tuple(kept[records.StepRecord]),
            removed=removed[-1] if removed else None,
        )

    def _unix_zero_ns(self) -> int:
        """UNIX time at which the run's clock was 0, ns."""
        first = next((step for step in self._steps if isinstance(step, READ_RECORDS)), None)
        if first is None:
            return 0
        at = _TIMES[type(first)](first)
        return self._wall_ns(at) - round(at * 1e9)

    def save(self, path: Path, overwrite: bool = False) -> None:
        """Write the same file that a `Recorder` would have written.

        Raises ConfigError for an invalid path, BridgeError for a disk error.
        """
        self._written(path, overwrite).close(self._end)

    def _written(self, path: Path, overwrite: bool) -> Recorder:
        """Return the recorder of a file that holds all records, and is not closed."""
        recorder = Recorder(path, self._wall_ns, self._metadata, VIRTUAL, overwrite)
        for step in self._steps:
            if isinstance(step, dict):
                recorder.devices(step)
            elif type(step) is _Attachment:
                recorder.attach(*step)
            else:
                recorder.put(step)  # type: ignore[arg-type]
        return recorder


def _add_times(steps: list[_Step]) -> list[_Step]:
    """Return the steps with a time: a record without a time gets the time of the previous record, as in the file."""
    newest, timed = 0.0, list(steps)
    for place, step in enumerate(steps):
        if (time_of := _TIMES.get(type(step))) is None:
            continue
        at = time_of(step)
        if math.isfinite(at):
            newest = max(newest, at)
        else:
            topic = next(topic for topic in TOPICS if topic.record is type(step))
            timed[place] = topic.timed(step, newest)  # type: ignore[arg-type]
    return timed
