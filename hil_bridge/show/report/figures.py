"""The figures of a summary as rows that a person reads: one table for the picture and the page."""

from dataclasses import dataclass

from hil_bridge.record.analysis.summary import Summary


@dataclass(frozen=True, slots=True)
class Row:
    """One figure."""

    label: str
    value: str
    explanation: str


_MERIT = (
    # key in the summary, label, scale, format, unit, explanation
    (
        "rise_samples",
        "rise",
        1,
        ".0f",
        "cycles",
        "first sample at 90 % of the target, from the first tracked one",
    ),
    ("rise_s", "rise time", 1, ".2f", "s", "the same as time"),
    ("overshoot_percent", "overshoot", 1, ".1f", "%", "largest force above the target, in % of the target"),
    (
        "steady_mean_error_n",
        "steady mean error",
        1,
        "+.2f",
        "N",
        "mean of force minus target, last 40 samples",
    ),
    ("steady_peak_to_peak_n", "steady peak-to-peak", 1, ".2f", "N", "spread of the last 40 samples"),
    ("rms_error_n", "RMS error", 1, ".2f", "N", "root mean square of force minus target while tracking"),
    ("contact_losses", "contact losses", 1, ".0f", "", "times that the tool left the surface while tracking"),
    (
        "steps_per_s",
        "steps moved",
        1,
        ".2f",
        "1/s",
        "resolution steps a second in steady state (wear)",
    ),
    ("largest_force_n", "largest force", 1, ".1f", "N", "at any time while tracking"),
)
_OF_SEVERAL = {
    "rise_samples": "first sample at 90 % of the target, slowest stroke",
    "steady_mean_error_n": "mean of force minus target, end of the last stroke",
    "steady_peak_to_peak_n": "spread of that, last 40 samples of the last stroke",
    "contact_losses": "times that the tool left the surface in a stroke",
}
"""Explanations for a program of several strokes."""
_UNKNOWN = "–"
NAMED = ("controller", "seed")
"""Rows at the begin of `run_rows` that a page tells at its top."""


def merit_rows(summary: Summary) -> tuple[Row, ...]:
    """Figures of merit of the force control."""
    several = _OF_SEVERAL if summary.strokes > 1 else {}
    return tuple(
        Row(label, quantity(summary.figures.get(key), scale, form, unit), several.get(key, explanation))
        for key, label, scale, form, unit, explanation in _MERIT
    )


def run_rows(summary: Summary) -> tuple[Row, ...]:
    """Other remarks about the run."""
    times, dropped = summary.cycle_time, sum(summary.recorder_dropped.values())

    mean, p50, p90, p99, largest = (
        quantity(value, 1e3, ".1f", "ms")
        for value in (
            (times.mean_s, times.p50_s, times.p90_s, times.p99_s, times.max_s) if times else (None,) * 5
        )
    )
    return (
        Row(NAMED[0], summary.controller or _UNKNOWN, "control law by its name in the configuration"),
        Row(NAMED[1], summary.seed or _UNKNOWN, "start of every random number of an emulated cell"),
        _target(summary),
        Row("mean steady force", quantity(summary.force_mean_steady_n, 1, ".2f", "N"), "last 40 samples"),
        Row("cycles", f"{summary.cycles}", f"{summary.cycles_clamped} clamped, {summary.cycles_held} held"),
        Row("cycle rate", quantity(summary.cycle_rate_hz, 1, ".2f", "Hz"), "mean over the run"),
        Row(
            "cycle time",
            mean,
            "mean, to the answer; of a stream, to the next",
        ),
        Row(
            "cycle time, 50 / 90 %",
            f"{p50} / {p90}",
            "percentiles",
        ),
        Row(
            "cycle time, 99 % / max",
            f"{p99} / {largest}",
            "percentiles",
        ),
        Row(
            "line-time floor",
            quantity(summary.line_floor_s, 1e3, ".1f", "ms"),
            "what the characters of one cycle take on the line",
        ),
        Row(
            "sensor frames",
            f"{summary.sensor_frames_received}",
            "" if summary.sensor_frames_lost is None else f"{summary.sensor_frames_lost} lost",
        ),
        Row("records dropped", f"{dropped}", "by the recorder: disk too slow or full"),
    )


def _target(summary: Summary) -> Row:
    if summary.force_reference_n is None and summary.force_references_n is not None:
        least, most = (quantity(force, 1, ".2f", "N") for force in summary.force_references_n)
        return Row("target force", f"{least.removesuffix(' N')} … {most}", "positive while pressing")
    return Row("target force", quantity(summary.force_reference_n, 1, ".2f", "N"), "positive while pressing")


def quantity(value: float | None, scale: float, form: str, unit: str) -> str:
    """A value with its unit, or a dash."""
    return _UNKNOWN if value is None else f"{value * scale:{form}} {unit}".rstrip().replace("-", "−")
