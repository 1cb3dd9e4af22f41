"""What a program tells over time: its feed, and the normal of the surface that it estimated."""

import math
from collections.abc import Iterator, Sequence

import numpy as np

from hil_bridge.record.analysis.strokes import TRACK
from hil_bridge.record.reader import Recording
from hil_bridge.record.records import CycleRecord
from hil_bridge.show.pages import Band, Chart, Limit, Series
from hil_bridge.show.report.sources import Array, Sources

FEED, SIGMA, NORMALS = "feed", "normal_sigma_deg", ("normal_x_deg", "normal_y_deg")
"""Names in a cycle's explanation."""


def has_program(cycles: Sequence[CycleRecord]) -> bool:
    """Whether a run had steps."""
    return any(cycle.step for cycle in cycles)


def presses(cycle: CycleRecord) -> bool:
    """Whether the force was controlled."""
    return cycle.phase == TRACK and math.isfinite(cycle.force)


def program_charts(recording: Recording, time: Array, sources: Sources) -> Iterator[Chart]:
    """The charts of what is told; `time` is that of each cycle, s since the start."""
    cycles = recording.cycles
    if any(FEED in cycle.explanation for cycle in cycles):
        source = sources.add("cycle", "feed", time, {"feed": 100.0 * _feeds(recording)})
        yield Chart(
            "feed",
            "Feed: share of the step's own speed along its path",
            "%",
            [Series(source, "feed", "feed", "6", "step")],
            limits=[Limit(100.0, "whole speed", "target", shown=True)],
            zero=True,
            height_px=130,
        )
    if any(SIGMA in cycle.explanation for cycle in cycles):
        yield _normal(cycles, time, sources)


def _feeds(recording: Recording) -> Array:
    """The feed of each cycle; it is told where it is not whole."""
    tracks = {step.step for step in recording.steps if "(track" in step.label}
    whole = {True: 1.0, False: math.nan}
    return np.array(
        [
            cycle.explanation.get(FEED, whole[cycle.phase == TRACK and cycle.step in tracks])
            for cycle in recording.cycles
        ]
    )


def _normal(cycles: Sequence[CycleRecord], time: Array, sources: Sources) -> Chart:
    """The fall of the surface along x and y, each within two standard deviations."""
    sigma = _explained(cycles, SIGMA)
    columns = {SIGMA: sigma}
    for name in NORMALS:
        angle = _explained(cycles, name)
        columns |= {name: angle, f"{name}_low": angle - 2 * sigma, f"{name}_high": angle + 2 * sigma}
    source = sources.add("cycle", "normal", time, columns)
    colours = dict(zip(NORMALS, ("1", "3"), strict=True))
    return Chart(
        "normal",
        "Estimated fall of the surface, ± 2 standard deviations",
        "°",
        [
            *(
                Series(source, name, f"along {axis}", colours[name])
                for name, axis in zip(NORMALS, "xy", strict=True)
            ),
            Series(source, SIGMA, "standard deviation", "6", width=1.0),
        ],
        [
            Band(source, f"{name}_low", f"{name}_high", f"± 2σ along {axis}", colours[name])
            for name, axis in zip(NORMALS, "xy", strict=True)
        ],
        least_span=2.0,
    )


def _explained(cycles: Sequence[CycleRecord], name: str) -> Array:
    """A value of the explanation; NaN where it is not told or the force was not controlled."""
    return np.array(
        [cycle.explanation.get(name, math.nan) if presses(cycle) else math.nan for cycle in cycles],
        dtype=np.float64,
    )
