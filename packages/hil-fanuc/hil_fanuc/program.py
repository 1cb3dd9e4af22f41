"""TP program of the emulated controller that streams, and the state that decides whether it is ready for commands."""

import math

from hil_fanuc.alarms import BRAKE_CONTROL, EMERGENCY, EMERGENCY_RMI, Alarms
from hil_fanuc.profile import FanucProfile
from hil_fanuc.rmi import ProgramStatus


class Program:
    """Program, alarms and operator's controls of one controller."""

    def __init__(self, profile: FanucProfile, alarms: Alarms) -> None:
        self._profile, self.alarms = profile, alarms
        self.power_up()

    def power_up(self) -> None:
        """Power up: no program was called, and no stream was started."""
        self.status = ProgramStatus.CANCELLED
        self._was_called = False
        """Whether the program was called since power-up; nothing but a power cycle ends it."""
        self._ready_at = math.inf
        """Time from which the program is ready, s."""
        self.streams_since = math.inf
        """Time of the start packet, s; infinite without one."""
        self.ended_by_client = False
        """Whether the client itself has ended its session or the program."""
        self._is_paused = False
        self.starved = False
        """Whether the program has stopped because set points were missing."""
        self._was_up = False
        """Whether the program took set points before the alarm."""
        self.stopped_at: float | None = None
        """Time at which the emergency stop was pressed, s; None if it is released."""
        self.pendant_on = False
        self.hangs = False
        """Whether the server of Stream Motion hangs until the power is cycled."""

    def call(self, now: float) -> bool:
        """Call the program; return whether it runs. A further call makes it not ready for a while."""
        if self.alarms or self.pendant_on or self.hangs or self.stopped_at is not None:
            return False
        self._ready_at = now + (self._profile.recall_ms / 1e3 if self._was_called else 0.0)
        self._was_called, self.starved, self.ended_by_client = True, False, False
        self.status = ProgramStatus.RUNNING
        if self._profile.brake_control:
            self.alarms.raise_(BRAKE_CONTROL, now)
        return True

    def start_stream(self, now: float) -> None:
        """Handle a start packet."""
        self.streams_since, self.starved, self.ended_by_client = now, False, False

    def abort(self) -> None:
        """Abort or hold the program: reports continue, and the program counts as held (observed)."""
        self._is_paused = False
        if self.status != ProgramStatus.CANCELLED:
            self.status = ProgramStatus.HELD

    def pause(self) -> None:
        """Hold the program until it is resumed."""
        runs = self.status == ProgramStatus.RUNNING
        self.abort()
        self._is_paused = runs

    def resume(self) -> bool:
        """Let a paused program run; return whether it is held."""
        if self._is_paused and self.servo_on and not self.pendant_on:
            self.status, self._is_paused, self.ended_by_client = ProgramStatus.RUNNING, False, False
            return True
        return self.status == ProgramStatus.HELD

    def finish(self) -> None:
        """End the program behind its last set point."""
        self.status, self.ended_by_client = ProgramStatus.CANCELLED, True

    def hold_by_alarm(self, now: float) -> None:
        """Hold the program because of an alarm. An emergency stop is reported in stages."""
        self._was_up = self.is_up(now)
        self.abort()

    def press_stop(self, now: float) -> None:
        """Press the emergency stop. No effect if it is pressed."""
        if self.stopped_at is None:
            self.alarms.raise_(EMERGENCY, now)
            self.alarms.raise_(EMERGENCY_RMI, now)
            self.stopped_at = now

    def release_stop(self) -> None:
        """Release the emergency stop. Its alarms remain until a reset."""
        self.stopped_at = None

    @property
    def servo_on(self) -> bool:
        """Whether the drives are powered."""
        return self.stopped_at is None and not self.alarms

    @property
    def may_move(self) -> bool:
        """Whether the drives may follow set points."""
        return self.servo_on and not self.pendant_on and self.status == ProgramStatus.RUNNING

    def is_ready(self, now: float) -> bool:
        """Return whether the controller reports that it is ready for commands."""
        if self.alarms:
            stopped = EMERGENCY in self.alarms.active
            return (
                stopped and self._was_up and now < self.alarms.raised_at + self._profile.stop_ready_ms / 1e3
            )
        return self.is_up(now)

    def is_up(self, now: float) -> bool:
        """Return whether the program runs and takes set points."""
        if self.status != ProgramStatus.RUNNING or self.pendant_on or self.starved:
            return False
        since = self.streams_since + self._profile.ready_after_ms / 1e3
        return now >= max(self._ready_at, since) - 1e-9

    def reports_stop(self, now: float) -> bool:
        """Return whether the controller reports the emergency stop as such."""
        return self.stopped_at is not None and now >= self.stopped_at + self._profile.stop_bit_ms / 1e3 - 1e-9

    def hindrance(self, now: float) -> str:
        """Return why the arm does not follow set points; empty if it does."""
        if self.hangs:
            return "its server of Stream Motion hangs"
        if self.alarms:
            return self.alarms.active[0]
        if self.pendant_on:
            return "its teach pendant is on"
        if self.streams_since == math.inf:
            return "no stream was started"
        if self.status != ProgramStatus.RUNNING:
            return "its TP program does not run"
        if self.starved:
            return "set points were missing"
        return "" if self.is_ready(now) else "it is not ready yet"
