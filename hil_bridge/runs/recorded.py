"""Recording for programs and notebooks, with arrays, figures, plots and its report."""

from dataclasses import fields
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from hil_bridge.errors import ConfigError
from hil_bridge.record import CycleRecord, EventRecord, SensorRecord, StepRecord, TruthRecord, reader
from hil_bridge.record.analysis.columns import Column, Columns
from hil_bridge.record.analysis.summary import Summary, summarise
from hil_bridge.record.foreign import BagChoices
from hil_bridge.record.ros.bag_reader import read_any
from hil_bridge.show.charts.facts import start_time

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_TIME = "time"


class Arrays(Columns):
    """The control cycles of a run as arrays, by the names of `CycleRecord`, and those of its other records.

    The array `time` (n,) has the times at which the force was sampled, s since the begin of the run, as in charts.
    """

    def __init__(self, recording: reader.Recording) -> None:
        super().__init__(recording.cycles, CycleRecord)
        self.truths = Columns(recording.truths, TruthRecord)
        """Ground truth of the cycles."""
        self.sensors = Columns(recording.sensors, SensorRecord)
        """Frames of the sensor, as the device counts."""
        self.events = Columns(recording.events, EventRecord)
        self.steps = Columns(recording.steps, StepRecord)
        self._began = start_time(recording)
        self._widths = {_TIME: 0, **self._widths}

    def __getitem__(self, name: str) -> Column:
        if name == _TIME and name not in self._made:
            since = np.asarray(super().__getitem__("controlled_at") - self._began)
            since.flags.writeable = False
            self._made[name] = since
        return super().__getitem__(name)


class Recording(reader.Recording):
    """Records of a run, with arrays, figures, plots and the report."""

    @classmethod
    def of(cls, found: reader.Recording) -> "Recording":
        """Return a recording of the same records."""
        return cls(**{field.name: getattr(found, field.name) for field in fields(found)})

    def __repr__(self) -> str:
        if self.foreign is not None:
            return f"<Recording: the bag {self.foreign.file}; {len(self.cycles)} samples>"
        outcome = self.end.get("outcome", "cut off")
        return f"<Recording: {outcome}; {len(self.cycles)} cycles, {len(self.sensors)} frames of the sensor>"

    def _repr_html_(self) -> str:
        from hil_bridge.show.report.notebook import run_html

        return run_html(self)

    @cached_property
    def arrays(self) -> Arrays:
        """The cycles as arrays by field: `arrays.force` is (n,), `arrays.position` (n, 3); NaN for what is not known.

        `arrays.truths`, `.sensors`, `.events` and `.steps` are those of the other records. `arrays.time` begins at 0.
        """
        return Arrays(self)

    @cached_property
    def figures(self) -> Summary:
        """Figures of merit, durations, counters, latency. Raises ConfigError for a run without any cycle."""
        self._need_cycles("figures")
        return summarise(self)

    def plot(self, *charts: str) -> "Figure":
        """Return a matplotlib figure with the charts of the report, all or those of these ids, as `plot("force")`.

        Raises ConfigError for an id that is none, for a run without any cycle, and where matplotlib is not installed.
        """
        from hil_bridge.show.report.plots import plot

        self._need_cycles("charts")
        return plot(self, charts)

    def report(self, directory: Path | str, *, overwrite: bool = False) -> Path:
        """Write the report of the run into a directory; the answer is its page.

        Raises ConfigError where it cannot be written or, without `overwrite`, is there already, and for a run without
        any cycle.
        """
        from hil_bridge.show.report.page import write_report

        return write_report(self, self.figures, Path(directory), overwrite)

    def _need_cycles(self, thing: str) -> None:
        if not self.cycles:
            raise ConfigError(f"the run ended before its first control cycle: it has no {thing}")


def read(path: Path | str, bag: BagChoices | None = None) -> Recording:
    """Read the recording in a file, or a bag of ROS 2 as a recording: a folder, or its MCAP file alone.

    A bag needs the extra `ros`. It has a sample for each wrench in place of a cycle; what it does not tell, as
    decisions and verdicts, is NaN or empty. `bag` says which topics are taken, and what is taken for granted of them.
    Raises ConfigError for a file that cannot be used.
    """
    return Recording.of(read_any(Path(path), bag))
