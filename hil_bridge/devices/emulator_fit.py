"""Figures measured on a real device, and the interface through which a device package converts them to emulator
settings.

A package with `RobotEmulation.match` or `SensorEmulation.match` returns the settings for which its emulator has the
same figures. A figure that the recording does not contain is NaN, and the corresponding setting stays unchanged.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, TypeAlias

from protocol.geometry import Wrench

Sections: TypeAlias = Mapping[str, Mapping[str, object]]
"""Settings by dotted section name."""
_UNKNOWN: Wrench = (math.nan,) * 6
_FEWEST_RAD_S = 1.0
"""Lowest natural frequency of a servo, rad/s. Chosen: no position loop is slower."""


class RobotFigures(NamedTuple):
    """Figures measured on a robot."""

    servo_s: float = math.nan
    """Total of the servo's transport delay and response time, s."""
    noise_ratio: float = math.nan
    """Noise of the reported position, divided by the noise of the emulated robot with its present settings."""
    turnarounds_ms: Mapping[str, list[float]] = {}
    """Quantiles of the hops inside the robot by name, ms; empty if the robot has no such hops."""


class SensorFigures(NamedTuple):
    """Figures measured on a sensor."""

    noise: Wrench = _UNKNOWN
    """Noise of each axis after the filter, N and N·m."""
    cutoff_hz: float = math.nan
    """Cutoff frequency of the sensor's filter, Hz; NaN if unknown or if no filter was detected."""
    drift_n_min: tuple[float, float, float] = (math.nan,) * 3
    """Zero drift of each force axis, N/min."""
    period_s: float = math.nan
    """Time between two frames, s."""
    scales: Wrench = _UNKNOWN
    """Scale of each axis, N or N·m per count."""


MatchRobot: TypeAlias = Callable[[Any, RobotFigures], Sections]
MatchSensor: TypeAlias = Callable[[Any, SensorFigures], Sections]
"""Function that returns the sections for the `KindSettings` of a sensor and its measured figures."""


class LateSettings(NamedTuple):
    """Settings with which an emulated device has the latency of a recorded device, for `hil-bridge latency -o`."""

    notes: Sequence[str]
    """Comment lines written above the settings."""
    sections: Sections
    left_out: str = ""
    """Description of a delay that is not emulated, or an empty string."""


LateRobot: TypeAlias = Callable[[Mapping[str, Sequence[float]], str, Any], LateSettings]
"""Function that returns the latency settings of a robot. Its arguments are the quantiles of the hops inside the
robot by name, in ms, the robot's URL ("" for the emulated robot) and its `KindSettings`.
"""
LateSensor: TypeAlias = Callable[[Callable[[], Sequence[float]]], LateSettings]
"""Function that returns the latency settings of a sensor. Its argument is a function that returns quantiles of the
frame delay, in ms, and raises ConfigError without a measured delay.
"""


def split_servo(servo_s: float, response_s: float, damping_ratio: float) -> tuple[float, float]:
    """Split the total time of a servo into a transport delay, s, and a natural frequency, rad/s. The response time
    is `response_s` if the total time is at least that long.
    """
    delay = max(0.0, servo_s - response_s)
    rest = max(servo_s - delay, 1e-4)
    return delay, max(_FEWEST_RAD_S, 2.0 * damping_ratio / rest)


def match_cycles(section: str, servo: Any, cycle_ms: float, figures: RobotFigures) -> Sections:
    """Return the transport delay of a servo in complete cycles, and its natural frequency, as settings of a section.
    `servo` has the present `damping_ratio` and `natural_frequency_rad_s`.
    """
    if math.isnan(figures.servo_s):
        return {}
    response, cycle_s = 2.0 * servo.damping_ratio / servo.natural_frequency_rad_s, cycle_ms / 1e3
    cycles = max(0, math.floor((figures.servo_s - response) / cycle_s))
    rest = max(figures.servo_s - cycles * cycle_s, 0.1 * response)
    frequency = round(2.0 * servo.damping_ratio / rest, 3)
    return {section: {"transport_delay_ms": cycles * cycle_ms, "natural_frequency_rad_s": frequency}}


def noise_settings(figures: SensorFigures, factor: float = 1.0) -> dict[str, object]:
    """Return the settings of noise and drift. `factor` is the noise before the filter, divided by that after it."""
    return given(
        noise_n=known(figures.noise[:3], factor),
        noise_nm=known(figures.noise[3:], factor),
        slope_n_min=known(figures.drift_n_min),
    )


def known(values: tuple[float, ...], factor: float = 1.0) -> list[float] | None:
    """Return the values of all axes as a setting, rounded to four digits, or None if any of them is unknown."""
    return [float(f"{value * factor:.4g}") for value in values] if all(map(math.isfinite, values)) else None


def given(**settings: object) -> dict[str, object]:
    """Return the settings that are not None."""
    return {name: value for name, value in settings.items() if value is not None}


def behind_filter(weight: float) -> float:
    """Return the factor by which a first-order filter reduces white noise. `weight` is the weight of a new sample."""
    return math.sqrt(weight / (2.0 - weight))
