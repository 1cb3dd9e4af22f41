"""Hysteresis and cross-talk of a sensor, applied to the load of its samples.

Hysteresis is a weighted sum of play operators, a Prandtl–Ishlinskii model, per axis: rate-independent, with a memory of
past extremes (V. Hassani, T. Tjahjowidodo, T. N. Do, A survey on hysteresis modeling, identification and control,
Mechanical Systems and Signal Processing 49, 2014, doi:10.1016/j.ymssp.2014.04.012). Cross-talk is a constant matrix.

A play is the value that follows the load at a distance of at most its threshold, and otherwise does not move. All plays
are 0 at power-up. The sum contains the difference of each play from its value after a load that rises from 0 to the
present one, in which a sensor is calibrated: such a load is read exactly, and a falling load reads too much.

The plays follow each sample, in order, including samples that are not read, so the result depends only on the number of
a sample. They are stored at intervals, to restart from when samples are computed again.
"""

import math
from collections import deque
from collections.abc import Callable

import numpy as np

from emulators.seams import Floats
from emulators.sensing.samples import Draws
from emulators.sensing.unrest import SensorErrors

_CROSS_TALK_STREAM = 4
"""Random stream of a seed for the cross-talk. It is part of the meaning of a seed, so do not change it."""
_THRESHOLDS = np.array([1 / 4, 1 / 8, 1 / 16, 1 / 32])
"""Thresholds of the plays, as shares of the full scale. Chosen: one octave apart; see `_WEIGHTS`."""
_WEIGHTS = np.array([1.0, 1.0, 1.0, 2.0])[:, np.newaxis, np.newaxis]
"""Weights of the plays, in units of the hysteresis share.

Derived: with them, a load that rises and falls again and again has a loop whose width in its middle is the hysteresis
share of the load's change, for changes from 1/8 of the full scale to the full scale. Up to 1/16, there is no loop. A
load that returns to 0 from the full scale leaves half the share of the full scale.
"""
_CHUNK = 256
"""Number of samples after which the plays are stored. Chosen."""
_STORED = 512
"""Number of stored states. Chosen: at 8000 samples per second, they cover the ten seconds that a path keeps."""
_PAST_S = 10.0
"""Age of the oldest load that can be read from a source, s. It equals the duration that a path keeps."""


def cross_talk(share: float, full_scale: Floats, seed: int) -> Floats:
    """Return the matrix (6, 6) from the load to the load with cross-talk.

    Each element off the diagonal is the reading of an axis due to another axis, in shares of their full scales. The
    largest of them equals `share`; the others are normally distributed in proportion to it. The diagonal is 1.
    """
    drawn = Draws(seed, _CROSS_TALK_STREAM).chunk(0, (len(full_scale), len(full_scale)))
    np.fill_diagonal(drawn, 0.0)
    drawn *= share / np.abs(drawn).max()
    matrix: Floats = np.eye(len(full_scale)) + drawn * full_scale[:, np.newaxis] / full_scale
    return matrix


class Distortion:
    """Hysteresis and cross-talk of the loads (6, n) of samples, by number."""

    def __init__(self, errors: SensorErrors, full_scale: Floats, rate_hz: float, seed: int) -> None:
        """`full_scale` (6,) contains the full scales of the axes, N and N·m."""
        self._share, self._past = errors.hysteresis_share, math.floor(_PAST_S * rate_hz)
        self._thresholds = _THRESHOLDS[:, np.newaxis, np.newaxis] * full_scale[:, np.newaxis]
        power_up = math.ceil(errors.since * rate_hz) - 1
        self._states = deque([(power_up, np.zeros((len(_THRESHOLDS), 6)))], maxlen=_STORED)
        """Numbers of samples, in ascending order, each with the plays (thresholds, 6) after it, N and N·m."""
        share = errors.cross_talk_share
        self._cross_talk = cross_talk(share, full_scale, seed) if share else None

    def loads(self, read: Callable[[int, int], Floats], first: int, stop: int) -> Floats:
        """Return the distorted loads (6, n) of the samples `first` … `stop` − 1.

        `read` returns the loads (6, n) of such a range. It is called once, and the range may begin earlier.
        """
        loads = self._with_hysteresis(read, first, stop) if self._share else read(first, stop)
        return loads if self._cross_talk is None else self._cross_talk @ loads

    def forget(self, number: int) -> None:
        """Drop the plays from this sample number on. The samples will differ from the samples that were read."""
        while len(self._states) > 1 and self._states[-1][0] >= number:
            self._states.pop()

    def _with_hysteresis(self, read: Callable[[int, int], Floats], first: int, stop: int) -> Floats:
        self.forget(first)
        number, plays = self._states[-1]
        begin = min(max(number + 1, first - self._past), first)
        loads = read(begin, stop)
        result = np.empty_like(loads)
        at = begin
        while at < stop:
            end = min((at // _CHUNK + 1) * _CHUNK, stop)
            load = loads[:, at - begin : end - begin]
            moved = follow(plays, load - self._thresholds, load + self._thresholds)
            risen = load - np.clip(load, -self._thresholds, self._thresholds)
            result[:, at - begin : end - begin] = load + self._share * (_WEIGHTS * (moved - risen)).sum(
                axis=0
            )
            plays = moved[..., -1]
            self._store(end - 1, plays)
            at = end
        return result[:, first - begin :]

    def _store(self, number: int, plays: Floats) -> None:
        """Store the plays after a sample, in place of earlier plays within the same chunk."""
        if len(self._states) > 1 and self._states[-1][0] // _CHUNK == number // _CHUNK:
            self._states.pop()
        self._states.append((number, plays))


def follow(plays: Floats, low: Floats, high: Floats) -> Floats:
    """Return the plays (…, n) after each of n samples, from the plays (…) before the first of them.

    `low` and `high` (…, n) are the limits of the plays at each sample. The limits of two successive samples are
    equivalent to one pair of limits, so pairs are joined until each covers all samples up to its own. The result is
    exactly that of one sample after another.
    """
    step = 1
    while step < low.shape[-1]:
        before = [limit[..., :-step] for limit in (low, high)]
        joined = [np.clip(limit, low[..., step:], high[..., step:]) for limit in before]
        low, high = (
            np.concatenate((limit[..., :step], rest), axis=-1)
            for limit, rest in zip((low, high), joined, strict=True)
        )
        step *= 2
    return np.clip(plays[..., np.newaxis], low, high)
