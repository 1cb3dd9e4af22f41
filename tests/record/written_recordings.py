"""Recordings that tests write record by record, without a run."""

import math
from pathlib import Path
from typing import Any

from hil_bridge.control.sample import Sample
from hil_bridge.record import CycleRecord, EventKind, EventRecord, Recorder, SensorRecord, Writing
from hil_bridge.record.topics import Record

METADATA = {"seed": "7", "controller": "fuzzy-pi", "configuration": '{"force_n": 50.0}'}


def wall_ns(loop_time: float) -> int:
    return 1_700_000_000_000_000_000 + round(loop_time * 1e9)


def cycle_of(**values: Any) -> CycleRecord:
    """Return a cycle with these values, including those of its sample; by default the tool is stationary."""
    defaults: dict[str, Any] = {
        "position": (0.0,) * 3,
        "wrench": (0.0,) * 6,
        "quaternion": (1.0, 0.0, 0.0, 0.0),
        "depth": 0.0,
        "depth_commanded": 0.0,
        "travel_commanded": 0.0,
        "correction": 0.0,
    }
    values = defaults | values
    force, wrench = values["force"], values["wrench"]
    sample = {
        name: values.pop(name)
        for name in ("position", "wrench", "quaternion", "sensor_at", "sensor_sequence")
    }
    sample |= {"now": values.pop("status_at"), "force": force, "resultant": math.hypot(*wrench[:3])}
    return CycleRecord(sample=Sample(**sample), **values)


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
    return cycle_of(**(values | changes))


def stream(seconds: float = 3.0) -> list[Record]:
    """Return a 200 Hz sensor stream with a cycle every 0.16 s, in the order in which a run records them."""
    records: list[Record] = [EventRecord(100.0, EventKind.PHASE, "track – µ ü")]
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
