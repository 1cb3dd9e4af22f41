"""Settings of the errors of an emulated sensor: words, bounds, units. Defaults and marks are those of each sensor."""

import math
from typing import Any, Protocol, TypeAlias

from emulators.sensing.unrest import Unrest
from protocol.geometry import Vector
from protocol.marks import Bounds, SettingError, above, at_least, between

PerAxis: TypeAlias = Vector | float
"""A value of each axis, x first, or one for all three."""

_EACH = "of x, y, z, or one number for all"
_FORCES = ("noise_n", "wander_n", "slope_n_min", "vibration_n", "motion_n")
_PER_AXIS = (*_FORCES, "noise_nm")


class UnrestSettings(Protocol):
    """Settings of a sensor with errors beside its noise."""

    @property
    def wander_n(self) -> PerAxis: ...
    @property
    def slope_n_min(self) -> PerAxis: ...
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


# What the settings mean, their bounds and units: the rest of `setting` behind a default and its mark.

_Rest: TypeAlias = tuple[str, Bounds, str]

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
CREEP_SHARE: _Rest = "share of a changed load that it tells late", between(0.0, 0.5), ""
CREEP_S: _Rest = "time constant with which that share comes", above(0.0), "s"
VIBRATION_N: _Rest = f"vibration of the standing arm that it feels, rms, {_EACH}", at_least(0.0), "N"
VIBRATION_HZ: _Rest = "band of that vibration, from and to", above(0.0), "Hz"
VIBRATION_PEAK_HZ: _Rest = "peak of that vibration outside the band", above(0.0), "Hz"
VIBRATION_PEAK_SHARE: _Rest = "share of its variance in that peak", between(0.0, 1.0), ""
MOTION_N: _Rest = f"white noise that is added while the arm moves, rms, {_EACH}", at_least(0.0), "N"
MOTION_MM_S: _Rest = (
    "speed of the tool from which on that noise is whole; in proportion below",
    above(0.0),
    "mm/s",
)


def check_errors(profile: Any) -> None:
    """Raise SettingError for a setting of errors that has not a value of each axis, and for a band that is none."""
    for name in _PER_AXIS:
        value = getattr(profile, name, 0.0)
        if isinstance(value, tuple) and len(value) != 3:
            raise SettingError(name, f"must be one value, or three, got {len(value)}")
    band = profile.vibration_hz
    if len(band) != 2 or not band[0] <= band[1] or not math.isfinite(band[1]):
        raise SettingError("vibration_hz", f"must be two frequencies that ascend, got {band}")


def per_axis(value: PerAxis) -> Vector:
    """Return the values of all three axes."""
    return value if isinstance(value, tuple) else (value, value, value)


def unrest(profile: UnrestSettings, powered_at: float) -> Unrest:
    """Return the errors of a sensor that is powered up at a time, s, in SI units."""
    x, y, z = per_axis(profile.slope_n_min)
    return Unrest(
        since=powered_at,
        wander=per_axis(profile.wander_n),
        slope=(x / 60.0, y / 60.0, z / 60.0),
        creep_share=profile.creep_share,
        creep_s=profile.creep_s,
        vibration=per_axis(profile.vibration_n),
        vibration_hz=profile.vibration_hz,
        peak_hz=profile.vibration_peak_hz,
        peak_share=profile.vibration_peak_share,
        motion=per_axis(profile.motion_n),
        motion_speed=profile.motion_mm_s / 1000.0,
    )
