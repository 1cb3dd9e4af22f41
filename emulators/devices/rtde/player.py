"""Player of an emulated controller's programs: start, pauses, watchdogs and end."""

from collections import Counter
from collections.abc import Callable, Mapping

from emulators.devices.rtde.compliance import Compliance
from emulators.devices.rtde.running import Console, Program, ProgramMessage, Watchdog
from emulators.devices.rtde.uploads import Uploads
from emulators.devices.rtde.urscript import Message
from protocol.devices.rtde.states import Runtime


class Player:
    """Executes one program at a time."""

    def __init__(
        self, start_delay: float, console: Console, compliance: Compliance, counts: Counter[str]
    ) -> None:
        """Start without a program. `start_delay`, s, precedes each program. The end of a program resets
        `compliance`.
        """
        self._start_delay, self._console, self._compliance = start_delay, console, compliance
        self._counts = counts
        self.stored: Mapping[str, bytes] = {}
        """Stored programs by name, as URScript text."""
        self.loaded = ""
        """Name of the loaded stored program; empty if none is loaded."""
        self.uploads = Uploads()
        self.runtime = Runtime.STOPPED
        self.program: Program | None = None
        self._starting: tuple[float, Callable[[], Program]] | None = None
        self._watchdogs: list[Watchdog] = []

    def start(self, make: Callable[[], Program], now: float) -> None:
        """Start a complete program. A running program is stopped first."""
        self._end(now)
        self._starting = now + self._start_delay, make

    def begin_due(self, now: float) -> bool:
        """Begin the pending program if it is due. Return whether a program began."""
        if self._starting is None or self._starting[0] > now:
            return False
        _, make = self._starting
        self._starting = None
        self.program, self.runtime = make(), Runtime.PLAYING
        self._console.tell(ProgramMessage(now, Message.STARTED, self.program.name))
        return True

    def cycle(self, now: float) -> None:
        """Execute the running program for one cycle."""
        if self.runtime == Runtime.PLAYING and self.program is not None and not self.program.cycle():
            self._end(now)

    def stop(self, now: float) -> None:
        """Stop a running, paused or pending program; the arm brakes."""
        self.uploads.stops += 1
        self._end(now)

    def _end(self, now: float) -> None:
        if self.program is not None:
            self.program.close()
            self._console.tell(ProgramMessage(now, Message.STOPPED, self.program.name))
        self.program = self._starting = None
        self._watchdogs = []
        self._compliance.reset()
        self.runtime = Runtime.STOPPED

    def pause(self) -> bool:
        """Pause the running program; the arm brakes. Return False if no program is running."""
        if self.runtime != Runtime.PLAYING:
            return False
        self.runtime = Runtime.PAUSED
        return True

    def resume(self, now: float) -> bool:
        """Resume the paused program. Return False if no program is paused."""
        if self.runtime != Runtime.PAUSED:
            return False
        self.runtime = Runtime.PLAYING
        for watchdog in self._watchdogs:
            watchdog.last = now
        return True

    # --- watchdogs

    def watch_input(self, name: str, frequency_hz: float, action: str, now: float) -> None:
        """Start a watchdog that a program requests. Its time starts now."""
        if frequency_hz > 0.0:
            self._watchdogs.append(Watchdog(name, 1.0 / frequency_hz, action, now))

    def feed_watchdogs(self, names: tuple[str, ...], now: float) -> None:
        """Feed the watchdogs of inputs with these names."""
        for watchdog in self._watchdogs:
            if watchdog.name in names:
                watchdog.last = now

    def delay_watchdogs(self, time: float) -> None:
        """Exclude a time, s, during which inputs could not be read, from the time of all watchdogs."""
        for watchdog in self._watchdogs:
            watchdog.last += time

    def check_watchdogs(self, now: float) -> None:
        """Stop or pause a program whose input is overdue."""
        for watchdog in self._watchdogs:
            if watchdog.is_overdue(now):
                self._counts[f"watchdog {watchdog.action}"] += 1
                self._end(now) if watchdog.action == "stop" else self.pause()
                return
