"""A connection that a program has opened to a server: the program's end of it, as an endpoint of bytes.

The one that serves the controller brings it together with a wire, and tells when the server has taken it.
"""

from collections.abc import Callable

from emulators.devices.rtde.controller import Controller

UNREAD_MAX = 1 << 20
"""Chosen: bytes that have come and that the program has not read; with more of them the connection is closed. Twelve
thousand points of a trajectory fit in.
"""
ENOUGH = 1 << 16
"""Chosen: with so many unread bytes no more are taken from the wire, so that the server's sending waits."""


class ProgramSocket:
    """A `urscript.Socket`, and an endpoint that tells no events."""

    def __init__(self, controller: Controller) -> None:
        self._controller = controller
        self._come, self._to_send = bytearray(), bytearray()
        self.opening = True
        self.closing = False
        """The program, or the controller, is about to close it."""
        self._ended = False
        self.wake: Callable[[], object] = _nothing
        """To be called when there is something to send, or the connection is to be closed."""
        self.hold: Callable[[bool], object] = _never_held
        """To be called when the wire is to bring no more for now, or again."""
        self._held = False

    # --- for the program

    @property
    def open(self) -> bool:
        """Whether the server is there, and the program has not closed it."""
        return not (self.opening or self.closing or self._ended)

    def take(self, count: int) -> bytes | None:
        """So many bytes that have come; None while there are fewer."""
        if len(self._come) < count:
            return None
        found = bytes(self._come[:count])
        del self._come[:count]
        self._hold_back()
        return found

    def take_until(self, end: bytes) -> bytes | None:
        """Bytes up to an end, that included; all that is there for an empty end. None while it has not come."""
        at = self._come.find(end) + len(end) if end in self._come else 0
        return self.take(at or (0 if end else len(self._come)) or len(self._come) + 1)

    def send(self, data: bytes) -> bool:
        """Send; False where the other end has gone."""
        if not self.open or len(self._to_send) + len(data) > UNREAD_MAX:
            return False
        self._to_send += data
        self.wake()
        return True

    def hang_up(self) -> None:
        """Close it; what stands to be sent is sent before."""
        if not self.closing:
            self.closing = True
            self._come.clear()
            self._hold_back()
            self.wake()

    # --- for the wire

    def opened(self) -> None:
        """Note that the server has accepted the connection."""
        self.opening = False

    def close(self, now: float) -> None:
        """End the connection, or give it up. What has arrived can still be read."""
        self.opening, self._ended = False, True

    def receive(self, data: bytes, now: float) -> None:
        self._controller.advance(now)
        if self.closing:
            return
        if len(self._come) + len(data) > UNREAD_MAX:
            self._controller.counts["sockets of programs closed, too much unread"] += 1
            self.hang_up()
            return
        self._come += data
        self._hold_back()
        self._controller.motions.news += 1

    def _hold_back(self) -> None:
        """Hold back a server that sends more than is read, as TCP does."""
        if self._held != (len(self._come) >= ENOUGH):
            self._held = not self._held
            self.hold(self._held)

    def next_event(self) -> None:
        return None

    def data_to_send(self, now: float) -> bytes:
        data = bytes(self._to_send)
        self._to_send.clear()
        return data

    def next_deadline(self) -> float | None:
        """Return the next cycle: a program that talks to a server runs also without an RTDE client."""
        path = self._controller.path
        return path.cycle_at(path.cycle + 1)

    def handle_deadline(self, now: float) -> None:
        self._controller.advance(now)


def _nothing() -> None:
    """Before there is a wire."""


def _never_held(hold: bool) -> None:
    """Before there is a wire, or by one that cannot be held."""
