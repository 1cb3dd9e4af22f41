"""The charts of a run over time: forces, motion, estimate and times, with limits, phases, faults and the truth."""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from hil_bridge.record.analysis.stream import stream_force
from hil_bridge.record.analysis.strokes import TRACK
from hil_bridge.record.analysis.summary import Summary, cycle_times, phases
from hil_bridge.record.device_facts import devices_of, recorded_configuration
from hil_bridge.record.reader import Recording
from hil_bridge.record.records import CycleRecord
from hil_bridge.show.pages import Axis, Band, Chart, Charts, Layer, Limit, Series, Span
from hil_bridge.show.report.explanation import LEVELS
from hil_bridge.show.report.program_charts import has_program, program_charts
from hil_bridge.show.report.sources import Array, Sources, column, parts, start_time
from hil_bridge.show.report.surface_charts import orientation_chart
from hil_bridge.show.run_marks import (
    DEPTH,
    FORCE,
    LATERAL,
    MOMENTS,
    STIFFNESS,
    TIMES,
    fault_spans,
    limits_of,
    marks,
    stretches,
)

TRUTH, STREAM = "truth", "stream"
"""Layers."""
_AXES = ("x", "y", "z")


class RunCharts:
    """The charts of one run in the making."""

    def __init__(self, recording: Recording, summary: Summary) -> None:
        self.recording, self.summary = recording, summary
        self.zero = start_time(recording)
        self.sources = Sources()
        self.time = column(recording.cycles, "controlled_at") - self.zero
        """Of each cycle, s since the start."""
        self.limits = _limits(recording)
        self.approach = _approach(recording)

    def charts(self) -> Charts:
        """Everything that is to be drawn."""
        made = [chart for chart in self._made() if chart is not None]
        found = self.recording
        layers = [Layer(TRUTH, "truth (emulated)")] if found.truths else []
        if any(band.layer == STREAM for chart in made for band in chart.bands):
            layers.append(Layer(STREAM, "sensor's whole stream"))
        zero_ns = found.unix_zero_ns
        wall = zero_ns * 1e-9 + self.zero if zero_ns and found.metadata.get("time") != "virtual" else None
        return Charts(
            axes={"time": Axis("time since the run began", "s", wall)},
            charts=made,
            sources=self.sources.found,
            marks=marks(found, self.zero),
            spans=_spans(found, self.zero),
            layers=layers,
        )

    def _made(self) -> Iterator[Chart | None]:
        yield self._force()
        yield self._lateral()
        yield self._moments()
        yield self._depth()
        yield self._way()
        yield self._correction()
        yield self._levels()
        yield self._stiffness()
        yield self._gain()
        yield self._times()
        yield self._answers()
        yield from program_charts(self.recording, self.time, self.sources)
        yield orientation_chart(self.recording, self.zero, self.sources, TRUTH)

    def _cycle(self, chart: str, **columns: Array) -> str:
        return self.sources.add("cycle", chart, self.time, columns)

    def _force(self) -> Chart:
        cycles = self.recording.cycles
        force, target = column(cycles, "force"), column(cycles, "force_reference")
        if has_program(cycles):  # a step that does not press wants no force
            target[[cycle.phase != TRACK for cycle in cycles]] = math.nan
        clamped = np.where([cycle.verdict == "clamp" for cycle in cycles], force, math.nan)
        source = self._cycle("force", force=force, target=target, clamped=clamped)
        series = [Series(source, "target", "target", "target", "step", dashed=True)]
        bands = []
        if (stream := stream_force(self.recording)) is not None:
            at, low, high = stream
            name = self.sources.add("stream", "force", at - self.zero, {"low": low, "high": high})
            bands = [Band(name, "low", "high", "whole stream", layer=STREAM)]
        if (truth := self._truth()) is not None:
            series.append(Series(truth, "force", "true force", "truth", layer=TRUTH))
        series.append(Series(source, "force", "force, cycle samples"))
        if np.isfinite(clamped).any():
            count = int(np.isfinite(clamped).sum())
            series.append(
                Series(source, "clamped", f"clamped by the supervisor ({count})", "limit", "points")
            )
        limits = limits_of("force", self.limits)
        return Chart(
            "force",
            "Force along the approach, positive while pressing",
            "N",
            series,
            bands,
            limits,
            height_px=250,
            **FORCE._asdict(),
        )

    def _truth(self) -> str | None:
        """The source of force and depth of the truth; None for a real cell."""
        truths, cycles = self.recording.truths, self.recording.cycles
        if not truths or self.approach is None:
            return None
        force = -parts(truths, "force", 3) @ self.approach
        depth = 1e3 * (parts(truths, "position", 3) - np.array(cycles[0].start)) @ self.approach
        return self.sources.add(
            "truth", "force", column(truths, "at") - self.zero, {"force": force, "depth": depth}
        )

    def _lateral(self) -> Chart | None:
        wrench = parts(self.recording.cycles, "wrench", 6)
        if not np.any(wrench):
            return None
        length = np.linalg.norm(wrench[:, :3], axis=1)
        source = self._cycle("lateral", fx=wrench[:, 0], fy=wrench[:, 1], length=length)
        series = [Series(source, f"f{axis}", f"f{axis}", f"{k + 1}") for k, axis in enumerate(_AXES[:2])]
        series.append(Series(source, "length", "magnitude, with fz", "7", width=1.0))
        return Chart(
            "lateral",
            "Lateral force at the tool, tool frame",
            "N",
            series,
            limits=limits_of("lateral", self.limits),
            **LATERAL._asdict(),
        )

    def _moments(self) -> Chart | None:
        moments = parts(self.recording.cycles, "wrench", 6)[:, 3:]
        if not np.any(moments):
            return None
        source = self._cycle("moments", **{f"m{axis}": moments[:, k] for k, axis in enumerate(_AXES)})
        series = [Series(source, f"m{axis}", f"m{axis}", f"{k + 1}") for k, axis in enumerate(_AXES)]
        limits = limits_of("moments", self.limits)
        title = "Moments about the tool frame's origin"
        return Chart("moments", title, "N·m", series, limits=limits, **MOMENTS._asdict())

    def _depth(self) -> Chart:
        cycles = self.recording.cycles
        source = self._cycle(
            "depth",
            depth_commanded=1e3 * column(cycles, "depth_commanded"),
            depth=1e3 * column(cycles, "depth"),
        )
        series = [
            Series(source, "depth_commanded", "commanded", "2", "step"),
            Series(source, "depth", "reported"),
        ]
        if (truth := self._truth()) is not None:
            series.append(Series(truth, "depth", "true", "truth", layer=TRUTH))
        limits = limits_of("depth", self.limits)
        title = "Depth along the approach from the start point"
        return Chart("depth", title, "mm", series, limits=limits, height_px=220, **DEPTH._asdict())

    def _way(self) -> Chart | None:
        cycles = self.recording.cycles
        along, across = (1e3 * column(cycles, f"{name}_commanded") for name in ("travel", "across"))
        if not (np.any(along) or np.any(across)):
            return None
        source = self._cycle("way", along=along, across=across)
        series = [Series(source, "along", "along, commanded", "2", "step")]
        if np.any(across):
            series.append(Series(source, "across", "across, commanded", "3", "step"))
        return Chart("way", "Way over the surface from the start point", "mm", series, height_px=140)

    def _correction(self) -> Chart:
        cycles = self.recording.cycles
        held = np.where([cycle.held for cycle in cycles], 0.0, math.nan)
        source = self._cycle("correction", correction=1e3 * column(cycles, "correction"), held=held)
        style = "bars" if len(cycles) < 1500 else "line"
        series = [Series(source, "correction", "correction", "6", style)]
        if np.isfinite(held).any():
            series.append(Series(source, "held", "the controller rests", "3", "points"))
        return Chart(
            "correction", "Correction of the depth per cycle", "mm", series, zero=True, height_px=150
        )

    def _levels(self) -> Chart | None:
        cycles = self.recording.cycles
        told = {key: explained(cycles, key) for key in LEVELS}
        told = {key: values for key, values in told.items() if np.isfinite(values).any()}
        if not told:
            return None
        source = self._cycle("levels", **told)
        series = [
            Series(source, key, f"level of {LEVELS[key]}", f"{k + 1}", "step") for k, key in enumerate(told)
        ]
        return Chart("levels", "Levels of the fuzzy controller", "", series, least_span=2.0)

    def _stiffness(self) -> Chart | None:
        stiffness = column(self.recording.cycles, "stiffness")
        if not (stiffness > 0.0).any():
            return None
        source = self._cycle("stiffness", stiffness=stiffness)
        series = [Series(source, "stiffness", "estimate", "3")]
        title = "Estimated stiffness of the contact"
        return Chart("stiffness", title, "N/m", series, height_px=150, **STIFFNESS._asdict())

    def _gain(self) -> Chart | None:
        gain = column(self.recording.cycles, "gain")
        known = gain[np.isfinite(gain)]
        if not known.size or not np.ptp(known) > 0.0:
            return None
        source = self._cycle("gain", gain=gain)
        series = [Series(source, "gain", "gain", "8")]
        return Chart("gain", "Factor of the adaptation on the feedback", "", series, zero=True, height_px=120)

    def _times(self) -> Chart:
        cycles = self.recording.cycles
        seconds = cycle_times(cycles, devices_of(self.recording).robot.cycle_s is not None)
        taken = 1e3 * np.array([*seconds, *[math.nan] * (len(cycles) - len(seconds))])
        age = 1e3 * (column(cycles, "controlled_at") - column(cycles, "sensor_at"))
        source = self._cycle("times", cycle_ms=taken, age_ms=age)
        series = [
            Series(source, "cycle_ms", "cycle"),
            Series(source, "age_ms", "age of the force at the decision", "2"),
        ]
        limits = limits_of("times", self.limits, self.summary.line_floor_s)
        return Chart("times", "Times of the cycle", "ms", series, limits=limits, **TIMES._asdict())

    def _answers(self) -> Chart | None:
        answer = 1e3 * column(self.recording.cycles, "answer_s")
        cycle_s = devices_of(self.recording).robot.cycle_s
        if not np.isfinite(answer).any():
            return None
        source = self._cycle("answers", answer_ms=answer)
        limits = [] if cycle_s is None else [Limit(1e3 * cycle_s, "the robot's cycle")]
        series = [Series(source, "answer_ms", "answer", "4")]
        return Chart("answers", "Answers to the robot's packets", "ms", series, limits=limits, zero=True)


