"""Records of a run and the files that store them."""

from hil_bridge.errors.event_kinds import EventKind
from hil_bridge.record.ending import Outcome, RunEnd
from hil_bridge.record.link_log import LINK_EVENT, LinkLog
from hil_bridge.record.reader import RawTraffic, Recording, read, read_link, read_with_traffic
from hil_bridge.record.recorder import REAL_TIME, VIRTUAL, VIRTUAL_CHUNKS, Chunks, Recorder, Writing
from hil_bridge.record.records import (
    CycleRecord,
    EventRecord,
    LinkRecord,
    SensorRecord,
    StepRecord,
    TruthRecord,
    WireRecord,
)

__all__ = [
    "LINK_EVENT",
    "REAL_TIME",
    "VIRTUAL",
    "VIRTUAL_CHUNKS",
    "Chunks",
    "CycleRecord",
    "EventKind",
    "EventRecord",
    "LinkLog",
    "LinkRecord",
    "Outcome",
    "RawTraffic",
    "Recorder",
    "Recording",
    "RunEnd",
    "SensorRecord",
    "StepRecord",
    "TruthRecord",
    "WireRecord",
    "Writing",
    "read",
    "read_link",
    "read_with_traffic",
]
