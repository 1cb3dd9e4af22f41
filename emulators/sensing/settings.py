"""Settings of the errors of an emulated sensor: descriptions, bounds and units. Each sensor adds defaults and marks."""

import math
from typing import Any, Protocol, TypeAlias

from emulators.sensing.unrest import SensorErrors
from protocol.geometry import Vector
from protocol.marks import Bounds, SettingError, above, at_least, between

PerAxis: TypeAlias = Vector | float
"""One value for each axis, x first, or one value for all three axes."""

_EACH = "of x, y, z, or one number for all"
_FORCES = ("noise_n", "wander_n", "slope_n_min", "vibration_n", "motion_n")
_PER_AXIS = (*_FORCES, "noise_nm")


class SensorErrorSettings(Protocol):
    """Settings of a sensor with errors in addition to its white noise."""

    @property
    def wander_n(self) -> PerAxis: ...
    @property
    def slope_n_min(self) -> PerAxis: ...
    @property
    def hysteresis_share(self) -> float: ...
    @property
    def cross_talk_share(self) -> float: ...
    @property
    def creep_share(self) -> float: ...
    @property
    def creep_s(self) -> float: ...
    @property
    def vibration_n(self) -> PerAxis: ...
    @property
    def vibration_hz(self) -> tuple[float, float]: ...
    @property
    def vibration_peak_hz(self) -> float: ...
    @property
    def vibration_peak_share(self) -> float: ...
    @property
    def motion_n(self) -> PerAxis: ...
    @property
    def motion_mm_s(self) -> float: ...


# Descriptions, bounds and units of the settings: the arguments of `setting` after the default and its mark.

_Rest: TypeAlias = tuple[str, Bounds, str]

STIFFNESS_N_M: _Rest = (
    "stiffness of the body against forces along x, y, z; it acts if the arm is compliant",
    above(0.0),
    "N/m",
)
STIFFNESS_NM_RAD: _Rest = "stiffness of the body against moments about x, y, z", above(0.0), "N·m/rad"
NOISE_N: _Rest = f"white noise of the forces, rms, {_EACH}", at_least(0.0), "N"
NOISE_NM: _Rest = f"white noise of the moments, rms, {_EACH}", at_least(0.0), "N·m"
WANDER_N: _Rest = (
    f"random walk of the forces' zero from power-up, rms change in 10 s, {_EACH}",
    at_least(0.0),
    "N",
)
SLOPE_N_MIN: _Rest = (
    f"steady change of the forces' zero from power-up, {_EACH}",
    between(-1000.0, 1000.0),
    "N/min",
)
HYSTERESIS_SHARE: _Rest = (
    "difference of the readings of a rising and a falling load, as a share of the load's change",
    between(0.0, 0.1),
    "",
)
CROSS_TALK_SHARE: _Rest = (
    "largest reading of an axis due to another axis, in shares of their full scales",
    between(0.0, 0.1),
    "",
)
CREEP_SHARE: _Rest = "share of a load change that the sensor reports late", between(0.0, 0.5), ""
CREEP_S: _Rest = "time constant of that share", above(0.0), "s"
VIBRATION_N: _Rest = f"vibration of the stationary arm in the signal, rms, {_EACH}", at_least(0.0), "N"
VIBRATION_HZ: _Rest = "band of that vibration, from and to", above(0.0), "Hz"
VIBRATION_PEAK_HZ: _Rest = "peak of that vibration outside the band", above(0.0), "Hz"
VIBRATION_PEAK_SHARE: _Rest = "share of the vibration's variance in that peak", between(0.0, 1.0), ""
MOTION_N: _Rest = f"white noise that is added while the arm moves, rms, {_EACH}", at_least(0.0), "N"
MOTION_MM_S: _Rest = (
    "tool speed from which that noise has its full value; proportional below",
    above(0.0),
    "mm/s",
)


def check_errors(profile: Any) -> None:
    """Raise SettingError for a setting with the wrong number of axis values, and for an invalid frequency band."""
    for name in _PER_AXIS:
        value = getattr(profile, name, 0.0)
        if isinstance(value, tuple) and len(value) != 3:
            raise SettingError(name, f"must be one value or three, got {len(value)}")
    band = profile.vibration_hz
    if len(band) != 2 or not band[0] <= band[1] or not math.isfinite(band[1]):
        raise SettingError("vibration_hz", f"must be two ascending frequencies, got {band}")


def per_axis(value: PerAxis) -> Vector:
    """Return the values of all three axes."""
    return value if isinstance(value, tuple) else (value, value, value)


def unrest(profile: SensorErrorSettings, powered_at: float) -> SensorErrors:
    """Return the errors of a sensor in SI units. `powered_at` is the time at which the sensor powers up, s."""
    x, y, z = per_axis(profile.slope_n_min)
    return SensorErrors(
        since=powered_at,
        wander=per_axis(profile.wander_n),
        slope=(x / 60.0, y / 60.0, z / 60.0),
        hysteresis_share=profile.hysteresis_share,
        cross_talk_share=profile.cross_talk_share,
        creep_share=profile.creep_share,
        creep_s=profile.creep_s,
        vibration=per_axis(profile.vibration_n),
        vibration_hz=profile.vibration_hz,
        peak_hz=profile.vibration_peak_hz,
        peak_share=profile.vibration_peak_share,
        motion=per_axis(profile.motion_n),
        motion_speed=profile.motion_mm_s / 1000.0,
    )
