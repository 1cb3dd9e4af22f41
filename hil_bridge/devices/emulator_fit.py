"""Figures of a real device, as a recording shows them, and the seam by which its room makes settings of them.

A room with `RobotEmulation.match` or `SensorEmulation.match` gives the settings under which its emulator shows the same
figures. A figure that the recording does not show is NaN, and its setting stays as it is.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, TypeAlias

from protocol.geometry import Wrench

Sections: TypeAlias = Mapping[str, Mapping[str, object]]
"""Settings by the dotted name of their section."""
_UNKNOWN: Wrench = (math.nan,) * 6
_FEWEST_RAD_S = 1.0
"""Chosen: no loop is slower."""


class RobotFigures(NamedTuple):
    """Of a robot."""

    servo_s: float = math.nan
    """Transport delay and response of the servo together, s."""
    noise_ratio: float = math.nan
    """Noise of the reported place over that of the emulated robot with its settings."""
    turnarounds_ms: Mapping[str, list[float]] = {}
    """Quantiles of the hops that are the robot's own, by name; empty for a robot without any."""


class SensorFigures(NamedTuple):
    """Of a sensor."""

    noise: Wrench = _UNKNOWN
    """Noise of each axis behind the filter, N and N·m."""
    cutoff_hz: float = math.nan
    """Of its filter; NaN also for one that is not seen."""
    drift_n_min: tuple[float, float, float] = (math.nan,) * 3
    """Of the zero of each force."""
    period_s: float = math.nan
    """Between two frames."""
    scales: Wrench = _UNKNOWN
    """N and N·m of a count."""


MatchRobot: TypeAlias = Callable[[Any, RobotFigures], Sections]
MatchSensor: TypeAlias = Callable[[Any, SensorFigures], Sections]
"""From the `KindSettings` of a device and its figures."""


class LateSettings(NamedTuple):
    """Settings under which an emulated device is as late as a recorded one, for `hil-bridge latency -o`."""

    notes: Sequence[str]
    """Lines of a comment above the settings."""
    sections: Sections
    left_out: str = ""
    """Delay that is not emulated, in words; empty if there is none."""


LateRobot: TypeAlias = Callable[[Mapping[str, Sequence[float]], str, Any], LateSettings]
"""From quantiles of the robot's own hops by name, in ms, its URL ("" for the emulated one) and its `KindSettings`."""
LateSensor: TypeAlias = Callable[[Callable[[], Sequence[float]]], LateSettings]
"""From a function that returns quantiles of the delay of its frames, in ms. It raises ConfigError without delays."""


def split_servo(servo_s: float, response_s: float, damping_ratio: float) -> tuple[float, float]:
    """A transport delay, s, and a natural frequency, rad/s, that make up a servo's time with the usual response if it
    is long enough.
    """
    delay = max(0.0, servo_s - response_s)
    rest = max(servo_s - delay, 1e-4)
    return delay, max(_FEWEST_RAD_S, 2.0 * damping_ratio / rest)


def known(values: tuple[float, ...], factor: float = 1.0) -> list[float] | None:
    """Values of all axes as a setting, four digits each; None where one is not known."""
    return [float(f"{value * factor:.4g}") for value in values] if all(map(math.isfinite, values)) else None


def given(**settings: object) -> dict[str, object]:
    """Settings without those that are None."""
    return {name: value for name, value in settings.items() if value is not None}


def behind_filter(weight: float) -> float:
    """By how much a filter of first order with this weight of a new sample lowers white noise."""
    return math.sqrt(weight / (2.0 - weight))
