"""Charts of a recorded run, as one description for pages and pictures."""

from collections.abc import Mapping, Sequence

from hil_bridge.record.analysis.stream import stream_force
from hil_bridge.record.analysis.summary import end_of, phases
from hil_bridge.record.reader import Recording
from hil_bridge.show.charts.catalogue import STREAM, TRUTH, catalogue, layers, time_axis, with_values
from hil_bridge.show.charts.columns import Arrays, Columns
from hil_bridge.show.charts.events import fault_spans, marks_of, spans_of
from hil_bridge.show.charts.facts import ChartFacts, facts_of_recording, start_time
from hil_bridge.show.charts.sources import Sources
from hil_bridge.show.pages.description import Charts, Mark, Span


def run_charts(recording: Recording) -> Charts:
    """Return the charts of a run."""
    zero, facts = start_time(recording), facts_of_recording(recording)
    tables = run_tables(recording, zero, facts)
    sources = Sources()
    charts = [sources.chart(chart, tables) for chart in with_values(catalogue(facts), tables)]
    begin = "the run began" if recording.foreign is None else "the first sample"
    return Charts(
        axes={"time": time_axis(wall_start_s(recording, zero), begin)},
        charts=charts,
        sources=sources.held,
        marks=run_marks(recording, zero),
        spans=run_spans(recording, zero),
        layers=layers(TRUTH in tables, STREAM in tables),
    )


def run_tables(recording: Recording, zero: float, facts: ChartFacts) -> Mapping[str, Arrays]:
    """Return the columns of cycles, ground truth and full sensor stream that are available.

    `zero` is the time at x = 0. The stream before the first cycle is omitted, because it is the raw load, not the
    controlled force.
    """
    tables = dict(Columns.of(recording, zero, facts).arrays())
    if (stream := stream_force(recording)) is not None:
        at, low, high = stream
        known = at >= recording.cycles[0].controlled_at
        tables[STREAM] = {"x": at[known] - zero, "low": low[known], "high": high[known]}
    return tables


def run_marks(recording: Recording, zero: float) -> Sequence[Mark]:
    """Return the marks of a recording."""
    return marks_of(recording.events, recording.steps, recording.cycles, zero)


def run_spans(recording: Recording, zero: float) -> Sequence[Span]:
    """Return the steps or phases of a recording, and its faults, as spans."""
    courses = phases(recording)
    times = [cycle.controlled_at for cycle in recording.cycles] + [event.at for event in recording.events]
    last = max(times, default=zero)
    until = courses[-1].end if courses else last
    names = [(span.begin, span.name) for span in courses]
    steps = spans_of(names, recording.steps, zero, until, end_of(recording).retracted)
    return [*steps, *fault_spans(recording.events, zero, last)]


def wall_start_s(recording: Recording, zero: float) -> float | None:
    """Return the UTC time at x = 0, s since 1970; None if the run's time was virtual or is unknown."""
    virtual = recording.metadata.get("time") == "virtual"
    return None if virtual or not recording.unix_zero_ns else recording.unix_zero_ns * 1e-9 + zero
