"""Cases that describe a device to a suite: its kind, and its optional capabilities.

Undeclared capabilities are not tested: the test is skipped with a reason, and the skip is counted in pytest's
summary.
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
"""Orientation of a tool that points down, slightly rotated about each axis so that every orientation mistake is
detected: quaternion w x y z.
"""


_START = StartPose((0.9, -0.1, 0.6), _TILTED, 0.2)


@dataclass(frozen=True)
class RobotCase:
    """Robot under test: client and emulator. The capabilities describe the emulator."""

    kind: RobotKind[Any, Any]
    stop: tuple[str, str] | None = None
    """Target and name of the fault by which the emulator stops the robot until the fault ends, such as ("robot",
    "emergency-stop"); None if the emulator has no such fault.
    """
    numbered: bool = False
    """Whether its packets carry a sequence number or a time stamp by which the client recognises stale packets."""
    checked: bool = False
    """Whether its packets carry a checksum by which the client recognises damaged packets."""
    turns: bool = True
    """Whether the robot accepts orientation orders."""
    tolerance_m: float = 0.5e-3
    """Tolerance of the reported position of a stationary robot, m: covers resolution and noise."""
    tolerance_rad: float = 2e-3
    """Tolerance of the reported orientation, rad."""
    lag_s: float = 0.05
    """Tolerance of the time of a report, s. While the robot moves, this time multiplied by its speed is added to
    the position tolerance.
    """
    start: StartPose = _START
    """Start pose, around which the robot can move 30 mm in every direction and rotate 5 degrees."""
    settings: KindSettings[Any, Any] | None = None
    """Settings of client and emulator; None for their defaults."""

    @property
    def given(self) -> KindSettings[Any, Any]:
        """Settings of client and emulator, with defaults filled in."""
        return self.settings or _defaults(self.kind)


@dataclass(frozen=True)
class SensorCase:
    """Force sensor under test: client and emulator."""

    kind: SensorKind[Any, Any]
    numbered: bool = False
    """Whether its frames carry a counter by which the client recognises repeated frames."""
    checked: bool = False
    """Whether its frames carry a checksum by which the client recognises damaged frames."""
    overload: float = 1.5
    """Load at which the device or the client must report an overload, as a multiple of the range; 0 if neither can
    report an overload.
    """
    full: Wrench | None = None
    """Range of each axis, N and N·m; None to use the range that the device reports."""
    noise: float = 0.005
    """Largest error of the mean of 20 frames, as a share of the full scale: covers noise and rounding."""
    settle_s: float = 1.0
    """Settling time of the frames after a step of the wrench, s: the delay of the filter plus some frames."""
    settings: KindSettings[Any, Any] | None = None
    """Settings of client and emulator; None for their defaults."""

    @property
    def given(self) -> KindSettings[Any, Any]:
        """Settings of client and emulator, with defaults filled in."""
        return self.settings or _defaults(self.kind)


@dataclass(frozen=True)
class SurfaceCase:
    """Contact model under test."""

    kind: SurfaceKind
    above_m: tuple[float, float, float] = (0.9, -0.1, 0.7)
    """Position at which the tool does not touch the surface, base frame, m."""
    inside_m: tuple[float, float, float] = (0.9, -0.1, 0.588)
    """Position straight below `above_m` at which the tool touches the surface, base frame, m."""
    friction: float = 0.0
    """Largest tangential force of a sliding tool, as a share of the normal force."""
    settings: Any = None
    """Settings of the surface; None for the defaults."""


def _defaults(kind: DeviceKind) -> KindSettings[Any, Any]:
    if kind.emulation is None:
        pytest.skip(f"kind {kind.name} has no emulation")
    return default_settings(kind)


def declared(capability: object, description: str) -> None:
    """Skip the test if a capability is not declared. `words` name the field that declares it."""
    if not capability:
        pytest.skip(f"not declared: {description}")
