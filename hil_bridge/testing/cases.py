"""Facts that the author of a device tells a suite: the kind, and which of the things that devices may do this one does.

What is not declared is not tested: the test is skipped, with its reason, and pytest's summary counts it.
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
"""Tool down, and turned a little about each axis, so that no mistake about an orientation looks right. w x y z."""


_START = StartPose((0.9, -0.1, 0.6), _TILTED, 0.2)


@dataclass(frozen=True)
class RobotCase:
    """A robot: its client and its emulator. All capabilities are those of the emulated one."""

    kind: RobotKind[Any, Any]
    stop: tuple[str, str] | None = None
    """Target and name of the fault with which the emulator stops the robot and that is taken back at its end, such as
    ("robot", "emergency-stop"). None: the emulator has none.
    """
    numbered: bool = False
    """Its packets carry a number or a time, so that its client can tell an old one from a new one."""
    checked: bool = False
    """Its packets carry a check, so that its client can tell a damaged one."""
    turns: bool = True
    """It takes orders for the orientation."""
    tolerance_m: float = 0.5e-3
    """How far a report may be from the truth of its moment while the robot stands, m: resolution and noise."""
    tolerance_rad: float = 2e-3
    """The same for the angle between reported and true orientation, rad."""
    lag_s: float = 0.05
    """How wrong the time of a report may be, s; times the speed, it adds to the tolerance while the robot moves."""
    start: StartPose = _START
    """Where it is powered up: a place around which it can move 30 mm to each side and turn 5 degrees."""
    settings: KindSettings[Any, Any] | None = None
    """Settings of client and emulator; None: their defaults."""

    @property
    def given(self) -> KindSettings[Any, Any]:
        """The settings."""
        return self.settings or _defaults(self.kind)


@dataclass(frozen=True)
class SensorCase:
    """A force sensor: its client and its emulator."""

    kind: SensorKind[Any, Any]
    numbered: bool = False
    """Its frames carry a counter, so that its client can tell one that comes again."""
    checked: bool = False
    """Its frames carry a check, so that its client can tell a damaged one."""
    overload: float = 1.5
    """How many times its range an axis is pushed until device or client must tell that it is at its end; 0 for one that
    cannot tell.
    """
    full: Wrench | None = None
    """The range of each axis, N and N·m; None: the one that the device tells."""
    noise: float = 0.005
    """Largest error of the mean of 20 frames, as a part of an axis' full scale: noise, rounding."""
    settle_s: float = 1.0
    """After which the frames show a wrench that has stepped, s: the filter's delay, and some frames more."""
    settings: KindSettings[Any, Any] | None = None
    """Settings of client and emulator; None: their defaults."""

    @property
    def given(self) -> KindSettings[Any, Any]:
        """The settings."""
        return self.settings or _defaults(self.kind)


@dataclass(frozen=True)
class SurfaceCase:
    """A contact model."""

    kind: SurfaceKind
    above_m: tuple[float, float, float] = (0.9, -0.1, 0.7)
    """A place at which the tool does not touch it, base frame, m."""
    inside_m: tuple[float, float, float] = (0.9, -0.1, 0.588)
    """A place straight below, at which it is pressed upon, base frame, m."""
    friction: float = 0.0
    """Largest part of the normal force that acts along the surface while the tool slides."""
    settings: Any = None
    """Its settings; None: the defaults."""


def _defaults(kind: DeviceKind) -> KindSettings[Any, Any]:
    if kind.emulation is None:
        pytest.skip(f"kind {kind.name} has no emulation")
    return default_settings(kind)


def declared(capability: object, words: str) -> None:
    """Skip the test for a capability that is not declared; `words` name the field."""
    if not capability:
        pytest.skip(f"not declared: {words}")
