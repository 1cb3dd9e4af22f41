"""Catalogue of all time charts of a run, shared by report, live page, `compare` and pictures.

A renderer omits a chart without values, and a chart whose constant values carry no information.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace

from hil_bridge.devices.facts import Pacing
from hil_bridge.show.charts.columns import FEED, LEVELS, NORMALS, SIGMA, Arrays
from hil_bridge.show.charts.facts import ChartFacts
from hil_bridge.show.charts.surface import LEAST_DEFLECTION_UM
from hil_bridge.show.pages.description import Axis, Band, Chart, Layer, Limit, Series

CYCLE, TRUTH, STREAM = "cycle", "truth", "stream"
"""Names of the sources; the last two are also names of layers."""
TIME = "time"
_AXES = "xyz"
_OTHERS_PX = 150
"""Height of every chart but the first, px. Chosen: charts side by side align."""
_DEFLECTION = Chart(
    "deflection",
    "Tool deflection (truth)",
    "µm",
    (
        Series(TRUTH, "deflection", "against the approach", "truth", layer=TRUTH),
        Series(TRUTH, "deflection_across", "across the approach", "2", width=1.0, layer=TRUTH),
    ),
    zero=True,
    quiet_span=LEAST_DEFLECTION_UM,
)


class LimitLine(NamedTuple):
    """Limit of a run, which has the same label in every view."""

    key: str
    """Name of the setting in `limits`."""
    words: str
    unit: str
    sign: float = 1.0
    column: str = ""
    """Column to which the limit applies, if a chart has several columns."""

    @property
    def label(self) -> str:
        """Label of the limit's line."""
        return f"{self.words} limit"


FORCE = LimitLine("force_limit_n", "force", "N")
PULL = LimitLine("pull_limit_n", "pull", "N", -1.0)
RESULTANT = LimitLine("resultant_limit_n", "resultant", "N", column="resultant")
MOMENT = LimitLine("moment_limit_nm", "moment", "N·m", column="moment")
DEPTH = LimitLine("correction_total_mm", "depth", "mm")
AGE = LimitLine("stale_after_ms", "age", "ms", column="age_ms")


def time_axis(wall_start_s: float | None = None, begin: str = "the run began") -> Axis:
    """Return the time axis. `wall_start_s` is the UTC time at zero, and `begin` names the event at zero."""
    return Axis(f"time since {begin}", "s", wall_start_s)


def layers(truth: bool, stream: bool) -> list[Layer]:
    """Return the layers that the user can switch on and off."""
    switches = [Layer(TRUTH, "truth (emulated)")] if truth else []
    return [*switches, Layer(STREAM, "full sensor stream")] if stream else switches


def catalogue(facts: ChartFacts) -> list[Chart]:
    """Return every chart of a run, in display order."""
    force, *across = _contact(facts)
    depth, *motion = _motion(facts)
    others = [depth, _DEFLECTION, *across, *motion, *_control(), *_times(facts), *_program()]
    return [force, *(replace(chart, height_px=_OTHERS_PX) for chart in others)]


def _contact(facts: ChartFacts) -> list[Chart]:
    return [
        Chart(
            "force",
            "Force along the approach, positive while pressing",
            "N",
            (
                Series(TRUTH, "force", "true force", "truth", dashed=True, layer=TRUTH),
                Series(CYCLE, "force", "measured force", width=1.8),
                Series(CYCLE, "force_reference", "target", "target", "step", width=1.0, dashed=True),
                Series(CYCLE, "clamped", "clamped by the supervisor", "limit", "points"),
            ),
            (Band(STREAM, "low", "high", "full stream", layer=STREAM),),
            _limits(facts, FORCE, PULL),
            height_px=250,
            zero=True,
            least_span=2.0,
        ),
        Chart(
            "lateral",
            "Force across the approach",
            "N",
            (
                Series(CYCLE, "wrench_fx", "fx, tool frame", "1", width=1.0),
                Series(CYCLE, "wrench_fy", "fy, tool frame", "3", width=1.0),
                Series(CYCLE, "lateral", "across", "2"),
                Series(CYCLE, "resultant", "resultant, along included", "7", width=1.0),
            ),
            limits=_limits(facts, RESULTANT),
            zero=True,
            least_span=1.0,
            quiet_span=0.0,
        ),
        Chart(
            "moments",
            "Moments about the tool frame's origin",
            "N·m",
            (
                *(Series(CYCLE, f"wrench_m{axis}", f"m{axis}", f"{k + 1}") for k, axis in enumerate(_AXES)),
                Series(CYCLE, "moment", "magnitude", "7", width=1.0),
            ),
            limits=_limits(facts, MOMENT),
            zero=True,
            least_span=0.1,
            quiet_span=0.0,
        ),
    ]


