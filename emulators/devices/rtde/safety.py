"""Power, safety mode and control of an emulated controller, with the events that change them and permit the arm to
move.
"""

import math
from collections.abc import Mapping
from enum import StrEnum

from emulators.devices.rtde.profile import RtdeProfile
from emulators.devices.rtde.timers import Timers
from emulators.orders import Hindrance
from protocol.devices.rtde.states import STOPPED_MODES, RobotMode, SafetyMode

BY_FAULT = "as a fault"
"""Reason of a protective stop that a fault has caused, not a client."""


class Stimulus(StrEnum):
    """Events that change the safety mode. Each has an effect in certain modes only."""

    PROTECTIVE_STOP = "protective stop"
    UNLOCK = "protective stop unlocked"
    SAFEGUARD_OPEN = "safeguard opened"
    SAFEGUARD_CLOSED = "safeguard closed"
    EMERGENCY_RELEASE = "all emergency stops released"
    RESTART = "safety restarted"


_NOT_STOPPED = tuple(mode for mode in SafetyMode if mode not in STOPPED_MODES)
_EMERGENCIES = SafetyMode.ROBOT_EMERGENCY_STOP, SafetyMode.SYSTEM_EMERGENCY_STOP

CHANGES: Mapping[Stimulus, tuple[tuple[SafetyMode, ...], SafetyMode]] = {
    Stimulus.PROTECTIVE_STOP: (_NOT_STOPPED, SafetyMode.PROTECTIVE_STOP),
    Stimulus.UNLOCK: ((SafetyMode.PROTECTIVE_STOP,), SafetyMode.NORMAL),
    Stimulus.SAFEGUARD_OPEN: (_NOT_STOPPED, SafetyMode.SAFEGUARD_STOP),
    Stimulus.SAFEGUARD_CLOSED: ((SafetyMode.SAFEGUARD_STOP,), SafetyMode.NORMAL),
    Stimulus.EMERGENCY_RELEASE: (_EMERGENCIES, SafetyMode.NORMAL),
    Stimulus.RESTART: ((SafetyMode.VIOLATION, SafetyMode.FAULT), SafetyMode.NORMAL),
}
"""Safety modes in which an event has an effect, and the resulting mode. An emergency stop applies in every mode."""


class RobotState:
    """State of a robot that is powered up and ready: power, safety mode and control."""

    def __init__(self, profile: RtdeProfile, timers: Timers) -> None:
        self._power_s, self._unlock_s, self._timers = profile.power_s, profile.unlock_s, timers
        self.mode, self.safety = RobotMode.RUNNING, SafetyMode.NORMAL
        self.remote = profile.remote_control
        self.stop_reason = ""
        """Reason of the last protective stop."""
        self._stopped_at = -math.inf
        """Time of the last protective stop, s."""
        self._emergency_stops: set[str] = set()
        """Names of all who have pressed the emergency stop and not released it."""
        self._power_losses = 0

    @property
    def may_move(self) -> bool:
        """Whether the arm has power and no stop holds it."""
        return self.safety not in STOPPED_MODES and self.mode == RobotMode.RUNNING

    @property
    def takes_programs(self) -> bool:
        """Whether the script port accepts programs."""
        return self.remote and self.may_move

    def hindrance(self, now: float) -> Hindrance | None:
        """Reason why the arm may not move; empty if it may move."""
        if self.safety in STOPPED_MODES:
            protective = self.safety == SafetyMode.PROTECTIVE_STOP
            name = self.safety.name.lower().replace("_", " ")
            text = f"{name}: {self.stop_reason}" if protective else name
            return Hindrance(text, protective and self.stop_reason != BY_FAULT)
        if self.mode != RobotMode.RUNNING:
            return Hindrance(f"robot mode {self.mode.name}", False)
        return None

    # --- safety

    def apply(self, stimulus: Stimulus) -> bool:
        """Change the safety mode. Return False if the event has no effect in the current mode."""
        modes, following = CHANGES[stimulus]
        if self.safety not in modes:
            return False
        self.safety = following
        return True

    def begin_protective_stop(self, reason: str, now: float) -> bool:
        """Begin a protective stop. Return False, without effect, during any other stop."""
        if not self.apply(Stimulus.PROTECTIVE_STOP):
            return False
        self.stop_reason, self._stopped_at = reason, now
        return True

    def unlock(self, now: float) -> bool:
        """Unlock a protective stop. Return False if there is none, or if it is too early."""
        early = now - self._stopped_at < self._unlock_s - 1e-9
        return not early and self.apply(Stimulus.UNLOCK)

    def press_emergency_stop(self, mode: SafetyMode, by: str) -> None:
        """Press the emergency stop. It lasts until everyone who pressed it has released it."""
        self._emergency_stops.add(by)
        self.safety = mode

    def release_emergency_stop(self, by: str = "a fault") -> None:
        """Release the emergency stop. Power and brakes do not change."""
        self._emergency_stops.discard(by)
        if not self._emergency_stops:
            self.apply(Stimulus.EMERGENCY_RELEASE)

    # --- power

    def power_off(self) -> None:
        """Switch the power off at once."""
        self._power_losses += 1
        self.mode = RobotMode.POWER_OFF

    def power_on(self, now: float) -> bool:
        """Begin to switch the power on, which takes some time. Return False if the power is already on, or the
        robot is stopped.
        """
        if self.mode != RobotMode.POWER_OFF or self.safety in STOPPED_MODES:
            return False
        self._enter_later(RobotMode.IDLE, now + self._power_s)
        return True

    def release_brakes(self, now: float) -> bool:
        """Begin to release the brakes, after powering up. Return False if the arm is neither idle nor off."""
        off = self.mode == RobotMode.POWER_OFF
        if (off and not self.power_on(now)) or not (off or self.mode == RobotMode.IDLE):
            return False
        self._enter_later(RobotMode.RUNNING, now + (2.0 if off else 1.0) * self._power_s)
        return True

    def _enter_later(self, mode: RobotMode, at: float) -> None:
        """Enter a mode at a time, s, unless the power is switched off before that time."""
        losses = self._power_losses

        def enter() -> None:
            if self._power_losses == losses:
                self.mode = mode

        self._timers.add(at, enter)
