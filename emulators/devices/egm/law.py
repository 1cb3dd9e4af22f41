"""Control law by which a controller moves its set point towards a reference.

    speed = k * (reference - set point) + speed reference                              [M]
    filtered speed: first-order low-pass of the speed                                  [M, its order A]
    motion: filtered speed * ramp, reduced to the largest speed in all axes alike      [A]

The set point is the controller's own, not the measured position. k is PosCorrGain times the position gain. Source:
specification of EGM, section 4, with its marks.
"""

import math
from collections.abc import Callable, Sequence
from typing import TypeAlias

from emulators.devices.egm.profile import EgmProfile

Axes: TypeAlias = tuple[float, ...]
"""Six numbers: x y z in m and a rotation vector in rad, or six joints in rad. For speeds: the same units per second."""
STILL: Axes = (0.0,) * 6


def pose_load(profile: EgmProfile) -> Callable[[Axes], float]:
    """Return a function that gives a tool speed as a share of the maximum speed. It replaces MaxSpeedDeviation [A]."""
    along, about = profile.max_tcp_mm_s * 1e-3, math.radians(profile.max_tcp_deg_s)

    def load(speed: Axes) -> float:
        x, y, z, u, v, w = speed
        return max(math.hypot(x, y, z) / along, math.hypot(u, v, w) / about)

    return load


def joint_load(profile: EgmProfile) -> Callable[[Axes], float]:
    """Return a function that gives joint speeds as a share of MaxSpeedDeviation."""
    most = math.radians(profile.max_speed_dev_deg)
    return lambda speed: max(map(abs, speed)) / most


class MotionLaw:
    """Control law with its filter and its ramp."""

    def __init__(self, profile: EgmProfile, load: Callable[[Axes], float]) -> None:
        self._gain = profile.k * profile.pos_corr_gain
        self._period = profile.cycle_ms * 1e-3
        self._share = 1.0
        if profile.lp_hz:
            self._share = -math.expm1(-2.0 * math.pi * profile.lp_hz * self._period)
        self._ramp = profile.ramp_in_s
        self._load = load
        self._filtered = STILL
        self.utilization_percent = 0.0
        """Requested speed, in percent of the maximum speed."""

    def rest(self) -> None:
        """Restart from standstill."""
        self._filtered, self.utilization_percent = STILL, 0.0

    def speed(self, error: Sequence[float], ahead: Sequence[float], since: float) -> Axes:
        """Return the speed for one cycle, given the distance to the reference, the speed reference, and the time
        since the guidance began, s.
        """
        share, gain = self._share, self._gain
        self._filtered = tuple(
            [
                before + share * (gain * distance + speed - before)
                for before, distance, speed in zip(self._filtered, error, ahead, strict=True)
            ]
        )
        ramp = min(1.0, since / self._ramp) if self._ramp else 1.0
        requested = self._filtered if ramp == 1.0 else tuple([ramp * part for part in self._filtered])
        load = self._load(requested)
        self.utilization_percent = 100.0 * load
        return requested if load <= 1.0 else tuple([part / load for part in requested])
