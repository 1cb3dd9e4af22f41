"""Records of a run, and the file that they are written to."""

from hil_bridge.record.ending import CHECK_EVENT, PHASE_EVENT, STOP_EVENT, Outcome, RunEnd
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
    "CHECK_EVENT",
    "LINK_EVENT",
    "PHASE_EVENT",
    "REAL_TIME",
    "STOP_EVENT",
    "VIRTUAL",
    "VIRTUAL_CHUNKS",
    "Chunks",
    "CycleRecord",
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
