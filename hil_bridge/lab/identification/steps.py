"""The servo of a robot that is asked, from the force that its steps make: it stands whenever it tells its place."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.signal import lfilter

from hil_bridge.devices.facts import ACCEPTED, ServoFacts
from hil_bridge.lab.fidelity.measures import Floats
from hil_bridge.lab.identification.blocks import Estimate, Ints, Mask, blocks_of, jackknife
from hil_bridge.lab.identification.observations import Observations
from hil_bridge.record.analysis.latency import timestamps

_STEP_S = 0.001
"""Chosen: the way of the tool is worked out so finely."""
_SHIFTS_S = np.arange(-0.04, 0.1601, 0.005)
"""Chosen: delays that are tried, beside the response."""
_RESPONSES_S = (0.02, 0.035, 0.05, 0.065, 0.09)
"""Chosen: responses of the loops, 2ζ/ω, that are tried."""
_MOST_FRAMES = 1500
"""Chosen: about so many frames stand for all."""
_WINDOW_S = 2.0
"""Chosen: over so long the surface's own height is a straight line in time."""
_LEAST_FRAMES = 100
"""Chosen: frames while it presses at least."""
_EXPLAINED = 0.5
"""Chosen: the steps tell a delay where they explain such a share of the force's variance."""


def servo_of_steps(seen: Observations, servo: ServoFacts) -> Estimate | None:
    """Transport delay and response of the servo, s; None where the force does not show the steps. `servo` is the
    emulated robot's usual one: its response is the shape that is looked for.
    """
    contact, stream, hops = seen.contact, seen.stream, seen.robot.hops
    if contact is None or stream is None or hops is None:
        return None
    moments = timestamps(seen.cycles, hops)(ACCEPTED)
    known = np.isfinite(moments)
    moments, cycles = (
        moments[known],
        [cycle for cycle, is_known in zip(seen.cycles, known, strict=True) if is_known],
    )
    inside = np.zeros(len(stream.times), bool)
    for stretch in np.unique(contact.stretch):
        at = contact.times[contact.stretch == stretch]
        inside |= (stream.times > at[0]) & (stream.times < at[-1])
    if inside.sum() < _LEAST_FRAMES or len(moments) < 2:
        return None
    delay = 0.0 if stream.facts is None else stream.facts.delay
    grid = np.arange(moments[0] - 1.0, moments[-1] + 1.0, _STEP_S)
    held = [
        _held(grid, moments, np.array(values))
        for values in (
            [cycle.depth_commanded for cycle in cycles],
            [cycle.travel_commanded for cycle in cycles],
        )
    ]
    chosen = np.flatnonzero(inside)[:: max(1, int(inside.sum()) // _MOST_FRAMES)]
    force = -stream.wrench[chosen, :3] @ np.array(stream.approach)
    fits, totals = list[_Fit](), list[float]()
    for response in _RESPONSES_S:
        inputs = [_smoothed(values, (response / 2.0, response / 2.0, delay)) for values in held]
        steps = _Steps(grid, inputs, stream.times[chosen], force)
        for shift in _SHIFTS_S:
            fits.append(steps.fit(float(shift)))
            totals.append(float(shift) + response)
    everything = np.ones(len(chosen), bool)
    if min(fit.rest(everything) for fit in fits) > 1.0 - _EXPLAINED:
        return None
    rows, columns = len(_RESPONSES_S), len(_SHIFTS_S)

    def total(mask: Mask) -> float:
        rests = np.array([fit.rest(mask) for fit in fits]).reshape(rows, columns)
        row = int(np.argmin(rests.min(axis=1)))
        step = float(_SHIFTS_S[1] - _SHIFTS_S[0])
        return totals[row * columns] + step * _lowest(rests[row]) - servo.wait_s

    tick = 0.5 * servo.interpolation_s
    return jackknife(fits[0].blocks, total).wider(tick, "and half a tick of the robot's interpolator")


class _Fit(NamedTuple):
    """The force over depth and way at one delay, with levels and slopes of each window taken off."""

    inputs: Floats
    force: Floats
    blocks: Ints

    def rest(self, mask: Mask) -> float:
        """Share of the force's variance that is not explained."""
        inputs, force = self.inputs[mask], self.force[mask]
        fit = np.linalg.lstsq(inputs, force, rcond=None)[0]
        rest = force - inputs @ fit
        return float(rest @ rest) / float(force @ force)


class _Steps(NamedTuple):
    grid: Floats
    inputs: Sequence[Floats]
    """Depth and way of the tool without any delay, m, over the grid."""
    times: Floats
    force: Floats

    def fit(self, shift: float) -> _Fit:
        """Fit the regression with this delay, s."""
        columns = [np.interp(self.times - shift, self.grid, values) for values in self.inputs]
        table = np.column_stack([*columns, self.force])
        windows = np.floor((self.times - self.times[0]) / _WINDOW_S)
        for window in np.unique(windows):
            inside = windows == window
            about = self.times[inside] - self.times[inside].mean()
            level = np.column_stack([np.ones(len(about)), about])
            table[inside] -= level @ np.linalg.lstsq(level, table[inside], rcond=None)[0]
        return _Fit(table[:, :2], table[:, 2], blocks_of(table[:, 2] ** 2))


def _held(grid: Floats, moments: Floats, values: Floats) -> Floats:
    """Values that hold from their moments on."""
    places = np.clip(np.searchsorted(moments, grid, side="right") - 1, 0, len(values) - 1)
    held: Floats = values[places]
    return held


def _smoothed(values: Floats, times: Sequence[float]) -> Floats:
    """Values behind filters of first order with these time constants, s."""
    start = values[0]
    values = values - start
    for time in times:
        if time > 0.0:
            share = -math.expm1(-_STEP_S / time)
            values = lfilter([share], [1.0, share - 1.0], values)
    smoothed: Floats = values + start
    return smoothed


def _lowest(values: Floats) -> float:
    """Place of the least value, between its neighbours by a parabola."""
    place = int(np.argmin(values))
    if not 0 < place < len(values) - 1:
        return float(place)
    before, here, behind = values[place - 1 : place + 2]
    bend = before - 2.0 * here + behind
    return place + (0.5 * float(before - behind) / float(bend) if bend > 0.0 else 0.0)
