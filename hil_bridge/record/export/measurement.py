"""Recording as a measurement file, MDF 4.10 of ASAM, for test bench tools.

A group holds the channels of one rate: `sensor`, `cycle`, `truth`, and `event` with texts. Times are seconds since
the zero of the run's clock. The start time of the file is the UTC time of that zero. Events are also written as MDF
event blocks.
"""

import tempfile
from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from hil_bridge.control.sample import Sample
from hil_bridge.errors import ConfigError
from hil_bridge.errors.extras import install_command
from hil_bridge.record import CycleRecord, EventRecord, Recording, SensorRecord, TruthRecord
from hil_bridge.record.analysis.columns import Columns, unit_of
from hil_bridge.record.device_facts import devices_of
from hil_bridge.record.export.tables import COLUMNS_MAX, TIME, sensor_table
from hil_bridge.record.field_docstrings import field_docstrings
from hil_bridge.record.scenes import escape_surrogates

_ENCODINGS: Mapping[str, str] = {"S": "utf-8"}
"""MDF encoding of values, by the kind of the NumPy type."""
_NS = 1e-9
"""Resolution of an event's time, s. Chosen."""
_TIME_MAX_NS = 1 << 63
"""Upper bound of a time, ns. Source: the event block of MDF 4 uses signed 64-bit times."""


def measurement(recording: Recording) -> tuple[bytes, int]:
    """Return the file, and the number of its channels, excluding the time channels.

    Raises ConfigError if asammdf is not installed, and for a recording without any measured data.
    """
    try:
        from asammdf import MDF, Signal
        from asammdf.blocks import v4_constants
        from asammdf.blocks.v4_blocks import EventBlock
    except ImportError as error:
        raise ConfigError(f"a measurement needs the package asammdf; {install_command('mdf')}") from error
    groups = dict(_groups(recording))
    if not 0 <= recording.unix_zero_ns < _TIME_MAX_NS:
        raise ConfigError("its time is out of range for MDF; give --to csv")
    if sum(len(channels) for _, channels in groups.values()) > COLUMNS_MAX:
        raise ConfigError(
            f"it has more than {COLUMNS_MAX} channels; reduce the explanation values of the controller"
        )
    if not groups:
        raise ConfigError("it has no data to measure; give --to bytes")
    with tempfile.TemporaryDirectory() as folder, MDF(version="4.10") as file:
        file.start_time = datetime.fromtimestamp(recording.unix_zero_ns / 1e9, UTC)
        file.header.comment = f"hil-bridge {recording.metadata.get('version', '')}"
        count = 0
        for name, (times, channels) in groups.items():
            signals = [
                Signal(
                    values,
                    times,
                    name=escape_surrogates(f"{name}.{key}"),
                    unit=unit,
                    comment=comment,
                    encoding=_ENCODINGS.get(values.dtype.kind),
                )
                for key, values, unit, comment in channels
            ]
            file.append(signals, acq_name=name, comment=name, common_timebase=True)
            count += len(signals)
        for event in _select_timed(recording.events):
            block = EventBlock(
                event_type=v4_constants.EVENT_TYPE_MARKER,
                cause=v4_constants.EVENT_CAUSE_SCRIPT,
                sync_base=round(event.at / _NS),
                sync_factor=_NS,
            )
            block.name, block.comment = event.kind, escape_surrogates(event.text)
            file.events.append(block)
        return file.save(Path(folder) / "run.mf4").read_bytes(), count


_Channel = tuple[str, NDArray[Any], str, str]
"""Name, values, unit and description of a channel."""


def _groups(recording: Recording) -> Iterator[tuple[str, tuple[NDArray[Any], list[_Channel]]]]:
    """Return times and channels of each group."""
    facts = devices_of(recording).sensor.facts
    if recording.sensors:
        yield "sensor", _sensor(recording.sensors, None if facts is None else facts.scales)
    if recording.cycles:
        yield "cycle", _records(recording.cycles, CycleRecord, "controlled_at")
    if recording.truths:
        yield "truth", _records(recording.truths, TruthRecord, "at")
    if events := _select_timed(recording.events):
        yield "event", _events(events)


def _sensor(frames: Sequence[SensorRecord], scales: Any) -> tuple[NDArray[Any], list[_Channel]]:
    table = sensor_table(frames, scales)
    columns = {
        name: np.array(values, dtype=np.float64 if None in values else None) for name, values in table.items()
    }
    time = columns.pop(TIME)
    return time, [(name, values, unit_of(name), "") for name, values in columns.items()]


def _records(records: Sequence[Struct], kind: type[Struct], time: str) -> tuple[NDArray[Any], list[_Channel]]:
    """Return every numeric column, with rows in order of time."""
    columns = Columns(records, kind)
    own, sampled = field_docstrings(kind), field_docstrings(Sample)
    order = np.argsort(columns[time], kind="stable")
    channels = []
    for field, name, values in columns.named():
        if values.dtype == object or name == time:
            continue
        numbers = values.astype(np.uint8) if values.dtype == bool else values
        of_sample, _, name_in_record = columns.path(field).rpartition(".")
        text = (sampled if of_sample else own).get(name_in_record, "")
        channels.append((name, numbers[order], unit_of(name), text))
    return columns[time][order], channels


def _select_timed(events: Sequence[EventRecord]) -> list[EventRecord]:
    """Return the events whose time is known, in order."""
    return sorted(
        (event for event in events if abs(event.at) < _TIME_MAX_NS * _NS), key=lambda event: event.at
    )


def _events(events: Sequence[EventRecord]) -> tuple[NDArray[Any], list[_Channel]]:
    texts = field_docstrings(EventRecord)
    channels = [
        (
            name,
            np.array([escape_surrogates(getattr(event, name)).encode() for event in events]),
            "",
            texts[name],
        )
        for name in ("kind", "text")
    ]
    return np.array([event.at for event in events]), channels
