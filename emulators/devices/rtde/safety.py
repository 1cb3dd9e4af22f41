"""Power, safety mode and control of an emulated controller: which events change them, and whether the arm may move."""

import math
from collections.abc import Mapping
from enum import StrEnum

from emulators.devices.rtde.profile import RtdeProfile
from emulators.devices.rtde.timers import Timers
from emulators.orders import Hindrance
from protocol.devices.rtde.states import STOPPED_MODES, RobotMode, SafetyMode

BY_FAULT = "as a fault"
"""Reason of a protective stop that no client has caused."""


class Stimulus(StrEnum):
    """Events that change the safety mode from some modes alone."""

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
"""Safety modes in which an event has an effect, and the mode that follows. An emergency stop comes in every mode."""


class RobotState:
    """Power, safety mode and control of a robot, powered up and ready."""

    def __init__(self, profile: RtdeProfile, timers: Timers) -> None:
        self._power_s, self._unlock_s, self._timers = profile.power_s, profile.unlock_s, timers
        self.mode, self.safety = RobotMode.RUNNING, SafetyMode.NORMAL
        self.remote = profile.remote_control
        self.stop_reason = ""
        """Reason of the last protective stop."""
        self._stopped_at = -math.inf
        """Time of the last protective stop, s."""
        self._emergency_stops: set[str] = set()
        """All that have pressed the emergency stop."""
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
        """Why the arm may not move."""
        if self.safety in STOPPED_MODES:
            protective = self.safety == SafetyMode.PROTECTIVE_STOP
            name = self.safety.name.lower().replace("_", " ")
            words = f"{name}: {self.stop_reason}" if protective else name
            return Hindrance(words, protective and self.stop_reason != BY_FAULT)
        if self.mode != RobotMode.RUNNING:
            return Hindrance(f"robot mode {self.mode.name}", False)
        return None

    # --- safety

    def apply(self, stimulus: Stimulus) -> bool:
        """Change the safety mode; False where the event has no effect in this mode."""
        modes, following = CHANGES[stimulus]
        if self.safety not in modes:
            return False
        self.safety = following
        return True

    def begin_protective_stop(self, reason: str, now: float) -> bool:
        """Begin a protective stop. Return False, without effect, in any other stop."""
        if not self.apply(Stimulus.PROTECTIVE_STOP):
            return False
        self.stop_reason, self._stopped_at = reason, now
        return True

    def unlock(self, now: float) -> bool:
        """Unlock a protective stop. False where it is too early, or there is none."""
        early = now - self._stopped_at < self._unlock_s - 1e-9
        return not early and self.apply(Stimulus.UNLOCK)

    def press_emergency_stop(self, mode: SafetyMode, by: str) -> None:
        """Press the emergency stop. It holds until everyone who pressed it has released it."""
        self._emergency_stops.add(by)
        self.safety = mode

    def release_emergency_stop(self, by: str = "a fault") -> None:
        """Release the emergency stop; power and brakes stay as they are."""
        self._emergency_stops.discard(by)
        if not self._emergency_stops:
            self.apply(Stimulus.EMERGENCY_RELEASE)

    # --- power

    def power_off(self) -> None:
        """Power goes at once."""
        self._power_losses += 1
        self.mode = RobotMode.POWER_OFF

    def power_on(self, now: float) -> bool:
        """Begin to switch the power on, which takes a while. Return False if it is on, or stopped."""
        if self.mode != RobotMode.POWER_OFF or self.safety in STOPPED_MODES:
            return False
        self._enter_later(RobotMode.IDLE, now + self._power_s)
        return True

    def release_brakes(self, now: float) -> bool:
        """Begin to release the brakes, powering up first. Return False if the arm is neither idle nor off."""
        off = self.mode == RobotMode.POWER_OFF
        if (off and not self.power_on(now)) or not (off or self.mode == RobotMode.IDLE):
            return False
        self._enter_later(RobotMode.RUNNING, now + (2.0 if off else 1.0) * self._power_s)
        return True

    def _enter_later(self, mode: RobotMode, at: float) -> None:
        """Come to a mode at a time, s, unless the power goes before."""
        losses = self._power_losses

        def enter() -> None:
            if self._power_losses == losses:
                self.mode = mode

        self._timers.add(at, enter)