def run_charts(recording: Recording, summary: Summary) -> tuple[Charts, str]:
    """The charts of a run, and what of a long one they leave out, in words."""
    made = RunCharts(recording, summary)
    return made.charts(), made.sources.sentence()


def explained(cycles: Sequence[CycleRecord], name: str) -> Array:
    """A value of the explanation; NaN where it is not told."""
    return np.array([cycle.explanation.get(name, math.nan) for cycle in cycles], dtype=np.float64)


def _spans(recording: Recording, zero: float) -> list[Span]:
    """Steps, phases and faults."""
    last = max([cycle.controlled_at for cycle in recording.cycles] + [event.at for event in recording.events])
    courses = [Span(span.begin - zero, span.end - zero, span.name, span.name) for span in phases(recording)]
    return [
        *stretches(courses, recording.steps, zero),
        *fault_spans(recording.events, zero, last - zero),
    ]


def _limits(recording: Recording) -> Mapping[str, float]:
    told: Any = recorded_configuration(recording).get("limits")
    found = told.items() if isinstance(told, dict) else ()
    return {key: float(value) for key, value in found if isinstance(value, (int, float)) and value}


def _approach(recording: Recording) -> Array | None:
    """Unit vector of the approach in the robot base frame; None where it is not told."""
    told: Any = recorded_configuration(recording).get("frame")
    vector = told.get("approach") if isinstance(told, dict) else None
    try:
        found = np.array(vector, dtype=np.float64)
    except (TypeError, ValueError):
        return None
    return found if found.shape == (3,) and np.isfinite(found).all() else None
