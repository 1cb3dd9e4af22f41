"""Servo of a polled robot, identified from the forces during its steps, because the robot is stationary whenever it
reports its position.
"""

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
"""Time step at which the motion of the tool is computed, s. Chosen."""
_SHIFTS_S = np.arange(-0.04, 0.1601, 0.005)
"""Delays to try in addition to the response, s. Chosen."""
_RESPONSES_S = (0.02, 0.035, 0.05, 0.065, 0.09)
"""Responses of the loops to try, 2ζ/ω, s. Chosen."""
_MOST_FRAMES = 1500
"""Approximate number of frames that are used, as a subset of all frames. Chosen."""
_WINDOW_S = 2.0
"""Window in which the height of the surface is assumed to be linear in time, s. Chosen."""
_LEAST_FRAMES = 100
"""Smallest number of frames in contact from which the servo is identified. Chosen."""
_EXPLAINED = 0.5
"""Share of the force's variance that the steps must explain before a delay is identified. Chosen."""


def servo_of_steps(observations: Observations, servo: ServoFacts) -> Estimate | None:
    """Return the sum of the servo's transport delay and response, s; None if the force does not show the steps.

    `servo` is the default servo of the emulated robot, whose response has the assumed shape.
    """
    contact, stream, hops = observations.contact, observations.stream, observations.robot.hops
    if contact is None or stream is None or hops is None:
        return None
    moments = timestamps(observations.cycles, hops)(ACCEPTED)
    known = np.isfinite(moments)
    moments, cycles = (
        moments[known],
        [cycle for cycle, is_known in zip(observations.cycles, known, strict=True) if is_known],
    )
    inside = np.zeros(len(stream.times), bool)
    for stretch in np.unique(contact.stretch):
        at = contact.times[contact.stretch == stretch]
        inside |= (stream.times > at[0]) & (stream.times < at[-1])
    if inside.sum() < _LEAST_FRAMES or len(moments) < 2:
        return None
    delay = 0.0 if stream.facts is None else stream.facts.delay
    grid = np.arange(moments[0] - 1.0, moments[-1] + 1.0, _STEP_S)
    holds = [
        _zero_order_hold(grid, moments, np.array(values))
        for values in (
            [cycle.depth_commanded for cycle in cycles],
            [cycle.travel_commanded for cycle in cycles],
        )
    ]
    chosen = np.flatnonzero(inside)[:: max(1, int(inside.sum()) // _MOST_FRAMES)]
    force = -stream.wrench[chosen, :3] @ np.array(stream.approach)
    fits, totals = list[_Fit](), list[float]()
    for response in _RESPONSES_S:
        inputs = [_smooth(values, (response / 2.0, response / 2.0, delay)) for values in holds]
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
        return totals[row * columns] + step * _interpolate_minimum(rests[row]) - servo.wait_s

    tick = 0.5 * servo.interpolation_s
    return jackknife(fits[0].blocks, total).wider(tick, "and half a tick of the robot's interpolator")


class _Fit(NamedTuple):
    """Regression of force on depth and travel at one delay, after removal of level and slope in each window."""

    inputs: Floats
    force: Floats
    blocks: Ints

    def rest(self, mask: Mask) -> float:
        """Return the share of the force's variance that the regression does not explain."""
        inputs, force = self.inputs[mask], self.force[mask]
        fit = np.linalg.lstsq(inputs, force, rcond=None)[0]
        rest = force - inputs @ fit
        return float(rest @ rest) / float(force @ force)


class _Steps(NamedTuple):
    grid: Floats
    inputs: Sequence[Floats]
    """Depth and travel of the tool without a delay, m, on the grid."""
    times: Floats
    force: Floats

    def fit(self, shift: float) -> _Fit:
        """Fit the regression of force on depth and travel with this delay, s."""
        columns = [np.interp(self.times - shift, self.grid, values) for values in self.inputs]
        table = np.column_stack([*columns, self.force])
        windows = np.floor((self.times - self.times[0]) / _WINDOW_S)
        for window in np.unique(windows):
            inside = windows == window
            about = self.times[inside] - self.times[inside].mean()
            level = np.column_stack([np.ones(len(about)), about])
            table[inside] -= level @ np.linalg.lstsq(level, table[inside], rcond=None)[0]
        return _Fit(table[:, :2], table[:, 2], blocks_of(table[:, 2] ** 2))


def _zero_order_hold(grid: Floats, moments: Floats, values: Floats) -> Floats:
    """Return the values on the grid, each held from its time until the next one."""
    places = np.clip(np.searchsorted(moments, grid, side="right") - 1, 0, len(values) - 1)
    output: Floats = values[places]
    return output


def _smooth(values: Floats, times: Sequence[float]) -> Floats:
    """Return the values after a sequence of first-order filters with these time constants, s."""
    start = values[0]
    values = values - start
    for time in times:
        if time > 0.0:
            share = -math.expm1(-_STEP_S / time)
            values = lfilter([share], [1.0, share - 1.0], values)
    smoothed: Floats = values + start
    return smoothed


def _interpolate_minimum(values: Floats) -> float:
    """Return the index of the minimum, interpolated by a parabola."""
    place = int(np.argmin(values))
    if not 0 < place < len(values) - 1:
        return float(place)
    before, here, behind = values[place - 1 : place + 2]
    bend = before - 2.0 * here + behind
    return place + (0.5 * float(before - behind) / float(bend) if bend > 0.0 else 0.0)
