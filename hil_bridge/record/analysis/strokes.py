"""Strokes of a run: the intervals under force control, and the figures of merit over all of them."""

import math
from collections.abc import Sequence

from hil_bridge.control.analysis.merit import FiguresOfMerit, ForceTrace, figures_of_merit
from hil_bridge.record.reader import Recording
from hil_bridge.record.records import CycleRecord

TRACK = "track"
"""Phase in which the force is controlled."""
_SEEK = "seek"
"""Keyword of a step that searches for the edge of a surface and loses contact on purpose."""


def strokes_of(recording: Recording) -> list[list[CycleRecord]]:
    """Return the cycles of each stroke, from contact to retraction. A run without a program has at most one stroke."""
    seeks = {step.step for step in recording.steps if step.word == _SEEK}
    strokes: list[list[CycleRecord]] = []
    going = False
    for cycle in recording.cycles:
        if cycle.phase != TRACK or (cycle.step and cycle.step in seeks):
            # a tool that lost the surface and searches for it is in the same stroke
            going = going and cycle.step == strokes[-1][-1].step
        elif math.isfinite(cycle.force):
            if not going:
                strokes.append([])
            going = True
            strokes[-1].append(cycle)
    return strokes


def merit_of(strokes: Sequence[Sequence[CycleRecord]], step_m: float | None) -> FiguresOfMerit:
    """Return the figures over all strokes: the slowest rise, and the steady state of the last stroke.

    `step_m` is the resolution of the position, m. Raises ValueError without a stroke.
    """
    each = [_merit(stroke, step_m) for stroke in strokes]
    if len(each) == 1:
        return each[0]
    if not each:
        raise ValueError("figures of merit need a stroke")
    slowest = max(each, key=lambda one: math.inf if one.rise_s is None else one.rise_s)
    counts = [len(stroke) for stroke in strokes]
    squares = sum(count * one.rms_error_n**2 for count, one in zip(counts, each, strict=True))
    last = each[-1]
    return FiguresOfMerit(
        rise_samples=slowest.rise_samples,
        rise_s=slowest.rise_s,
        overshoot_percent=max(one.overshoot_percent for one in each),
        steady_mean_error_n=last.steady_mean_error_n,
        steady_peak_to_peak_n=last.steady_peak_to_peak_n,
        rms_error_n=math.sqrt(squares / sum(counts)),
        contact_losses=sum(one.contact_losses for one in each),
        steps_per_s=last.steps_per_s,
        largest_force_n=max(one.largest_force_n for one in each),
    )


def _merit(cycles: Sequence[CycleRecord], step_m: float | None) -> FiguresOfMerit:
    trace = ForceTrace(
        time=[cycle.controlled_at for cycle in cycles],
        force=[cycle.force for cycle in cycles],
        reference=[cycle.force_reference for cycle in cycles],
        commanded=[cycle.depth_commanded for cycle in cycles],
        in_contact=[cycle.in_contact for cycle in cycles],
    )
    return figures_of_merit(trace, step_m * 1e3 if step_m else math.inf)
