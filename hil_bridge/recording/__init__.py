"""What is kept of a run: records, the file they are written to, and what is summed up from them."""

from hil_bridge.recording.reader import Recording, read
from hil_bridge.recording.recorder import Recorder
from hil_bridge.recording.records import CycleRecord, EventRecord, SensorRecord
from hil_bridge.recording.summary import PHASE_EVENT, STOP_EVENT, Outcome, RunEnd, Summary, summarise

__all__ = [
    "PHASE_EVENT",
    "STOP_EVENT",
    "CycleRecord",
    "EventRecord",
    "Outcome",
    "Recorder",
    "Recording",
    "RunEnd",
    "SensorRecord",
    "Summary",
    "read",
    "summarise",
]
