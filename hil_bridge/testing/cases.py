"""Cases that describe a device to a suite: its kind, and its optional capabilities.

Capabilities that are not declared are not tested: the test is skipped with a reason, and counted in pytest's summary.
"""

from dataclasses import dataclass
from typing import Any

import pytest

from emulators.seams import StartPose
from hil_bridge.devices.kinds import (
    DeviceKind,
    KindSettings,
    RobotKind,
    SensorKind,
    SurfaceKind,
    default_settings,
)
from protocol.geometry import Wrench

__all__ = ["RobotCase", "SensorCase", "SurfaceCase"]

_TILTED = (0.1, 0.975, 0.15, 0.129)
"""Tool down, slightly rotated about each axis, so that every orientation mistake shows. w x y z."""


_START = StartPose((0.9, -0.1, 0.6), _TILTED, 0.2)


@dataclass(frozen=True)
class RobotCase:
    """Robot under test: client and emulator. The capabilities are those of the emulator."""

    kind: RobotKind[Any, Any]
    stop: tuple[str, str] | None = None
    """Target and name of the fault by which the emulator stops the robot until the fault ends, such as
    ("robot", "emergency-stop"). None: the emulator has none.
    """
    numbered: bool = False
    """Whether its packets carry a number or a time, by which its client recognises stale ones."""
    checked: bool = False
    """Whether its packets carry a checksum, by which its client recognises damaged ones."""
    turns: bool = True
    """Whether it accepts orders for the orientation."""
    tolerance_m: float = 0.5e-3
    """Tolerance of the reported position of a stationary robot, m: resolution and noise."""
    tolerance_rad: float = 2e-3
    """Tolerance of the reported orientation, rad."""
    lag_s: float = 0.05
    """Tolerance of the time of a report, s; times the speed, it adds to the tolerance while the robot moves."""
    start: StartPose = _START
    """Start pose, around which it can move 30 mm in every direction and rotate 5 degrees."""
    settings: KindSettings[Any, Any] | None = None
    """Settings of client and emulator; None: their defaults."""

    @property
    def given(self) -> KindSettings[Any, Any]:
        """Settings of client and emulator."""
        return self.settings or _defaults(self.kind)


@dataclass(frozen=True)
class SensorCase:
    """Force sensor under test: client and emulator."""

    kind: SensorKind[Any, Any]
    numbered: bool = False
    """Whether its frames carry a counter, by which its client recognises repeated ones."""
    checked: bool = False
    """Whether its frames carry a checksum, by which its client recognises damaged ones."""
    overload: float = 1.5
    """Load, in multiples of the range, at which device or client must report an overload; 0 if they cannot."""
    full: Wrench | None = None
    """Range of each axis, N and N·m; None: as reported by the device."""
    noise: float = 0.005
    """Largest error of the mean of 20 frames, as a share of the full scale: noise, rounding."""
    settle_s: float = 1.0
    """Settling time of the frames after a step of the wrench, s: the filter's delay and some frames."""
    settings: KindSettings[Any, Any] | None = None
    """Settings of client and emulator; None: their defaults."""

    @property
    def given(self) -> KindSettings[Any, Any]:
        """Settings of client and emulator."""
        return self.settings or _defaults(self.kind)


@dataclass(frozen=True)
class SurfaceCase:
    """Contact model under test."""

    kind: SurfaceKind
    above_m: tuple[float, float, float] = (0.9, -0.1, 0.7)
    """Position without contact, base frame, m."""
    inside_m: tuple[float, float, float] = (0.9, -0.1, 0.588)
    """Position straight below, with contact, base frame, m."""
    friction: float = 0.0
    """Largest tangential force of a sliding tool, as a share of the normal force."""
    settings: Any = None
    """Settings of the surface; None: the defaults."""


def _defaults(kind: DeviceKind) -> KindSettings[Any, Any]:
    if kind.emulation is None:
        pytest.skip(f"kind {kind.name} has no emulation")
    return default_settings(kind)


def declared(capability: object, words: str) -> None:
    """Skip the test if a capability is not declared; `words` name the field."""
    if not capability:
        pytest.skip(f"not declared: {words}")
