"""Facts for the end of a run: cycles, steps, faults, tracebacks, and texts for its views."""

from hil_bridge.record import CycleRecord, EventKind, EventRecord, StepRecord
from hil_bridge.runs.watchers import Listener
from protocol.faults import FaultStage


class Notes(Listener):
    """Watcher that keeps a few facts of a run."""

    def __init__(self) -> None:
        super().__init__({CycleRecord: self._cycle, EventRecord: self._event, StepRecord: self._step})
        self.cycles = 0
        """Number of cycles so far. A record without cycles has no figures."""
        self.steps: list[StepRecord] = []
        """Steps of a program that have ended."""
        self.faults: list[str] = []
        """Descriptions of the outcome of each injected fault."""
        self.bugs: list[str] = []
        """Tracebacks that the run reported."""
        self.traces: list[str] = []
        """Tracebacks of failures in plug-ins."""
        self.checked = self.warning = ""
        """Remarks on the sensor and descriptions of problems, for a page."""

    def _cycle(self, record: CycleRecord) -> None:
        self.cycles += 1

    def _step(self, record: StepRecord) -> None:
        self.steps.append(record)

    def _event(self, record: EventRecord) -> None:
        if record.kind == EventKind.BUG:
            self.bugs.append(record.text)
        elif record.kind == EventKind.TRACEBACK:
            self.traces.append(record.text)
        elif record.kind == EventKind.CHECK:
            self.checked = record.text
        elif record.fault is not None and record.fault.stage in (FaultStage.STRUCK, FaultStage.NEVER):
            self.faults.append(record.text)
