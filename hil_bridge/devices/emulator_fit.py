"""Figures measured on a real device, and the interface by which a device package turns them into emulator settings.

A package with `RobotEmulation.match` or `SensorEmulation.match` returns the settings with which its emulator has the
same figures. A figure that the recording does not contain is NaN, and its setting stays unchanged.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, TypeAlias

from protocol.geometry import Wrench

Sections: TypeAlias = Mapping[str, Mapping[str, object]]
"""Settings by dotted section name."""
_UNKNOWN: Wrench = (math.nan,) * 6
_FEWEST_RAD_S = 1.0
"""Chosen: lowest natural frequency; no position loop is slower."""


class RobotFigures(NamedTuple):
    """Figures of a robot."""

    servo_s: float = math.nan
    """Total of the servo's transport delay and response time, s."""
    noise_ratio: float = math.nan
    """Ratio of the noise of the reported position to that of the emulated robot with its present settings."""
    turnarounds_ms: Mapping[str, list[float]] = {}
    """Quantiles of the robot's own hops by name, ms; empty if it has none."""


class SensorFigures(NamedTuple):
    """Figures of a sensor."""

    noise: Wrench = _UNKNOWN
    """Noise of each axis after the filter, N and N·m."""
    cutoff_hz: float = math.nan
    """Cutoff of its filter; NaN also if none was detected."""
    drift_n_min: tuple[float, float, float] = (math.nan,) * 3
    """Drift of the zero of each force."""
    period_s: float = math.nan
    """Time between two frames."""
    scales: Wrench = _UNKNOWN
    """N and N·m per count."""


MatchRobot: TypeAlias = Callable[[Any, RobotFigures], Sections]
MatchSensor: TypeAlias = Callable[[Any, SensorFigures], Sections]
"""Returns sections from the `KindSettings` of a device and its measured figures."""


class LateSettings(NamedTuple):
    """Settings that give an emulated device the latency of a recorded one, for `hil-bridge latency -o`."""

    notes: Sequence[str]
    """Comment lines written above the settings."""
    sections: Sections
    left_out: str = ""
    """Description of a delay that is not emulated; empty if there is none."""


LateRobot: TypeAlias = Callable[[Mapping[str, Sequence[float]], str, Any], LateSettings]
"""Returns settings from quantiles of the robot's own hops by name, in ms, its URL ("" for the emulated robot) and its
`KindSettings`.
"""
LateSensor: TypeAlias = Callable[[Callable[[], Sequence[float]]], LateSettings]
"""Returns settings from a function that returns quantiles of the frames' delay, in ms, and raises ConfigError if there
are none.
"""


def split_servo(servo_s: float, response_s: float, damping_ratio: float) -> tuple[float, float]:
    """Split a servo's total time into a transport delay, s, and a natural frequency, rad/s. The default response is
    used if the total is long enough.
    """
    delay = max(0.0, servo_s - response_s)
    rest = max(servo_s - delay, 1e-4)
    return delay, max(_FEWEST_RAD_S, 2.0 * damping_ratio / rest)


def known(values: tuple[float, ...], factor: float = 1.0) -> list[float] | None:
    """Return the values of all axes as a setting, with four digits each, or None if any is unknown."""
    return [float(f"{value * factor:.4g}") for value in values] if all(map(math.isfinite, values)) else None


def given(**settings: object) -> dict[str, object]:
    """Return the settings that are not None."""
    return {name: value for name, value in settings.items() if value is not None}


def behind_filter(weight: float) -> float:
    """Return the factor by which a first-order filter with this weight of a new sample reduces white noise."""
    return math.sqrt(weight / (2.0 - weight))
