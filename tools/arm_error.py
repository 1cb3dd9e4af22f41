"""How far the error of a Universal Robot's arm changes in the time that an order takes: a bound of any control.

An order is made from the newest force, and shows in the force when the arm has done it. The arm's error becomes another
meanwhile. Either the newest error is held for the next one, or it is forecast. The forecast here is linear, is fitted
to the very errors that it is judged by, and is given them without noise. Surface and stiffness are known to both.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from emulators.devices.rtde.drives import Drives
from emulators.devices.rtde.kinematics import ARMS, USUAL, flange, nearest
from emulators.devices.rtde.profile import RtdeProfile
from protocol.geometry import Pose

START_M = (0.9, -0.1, 0.79)
"""Flange of the emulated cell's tool at its surface."""
_DOWN = (0.0, 1.0, 0.0, 0.0)
SPEED_M_S = 5.5e-3
LENGTH_S, BEGIN_S, WINDOW_S = 20.0, 2.0, 2.5
"""Time of a path, its begin that does not count, and the time within which the largest error is looked for, s."""
SEEDS = range(1, 6)
PAST, STRIDE = 30, 2
"""Past errors that the forecast goes by, and how many cycles they are apart."""


class Left(NamedTuple):
    """The part of the arm's error that stays, m."""

    rms: float
    peak: float
    """Mean of the largest ones of all windows."""


def errors_m(profile: RtdeProfile, seed: int) -> NDArray[np.float64]:
    """Depth of the arm less that of its target in each cycle of a path along y, m."""
    arm, period = ARMS[profile.model], profile.cycle_ms * 1e-3
    x, y, z = START_M
    joints = nearest(arm, Pose(START_M, _DOWN), USUAL)
    assert joints is not None, "the arm reaches the start"
    drives, errors = Drives(profile, joints, seed), []
    for k in range(round(LENGTH_S / period)):
        target = nearest(arm, Pose((x, y + SPEED_M_S * period * k, z), _DOWN), joints)
        assert target is not None, "the arm reaches the path"
        joints = target
        errors.append(z - flange(arm, drives.step(target)).position[2])
    return np.array(errors[round(BEGIN_S / period) :])


def left_over(profile: RtdeProfile, lag_s: float) -> tuple[Left, Left]:
    """With the error held, and with the best forecast, where an order takes this time, s."""
    lag, span = round(lag_s * 1e3 / profile.cycle_ms), PAST * STRIDE
    runs = [errors_m(profile, seed) for seed in SEEDS]
    known = [np.lib.stride_tricks.sliding_window_view(run, span + 1)[:-lag, ::STRIDE] for run in runs]
    later = [run[span + lag :] for run in runs]
    factors, *_ = np.linalg.lstsq(np.concatenate(known), np.concatenate(later), rcond=None)
    window = round(WINDOW_S * 1e3 / profile.cycle_ms)
    held = [after - before[:, -1] for before, after in zip(known, later, strict=True)]
    forecast = [after - before @ factors for before, after in zip(known, later, strict=True)]
    return _left(held, window), _left(forecast, window)


def _left(runs: Sequence[NDArray[np.float64]], window: int) -> Left:
    peaks = [run[a:b].max() for run in runs for a, b in pairwise(range(0, len(run) + 1, window))]
    return Left(float(np.sqrt(np.mean(np.concatenate(runs) ** 2))), float(np.mean(peaks)))
