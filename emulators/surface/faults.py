"""Faults of the surface, and the obstacle above the tool.

Height and stiffness change over a ramp, because a surface that jumps would hit the tool with unlimited force.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from emulators.faults.kinds import FOREVER, Fault, Parameter
from emulators.faults.ledger import Handler, Injection
from protocol.marks import Mark, at_least, check_settings, setting

Floats = NDArray[np.float64]

_RAMP = Parameter(100.0, "duration of the change", 1.0, 60000.0, "ms")
_STIFFNESS = Parameter(50000.0, "stiffness of the obstacle", 0.0, 1e9, "N/m")

SURFACE_FAULTS: Mapping[str, Fault] = {
    "step": Fault(
        "the surface moves up or down, and back at the end",
        {"mm": Parameter(1.0, "distance, positive up", -100.0, 100.0, "mm"), "ramp_ms": _RAMP},
        FOREVER,
    ),
    "hole": Fault(
        "the surface drops, and comes back at the end",
        {"depth_mm": Parameter(20.0, "depth", 0.0, 1000.0, "mm"), "ramp_ms": _RAMP},
        2.0,
    ),
    "hard": Fault(
        "an inclusion: the stiffness under the tool changes, and changes back at the end",
        {"factor": Parameter(10.0, "factor on the stiffness", 0.0, 10000.0), "ramp_ms": _RAMP},
        FOREVER,
    ),
    "rises": Fault(
        "the surface moves up or down at constant speed, and stays where it is at the end",
        {"mm_s": Parameter(2.0, "speed, positive up", -1000.0, 1000.0, "mm/s")},
        1.0,
    ),
    "swings": Fault(
        "the surface oscillates up and down, and stays where it is at the end",
        {
            "mm": Parameter(1.0, "amplitude", 0.0, 100.0, "mm"),
            "period_s": Parameter(2.0, "period", 0.01, 3600.0, "s"),
        },
        FOREVER,
    ),
}

OBSTACLE_FAULTS: Mapping[str, Fault] = {
    "above": Fault(
        "an obstacle above the tool pushes it back down",
        {
            "height_mm": Parameter(5.0, "height above the present position of the tip", 0.0, 10000.0, "mm"),
            "stiffness_n_m": _STIFFNESS,
        },
        FOREVER,
    )
}


@dataclass(frozen=True)
class ObstacleProfile:
    """Obstacle: a level plane above the tool, which the tool may hit when it retracts."""

    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid"}

    height_mm: float | None = setting(
        None, Mark.CHOSEN, "height above the start point; no obstacle by default", at_least(0.0), unit="mm"
    )
    stiffness_n_m: float = setting(
        50000.0, Mark.CHOSEN, "stiffness of the obstacle", at_least(0.0), unit="N/m"
    )

    def __post_init__(self) -> None:
        check_settings(self)


class SurfaceFaults:
    """Changes of a surface by its faults. `on_change` is called with the time from which the surface has changed, s."""

    def __init__(self, on_change: Callable[[float], object]) -> None:
        self._on_change = on_change
        self._faults: list[Injection] = []
        self.handlers: Mapping[str, Handler] = {
            name: Handler(self._begin, self._end) for name in SURFACE_FAULTS
        }
        """Fault handlers for a ledger, by fault name."""

    @property
    def faulty(self) -> bool:
        """Whether faults may have changed the surface."""
        return bool(self._faults)

    def rise(self, times: Floats) -> tuple[Floats, Floats]:
        """Return the height by which faults have raised the surface, m, and its upward speed, m/s, at `times` (n,)."""
        height, speed = np.zeros_like(times), np.zeros_like(times)
        for injection in self._faults:
            if injection.fault in _RISES:
                up, fast = _RISES[injection.fault](injection, times)
                height += up
                speed += fast
        return height, speed

    def stiffness(self, times: Floats) -> Floats:
        """Return the factor by which faults multiply the stiffness at `times` (n,)."""
        factor = np.ones_like(times)
        for injection in self._faults:
            if injection.fault == "hard":
                factor *= 1.0 + (injection.number("factor") - 1.0) * _ramp(injection, times)[0]
        return factor

    def count(self, times: Floats, touched: NDArray[np.bool_]) -> None:
        """Count the samples (n,) in which the tool touches the surface, or would touch it without a fault."""
        for injection in self._faults:
            injection.struck += int((touched & (times >= injection.injected_at)).sum())

    def _begin(self, injection: Injection) -> None:
        self._faults.append(injection)
        self._on_change(injection.injected_at)

    def _end(self, injection: Injection, now: float) -> None:
        assert injection.ended_at is not None
        if injection.ends_at != injection.ended_at:  # earlier than predicted
            self._on_change(injection.ended_at)


def _end_of(injection: Injection) -> float:
    end = injection.ends_at if injection.ended_at is None else injection.ended_at
    return math.inf if end is None else end


def _ramp(injection: Injection, times: Floats) -> tuple[Floats, Floats]:
    """Return the completed share of the change (n,), 0 … 1, and its rate, 1/s."""
    ramp, end = injection.number("ramp_ms") * 1e-3, _end_of(injection)
    share, growth = np.zeros_like(times), np.zeros_like(times)
    for begin, sign in ((injection.injected_at, 1.0), (end, -1.0)):
        if begin == math.inf:
            continue
        since = (times - begin) / ramp
        share += sign * since.clip(0.0, 1.0)
        growth += np.where((since > 0.0) & (since < 1.0), sign / ramp, 0.0)
    return share, growth


def _step(injection: Injection, times: Floats) -> tuple[Floats, Floats]:
    share, growth = _ramp(injection, times)
    by = injection.number("mm") * 1e-3 if injection.fault == "step" else injection.number("depth_mm") * -1e-3
    return by * share, by * growth


def _constant_motion(injection: Injection, times: Floats) -> tuple[Floats, Floats]:
    speed = injection.number("mm_s") * 1e-3
    since = times - injection.injected_at
    until = _end_of(injection) - injection.injected_at
    moving = (since > 0.0) & (since < until)
    return speed * since.clip(0.0, until), np.where(moving, speed, 0.0)


def _oscillation(injection: Injection, times: Floats) -> tuple[Floats, Floats]:
    amplitude, rate = injection.number("mm") * 1e-3, 2.0 * math.pi / injection.number("period_s")
    since = times - injection.injected_at
    until = _end_of(injection) - injection.injected_at
    phase = rate * since.clip(0.0, until)
    moving = (since > 0.0) & (since < until)
    speed: Floats = amplitude * rate * np.cos(phase) * moving
    return amplitude * np.sin(phase), speed


_RISES: Mapping[str, Callable[[Injection, Floats], tuple[Floats, Floats]]] = {
    "step": _step,
    "hole": _step,
    "rises": _constant_motion,
    "swings": _oscillation,
}


@dataclass(frozen=True, slots=True)
class _Plane:
    """Obstacle above the tool."""

    height: float
    """Height of the lower side, base z, m."""
    stiffness: float
    injection: Injection | None
    """Fault that created the obstacle; None for a permanent obstacle."""


class Obstacles:
    """Obstacles above the tool, which push straight down without friction."""

    def __init__(
        self,
        profile: ObstacleProfile,
        start_height: float,
        tip_height: Callable[[float], float],
        on_change: Callable[[float], object],
    ) -> None:
        """Heights are base z, m.

        `tip_height` returns the height of the tip at a given time. `on_change` is as for `SurfaceFaults`.
        """
        self._tip_height = tip_height
        self._on_change = on_change
        self._planes: list[_Plane] = []
        if profile.height_mm is not None:
            height = start_height + profile.height_mm * 1e-3
            self._planes.append(_Plane(height, profile.stiffness_n_m, None))
        self.handlers: Mapping[str, Handler] = {
            name: Handler(self._begin, self._end) for name in OBSTACLE_FAULTS
        }
        """Fault handlers for a ledger, by fault name."""

    @property
    def any(self) -> bool:
        """Whether there are obstacles."""
        return bool(self._planes)

    def force(self, heights: Floats, times: Floats, count: bool) -> Floats:
        """Return the force (n,) along base z, N, on a tip at heights (n,), m.

        `count` states whether affected samples are counted.
        """
        force = np.zeros_like(heights)
        for plane in self._planes:
            pressing = plane.stiffness * np.maximum(heights - plane.height, 0.0)
            if (injection := plane.injection) is not None:
                pressing *= (times >= injection.injected_at) & (times < _end_of(injection))
                if count:
                    injection.struck += int((pressing > 0.0).sum())
            force -= pressing
        return force

    def _begin(self, injection: Injection) -> None:
        height = self._tip_height(injection.injected_at) + injection.number("height_mm") * 1e-3
        self._planes.append(_Plane(height, injection.number("stiffness_n_m"), injection))
        self._on_change(injection.injected_at)

    def _end(self, injection: Injection, now: float) -> None:
        assert injection.ended_at is not None
        if injection.ends_at != injection.ended_at:
            self._on_change(injection.ended_at)
