"""Figures of a summary as labelled rows, shared by picture and page."""

from dataclasses import dataclass

from hil_bridge.record.analysis.definition import UNKNOWN, Definition, Group, concise
from hil_bridge.record.analysis.figures import CONTACT, FIGURES, MERIT, RESPONSE
from hil_bridge.record.analysis.summary import Summary
from hil_bridge.record.reader import Recording


@dataclass(frozen=True, slots=True)
class Row:
    """Labelled figure with its explanation."""

    label: str
    value: str
    explanation: str


NAMED = ("controller", "seed")
"""Number of leading rows of `run_rows` that a page displays at the top."""


def merit_rows(summary: Summary) -> tuple[Row, ...]:
    """Return the figures of merit of the force control."""
    several = summary.strokes > 1
    return tuple(
        Row(one.words, _text(one, summary.figures.get(one.key)), (several and one.of_several) or one.how)
        for one in MERIT
    )


def response_rows(summary: Summary) -> tuple[Row, ...]:
    """Return the response figures that the run has."""
    values = ((one, summary.response.get(one.key)) for one in RESPONSE)
    return tuple(Row(one.words, _text(one, value), one.how) for one, value in values if value is not None)


def contact_rows(summary: Summary) -> tuple[Row, ...]:
    """Return the contact figures."""
    return tuple(Row(one.words, _text(one, summary.contact.get(one.key)), one.how) for one in CONTACT)


def bag_rows(recording: Recording, summary: Summary) -> tuple[Row, ...]:
    """Return the other facts of a recording made by another program."""
    cycles = recording.cycles
    span_s = cycles[-1].controlled_at - cycles[0].controlled_at if cycles else None
    return (
        Row("samples", f"{summary.cycles}", "wrenches with a pose"),
        Row("rate", concise(summary.cycle_rate_hz, 1.0, ".1f", "Hz"), "mean of the samples"),
        Row(
            FIGURES["duration_s"].words,
            concise(span_s, 1.0, ".1f", "s"),
            "from the first sample to the last",
        ),
    )


def figure_tables(recording: Recording, summary: Summary) -> tuple[tuple[str, tuple[Row, ...]], ...]:
    """Return titles and rows of the two tables of figures."""
    if recording.foreign is not None:
        return ("contact figures", contact_rows(summary)), ("bag", bag_rows(recording, summary))
    return (Group.MERIT.value, merit_rows(summary)), (Group.RUN.value, run_rows(summary))


def run_rows(summary: Summary) -> tuple[Row, ...]:
    """Return the other facts of the run."""
    times, dropped = summary.cycle_time, sum(summary.recorder_dropped.values())
    mean = concise(times.mean_s if times else None, 1e3, ".1f", "ms")
    shares = (times.p50_s, times.p90_s, times.p99_s, times.max_s) if times else ()
    percentiles = [concise(value, 1e3, ".1f", "") for value in shares]
    lost = "" if summary.sensor_frames_lost is None else f"{summary.sensor_frames_lost} lost"
    return (
        Row(NAMED[0], summary.controller or UNKNOWN, "control law by its name in the configuration"),
        Row(NAMED[1], summary.seed or UNKNOWN, "seed of the random numbers of an emulated cell"),
        _target(summary),
        _row("force_mean_steady_n", summary.force_mean_steady_n),
        Row(
            FIGURES["cycles"].words,
            FIGURES["cycles"].text(summary.cycles),
            f"{summary.cycles_clamped} clamped, {summary.cycles_held} held",
        ),
        _row("cycle_rate_hz", summary.cycle_rate_hz),
        Row("cycle time", mean, "mean, to the answer; of a stream, to the next"),
        Row(
            "cycle time, p50 to max",
            f"{' · '.join(percentiles)} ms" if len(set(percentiles)) > 1 else "",
            "percentiles 50, 90 and 99, largest",
        ),
        _row("line_floor_s", summary.line_floor_s),
        Row("sensor frames", f"{summary.sensor_frames_received}", lost),
        Row("records dropped", f"{dropped}", "by the recorder: disk too slow or full"),
    )


def _row(key: str, value: float | None) -> Row:
    return Row(FIGURES[key].words, _text(FIGURES[key], value), FIGURES[key].how)


def _text(figure: Definition, value: float | None) -> str:
    return concise(value, figure.scale, figure.form, figure.unit)


def _target(summary: Summary) -> Row:
    if summary.force_reference_n is None and summary.force_references_n is not None:
        one = FIGURES["force_reference_n"]
        least, most = summary.force_references_n
        return Row(one.words, f"{concise(least, one.scale, one.form, '')} … {_text(one, most)}", one.how)
    return _row("force_reference_n", summary.force_reference_n)
