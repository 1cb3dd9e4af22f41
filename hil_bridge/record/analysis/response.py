"""Response figures of a run: touch, steps, ramps and sines of the target, moved surface, drift and track.

Peaks, times and disturbances are computed from all frames of the sensor if `stream_of` can turn them into the
controlled force, otherwise from the samples of the cycles. Ramps and sines are computed from the cycles.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import groupby
from typing import NamedTuple

import numpy as np

from hil_bridge.control.analysis.response import (
    BAND_LEAST_N,
    BAND_SHARE,
    ForceSignal,
    amplitude_n,
    error_figures,
    phase_deg,
    ramp_lags_s,
    settling_s,
    sine_response,
    slope_per_min,
    step_figures,
    target_steps,
    touch_figures,
)
from hil_bridge.control.course.parameters import TaskParameters
from hil_bridge.record.analysis.figures import RESPONSE
from hil_bridge.record.analysis.stream import approach_of, stream_of
from hil_bridge.record.reader import Recording
from hil_bridge.record.records import CycleRecord, FaultNote
from protocol.faults import FaultStage

TOUCH_N = TaskParameters().contact_threshold_n
"""Force at which a touch begins, N: the default contact threshold, so that runs compare."""
TOUCH_S = 3.0
"""Time after the touch that counts as the touch, s. Standard: the contact window of Gadringer et al. 2022."""
SPEED_S = 0.1
"""Time before the touch over which its speed is measured, s. Chosen."""
DRIFT_S, DRIFT_AFTER_S = 60.0, 10.0
"""Shortest interval with a constant target that has a drift, and the time at its begin that is left out, s. Chosen."""
_OSCILLATES = "swings"
"""Name of the fault that moves a surface up and down."""


class Disturbance(NamedTuple):
    """Motion or change of the surface while the force was controlled."""

    note: FaultNote
    begin: float
    end: float


def response_figures(
    recording: Recording, strokes: Sequence[Sequence[CycleRecord]]
) -> dict[str, float | None]:
    """Return the response figures of the first stroke by key; empty without a stroke. None marks a figure whose
    event did not occur, or for which the stroke is too short.
    """
    if not strokes:
        return {}
    cycles = [cycle for cycle in strokes[0] if math.isfinite(cycle.force_reference)]
    signal = _signal(recording, cycles) if cycles else None
    if signal is None or not signal.at.size:
        return dict.fromkeys((one.key for one in RESPONSE), None)
    begin, end = float(signal.at[0]), float(signal.at[-1])
    figures: dict[str, float | None] = {"touch_speed_mm_s": _touch_speed_mm_s(recording, begin)}
    if end - begin > TOUCH_S:
        figures |= touch_figures(signal.between(begin, begin + TOUCH_S))
        figures |= error_figures(signal.between(begin + TOUCH_S, end))
    figures |= step_figures(list(target_steps(signal)))
    figures |= _target_figures(cycles)
    figures |= _disturbance_figures(signal, list(_disturbances(recording, begin, end)))
    figures |= _drift_figures(recording, signal)
    return {one.key: figures.get(one.key) for one in RESPONSE}


def _signal(recording: Recording, cycles: Sequence[CycleRecord]) -> ForceSignal:
    """Return the force and its target from the first touch to the last cycle of the stroke."""
    began, ended = recording.cycles[0].controlled_at, cycles[-1].controlled_at
    stream = stream_of(recording)
    if stream is None:
        known = [cycle for cycle in recording.cycles if math.isfinite(cycle.force)]
        stream = np.array([c.controlled_at for c in known]), np.array([c.force for c in known])
    at, force = stream
    newest = np.searchsorted([cycle.controlled_at for cycle in cycles], at, side="right") - 1
    target = np.array([cycle.force_reference for cycle in cycles])[np.maximum(newest, 0)]
    signal = ForceSignal(at, force, target).between(began, ended)
    (touching,) = np.nonzero(signal.force > TOUCH_N)
    first = int(touching[0]) if touching.size else signal.at.size
    return ForceSignal(*(array[first:] for array in signal))


def _touch_speed_mm_s(recording: Recording, touch: float) -> float | None:
    """Return the reported speed along the approach in the last reports before the touch: at least two, and all of
    the last SPEED_S.
    """
    reports = [(cycle.started_at, cycle.depth) for cycle in recording.cycles if cycle.started_at < touch]
    recent = sum(at >= touch - SPEED_S for at, _ in reports)
    if len(reports) < 2 or reports[-1][0] == reports[-2][0]:
        return None
    at, depth = np.array(reports[-max(recent, 2) :]).T
    return slope_per_min(at, depth) / 60.0 * 1e3


def _target_figures(cycles: Sequence[CycleRecord]) -> Mapping[str, float | None]:
    """Return the figures of ramps and sines of the target: the largest lag, and the response to the last sine."""
    lags: list[float] = []
    ratio: complex | None = None
    for _, group in groupby(cycles, key=lambda cycle: cycle.step):
        rows = [(cycle.controlled_at, cycle.force, cycle.force_reference) for cycle in group]
        signal = ForceSignal(*np.array(rows).T)
        lags += ramp_lags_s(signal)
        ratio = sine_response(signal) or ratio
    return {
        "ramp_lag_s": max(lags, key=abs, default=None),
        "sine_gain": None if ratio is None else abs(ratio),
        "sine_phase_deg": None if ratio is None else phase_deg(ratio),
    }


def _disturbances(recording: Recording, begin: float, end: float) -> Iterator[Disturbance]:
    """Yield the faults of the surface that begin between two times."""
    notes = [
        (event.at, event.fault)
        for event in recording.events
        if event.fault is not None and event.fault.target == "surface"
    ]
    for place, (at, note) in enumerate(notes):
        if note.is_injected and begin <= at < end:
            ends = (
                later
                for later, other in notes[place + 1 :]
                if (other.name, other.stage) == (note.name, FaultStage.ENDS)
            )
            yield Disturbance(note, at, min(next(ends, end), end))


def _disturbance_figures(
    signal: ForceSignal, disturbances: Sequence[Disturbance]
) -> Mapping[str, float | None]:
    """Return the figures of the worst disturbance."""
    peaks: list[float] = []
    settlings: list[float] = []
    means: list[float] = []
    stiffnesses: list[float] = []
    for one in disturbances:
        moved = signal.between(one.begin, one.end)
        late = moved.between((one.begin + one.end) / 2, one.end)
        if not late.at.size:
            continue
        band_n = max(BAND_LEAST_N, BAND_SHARE * float(moved.target[0]))
        peaks.append(float(np.abs(moved.error).max()))
        settlings.append(settling_s(moved, band_n))
        means.append(float(late.error.mean()))
        if one.note.name == _OSCILLATES:
            stiffnesses += _force_per_motion(signal, one)
    return {
        "disturbance_peak_n": max(peaks, default=None),
        "disturbance_settle_s": max(settlings, default=None),
        "disturbance_error_n": max(means, key=abs, default=None),
        "disturbance_n_mm": max(stiffnesses, default=None),
    }


def _force_per_motion(signal: ForceSignal, one: Disturbance) -> Iterator[float]:
    """Yield the amplitude of the force per amplitude of the surface, N/mm, if there are at least three periods. The
    first one is left out.
    """
    period_s, size_mm = one.note.values["period_s"], one.note.values["mm"]
    periods = math.floor((one.end - one.begin) / period_s)
    if periods >= 3 and size_mm > 0.0:
        late = signal.between(one.begin + period_s, one.begin + periods * period_s)
        yield amplitude_n(late, period_s) / size_mm


def _drift_figures(recording: Recording, signal: ForceSignal) -> Mapping[str, float | None]:
    """Return the drift of the measured and of the true force while the target is constant to the end."""
    (changes,) = np.nonzero(np.diff(signal.target))
    begin = float(signal.at[changes[-1] + 1 if changes.size else 0]) + DRIFT_AFTER_S
    end = float(signal.at[-1])
    if end - begin < DRIFT_S - DRIFT_AFTER_S:
        return {}
    held, approach = signal.between(begin, end), approach_of(recording)
    figures: dict[str, float | None] = {"drift_n_min": slope_per_min(held.at, held.force)}
    truths = [(truth.at, *truth.force) for truth in recording.truths if begin <= truth.at <= end]
    if approach is not None and len(truths) > 1:
        at, *force = np.array(truths).T
        figures["drift_true_n_min"] = slope_per_min(at, -np.array(approach) @ np.array(force))
    return figures
