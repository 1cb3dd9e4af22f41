"""The program of an emulated controller: its start, its pauses, its watchdogs and its end."""

from collections import Counter
from collections.abc import Callable, Mapping

from emulators.devices.rtde.compliance import Compliance
from emulators.devices.rtde.running import Console, Program, Saying, Watchdog
from emulators.devices.rtde.uploads import Uploads
from emulators.devices.rtde.urscript import Message
from protocol.devices.rtde.states import Runtime


class Player:
    """Plays one program at a time."""

    def __init__(
        self, start_delay: float, console: Console, compliance: Compliance, counts: Counter[str]
    ) -> None:
        """`start_delay`, s, passes before a program begins; its end resets `compliance`."""
        self._start_delay, self._console, self._compliance = start_delay, console, compliance
        self._counts = counts
        self.stored: Mapping[str, bytes] = {}
        """Stored programs by name: text in URScript."""
        self.loaded = ""
        """Name of the stored program that is loaded; empty for none."""
        self.uploads = Uploads()
        self.runtime = Runtime.STOPPED
        self.program: Program | None = None
        self._starting: tuple[float, Callable[[], Program]] | None = None
        self._watchdogs: list[Watchdog] = []

    def start(self, make: Callable[[], Program], now: float) -> None:
        """Start a complete program; a running one is stopped first."""
        self._end(now)
        self._starting = now + self._start_delay, make

    def begin_due(self, now: float) -> bool:
        """Begin the program that is due; whether there is one."""
        if self._starting is None or self._starting[0] > now:
            return False
        _, make = self._starting
        self._starting = None
        self.program, self.runtime = make(), Runtime.PLAYING
        self._console.tell(Saying(now, Message.STARTED, self.program.name))
        return True

    def cycle(self, now: float) -> None:
        """Let the program act for one cycle, if it plays."""
        if self.runtime == Runtime.PLAYING and self.program is not None and not self.program.cycle():
            self._end(now)

    def stop(self, now: float) -> None:
        """Stop what plays, is paused, or has come and does not play yet; the arm brakes."""
        self.uploads.stops += 1
        self._end(now)

    def _end(self, now: float) -> None:
        if self.program is not None:
            self.program.close()
            self._console.tell(Saying(now, Message.STOPPED, self.program.name))
        self.program = self._starting = None
        self._watchdogs = []
        self._compliance.reset()
        self.runtime = Runtime.STOPPED

    def pause(self) -> bool:
        """Pause what plays; the arm brakes. False where nothing plays."""
        if self.runtime != Runtime.PLAYING:
            return False
        self.runtime = Runtime.PAUSED
        return True

    def resume(self, now: float) -> bool:
        """Resume what is paused. False where nothing is."""
        if self.runtime != Runtime.PAUSED:
            return False
        self.runtime = Runtime.PLAYING
        for watchdog in self._watchdogs:
            watchdog.last = now
        return True

    # --- watchdogs

    def watch_input(self, name: str, frequency_hz: float, action: str, now: float) -> None:
        """Start a watchdog that a program requests. Counting begins now."""
        if frequency_hz > 0.0:
            self._watchdogs.append(Watchdog(name, 1.0 / frequency_hz, action, now))

    def feed_watchdogs(self, names: tuple[str, ...], now: float) -> None:
        """Feed the watchdogs of inputs with these names."""
        for watchdog in self._watchdogs:
            if watchdog.name in names:
                watchdog.last = now

    def delay_watchdogs(self, time: float) -> None:
        """Leave out a time, s, in which no input could be read."""
        for watchdog in self._watchdogs:
            watchdog.last += time

    def check_watchdogs(self, now: float) -> None:
        """Stop or pause a program whose input is overdue."""
        for watchdog in self._watchdogs:
            if watchdog.is_overdue(now):
                self._counts[f"watchdog {watchdog.action}"] += 1
                self._end(now) if watchdog.action == "stop" else self.pause()
                return
