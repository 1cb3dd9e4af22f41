"""Recording for programs and notebooks, with arrays, figures, plots and a report."""

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
    """Control cycles of a run as arrays, by the field names of `CycleRecord`, and the arrays of its other records.

    The array `time`, shape (n,), holds the times at which the force was sampled, in s since the start of the run,
    as in charts.
    """

    def __init__(self, recording: reader.Recording) -> None:
        super().__init__(recording.cycles, CycleRecord)
        self.truths = Columns(recording.truths, TruthRecord)
        """Records of the ground truth in each cycle."""
        self.sensors = Columns(recording.sensors, SensorRecord)
        """Records of the sensor's frames, in counts."""
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
    """Recording of a run, with arrays, figures, plots and the report."""

    @classmethod
    def of(cls, recording: reader.Recording) -> "Recording":
        """Return a recording with the given records."""
        return cls(**{field.name: getattr(recording, field.name) for field in fields(recording)})

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
        """Cycles as arrays by field: `arrays.force` has shape (n,), `arrays.position` has shape (n, 3). Unknown
        values are NaN.

        `arrays.truths`, `.sensors`, `.events` and `.steps` hold the other records. `arrays.time` begins at 0.
        """
        return Arrays(self)

    @cached_property
    def figures(self) -> Summary:
        """Figures of merit, durations, counters and latency. Raises ConfigError for a run without any cycle."""
        self._need_cycles("figures")
        return summarise(self)

    def plot(self, *charts: str) -> "Figure":
        """Return a matplotlib figure with the charts of the report. The ids select charts, as in `plot("force")`;
        without ids, all charts are drawn.

        Raises ConfigError for an unknown id, for a run without any cycle, or if matplotlib is not installed.
        """
        from hil_bridge.show.report.plots import plot

        self._need_cycles("charts")
        return plot(self, charts)

    def report(self, directory: Path | str, *, overwrite: bool = False) -> Path:
        """Write the report of the run into a directory, and return the path of its page.

        Raises ConfigError for a run without any cycle, or if the report cannot be written, or if it already exists
        and `overwrite` is not set.
        """
        from hil_bridge.show.report.page import write_report

        return write_report(self, self.figures, Path(directory), overwrite)

    def _need_cycles(self, thing: str) -> None:
        if not self.cycles:
            raise ConfigError(f"the run ended before its first control cycle: it has no {thing}")


def read(path: Path | str, bag: BagChoices | None = None) -> Recording:
    """Read a recording from a file, or from a ROS 2 bag, which may be a folder or only its MCAP file.

    A bag needs the extra `ros`. It contains a sample for each wrench instead of a cycle. Missing data, such as
    decisions and verdicts, is NaN or empty. `bag` selects the topics and sets assumptions about them. Raises
    ConfigError for a file that cannot be used.
    """
    return Recording.of(read_any(Path(path), bag))
