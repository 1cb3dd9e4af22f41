"""Settings of the errors of an emulated sensor. Each sensor replaces the defaults and marks of those that are known of
it.
"""

import math
from dataclasses import dataclass
from typing import Any, TypeAlias

from emulators.sensing.unrest import SensorErrors
from protocol.geometry import Vector
from protocol.marks import Bounds, Mark, SettingError, above, at_least, between, setting

PerAxis: TypeAlias = Vector | float
"""One value for each axis, x first, or one value for all three axes."""

_EACH = "of x, y, z, or one number for all"
_FORCES = ("noise_n", "wander_n", "slope_n_min", "vibration_n", "motion_n")
_PER_AXIS = (*_FORCES, "noise_nm")


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
VIBRATION_N: _Rest = f"vibration of the stationary arm in the signal, rms, {_EACH}", at_least(0.0), "N"
VIBRATION_HZ: _Rest = "band of that vibration, from and to", above(0.0), "Hz"
VIBRATION_PEAK_HZ: _Rest = "peak of that vibration outside the band", above(0.0), "Hz"
VIBRATION_PEAK_SHARE: _Rest = "share of the vibration's variance in that peak", between(0.0, 1.0), ""
MOTION_N: _Rest = f"white noise that is added while the arm moves, rms, {_EACH}", at_least(0.0), "N"


@dataclass(frozen=True, slots=True)
class SensorErrorSettings:
    """Errors of a sensor in addition to its white noise, as settings. A sensor inherits those that are not known of it:
    the stiffness of a Gamma, another sensor with strain gauges and a similar range, and the errors of a Net F/T.
    """

    stiffness_n_m: Vector = setting((9.1e6, 9.1e6, 1.8e7), Mark.ASSUMED, *STIFFNESS_N_M)
    """Source of this and the next setting: the table of ATI's manual 9620-05-Transducer Section. Assumed, because they
    were not compared with the manual.
    """
    stiffness_nm_rad: Vector = setting((1.1e4, 1.1e4, 1.6e4), Mark.ASSUMED, *STIFFNESS_NM_RAD)
    wander_n: PerAxis = setting(0.01, Mark.ASSUMED, *WANDER_N)
    slope_n_min: PerAxis = setting(
        0.0,
        Mark.ASSUMED,
        f"steady change of the forces' zero from power-up, {_EACH}",
        between(-1000.0, 1000.0),
        unit="N/min",
    )
    hysteresis_share: float = setting(0.0, Mark.ASSUMED, *HYSTERESIS_SHARE)
    cross_talk_share: float = setting(0.0, Mark.ASSUMED, *CROSS_TALK_SHARE)
    creep_share: float = setting(0.01, Mark.ASSUMED, *CREEP_SHARE)
    creep_s: float = setting(5.0, Mark.ASSUMED, "time constant of that share", above(0.0), unit="s")
    vibration_n: PerAxis = setting((0.03, 0.009, 0.073), Mark.ASSUMED, *VIBRATION_N)
    vibration_hz: tuple[float, float] = setting((9.0, 16.0), Mark.ASSUMED, *VIBRATION_HZ)
    vibration_peak_hz: float = setting(71.0, Mark.ASSUMED, *VIBRATION_PEAK_HZ)
    vibration_peak_share: float = setting(0.04, Mark.ASSUMED, *VIBRATION_PEAK_SHARE)
    motion_n: PerAxis = setting((0.65, 0.32, 0.21), Mark.ASSUMED, *MOTION_N)
    motion_mm_s: float = setting(
        100.0,
        Mark.ASSUMED,
        "tool speed from which that noise has its full value; proportional below",
        above(0.0),
        unit="mm/s",
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