def _motion(facts: ChartFacts) -> list[Chart]:
    places = [
        Chart(
            "place",
            "Position of the tool from the start point, base frame",
            "mm",
            tuple(Series(CYCLE, f"position_{axis}", axis, f"{k + 1}") for k, axis in enumerate(_AXES)),
            least_span=0.5,
        )
    ]
    return [
        Chart(
            "depth",
            "Depth along the approach from the start point",
            "mm",
            (
                Series(CYCLE, "depth_commanded", "commanded", "2", "step"),
                Series(CYCLE, "depth", "reported"),
                Series(TRUTH, "depth", "true", "truth", dashed=True, layer=TRUTH),
            ),
            limits=_limits(facts, DEPTH),
            least_span=0.5,
        ),
        Chart(
            "way",
            "Path over the surface from the start point",
            "mm",
            (
                Series(CYCLE, "travel_commanded", "along, commanded", "2", "step"),
                Series(CYCLE, "across_commanded", "across, commanded", "3", "step"),
            ),
            quiet_span=0.0,
        ),
        *(places if facts.foreign else ()),
        Chart(
            "correction",
            "Correction of the depth per cycle",
            "mm",
            (
                Series(CYCLE, "correction", "correction", "6", "bars"),
                Series(CYCLE, "rests", "within the dead band", "3", "points"),
            ),
            zero=True,
            least_span=0.05,
        ),
    ]


def _control() -> list[Chart]:
    return [
        Chart(
            "levels",
            "Levels of the fuzzy controller",
            "",
            tuple(
                Series(CYCLE, key, f"level of {name}", f"{k + 1}", "step")
                for k, (key, name) in enumerate(LEVELS.items())
            ),
            least_span=2.0,
        ),
        Chart(
            "stiffness",
            "Estimated stiffness of the contact",
            "N/m",
            (Series(CYCLE, "stiffness", "estimate", "3"),),
            log=True,
        ),
        Chart(
            "gain",
            "Adaptive gain factor on the feedback",
            "",
            (Series(CYCLE, "gain", "gain", "8"),),
            zero=True,
            quiet_span=0.0,
        ),
    ]


def _times(facts: ChartFacts) -> list[Chart]:
    floor, cycle_s = facts.line_floor_s, facts.robot.cycle_s
    floors = (
        () if floor is None else (Limit(1e3 * floor, "line floor", "target", shown=True, column="cycle_ms"),)
    )
    charts = [
        Chart(
            "times",
            "Times of the cycle",
            "ms",
            (
                Series(CYCLE, "cycle_ms", "cycle"),
                Series(CYCLE, "age_ms", "age of the force at the decision", "2"),
            ),
            limits=(*floors, *_limits(facts, AGE)),
            zero=True,
        )
    ]
    if facts.robot.pacing is Pacing.STREAMED:
        charts.append(
            Chart(
                "answers",
                "Answers to the robot's packets",
                "ms",
                (Series(CYCLE, "answer_ms", "answer", "4"),),
                limits=() if cycle_s is None else (Limit(1e3 * cycle_s, "robot's cycle"),),
                zero=True,
            )
        )
    return charts


def _program() -> list[Chart]:
    colours = dict(zip(NORMALS, ("1", "3"), strict=True))
    return [
        Chart(
            "feed",
            "Feed: share of the step's nominal speed along its path",
            "%",
            (Series(CYCLE, FEED, "feed", "6", "step"),),
            limits=(Limit(100.0, "full speed", "target", shown=True),),
            zero=True,
            quiet_span=0.0,
        ),
        Chart(
            "normal",
            "Estimated slope of the surface, ± 2 standard deviations",
            "°",
            (
                *(
                    Series(CYCLE, name, f"along {axis}", colours[name])
                    for name, axis in zip(NORMALS, _AXES, strict=False)
                ),
                Series(CYCLE, SIGMA, "standard deviation", "6", width=1.0),
            ),
            tuple(
                Band(CYCLE, f"{name}_low", f"{name}_high", f"± 2σ along {axis}", colours[name])
                for name, axis in zip(NORMALS, _AXES, strict=False)
            ),
            least_span=2.0,
        ),
        Chart(
            "orientation",
            "Tool axis against the inward normal of the surface (truth)",
            "°",
            (
                Series(TRUTH, "tilt", "in free space", "faint", layer=TRUTH),
                Series(TRUTH, "tilt_touching", "in contact", "truth", layer=TRUTH),
            ),
            zero=True,
            least_span=1.0,
        ),
    ]


def _limits(facts: ChartFacts, *lines: LimitLine) -> tuple[Limit, ...]:
    return tuple(
        Limit(line.sign * facts.limits[line.key], line.label, column=line.column)
        for line in lines
        if line.key in facts.limits
    )


def with_values(charts: Sequence[Chart], sources: Mapping[str, Arrays]) -> list[Chart]:
    """Return the charts that have values, with only the series and bands that have values.

    The first chart always stays.
    """

    def span(source: str, column: str) -> float | None:
        values = sources.get(source, {}).get(column, np.empty(0))
        known = values[np.isfinite(values)]
        return float(np.ptp(known)) if known.size else None

    kept = []
    for chart in charts:
        series = [one for one in chart.series if span(one.source, one.column) is not None]
        bands = [one for one in chart.bands if span(one.source, one.low) is not None]
        widest = max((span(one.source, one.column) or 0.0 for one in series), default=-1.0)
        least = -1.0 if chart.quiet_span is None else chart.quiet_span
        if chart is charts[0] or widest > least or bands:
            kept.append(replace(chart, series=series, bands=bands))
    return kept
