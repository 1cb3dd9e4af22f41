"""Program's end of a connection that it opened to a server, as an endpoint of bytes.

The controller's server connects it to a wire, and reports when the other server has accepted the connection.
"""

from collections.abc import Callable

from emulators.devices.rtde.controller import Controller

UNREAD_MAX = 1 << 20
"""Maximum number of received bytes that the program has not read. With more, the connection is closed. Chosen:
twelve thousand points of a trajectory fit.
"""
ENOUGH = 1 << 16
"""Number of unread bytes from which no more bytes are read from the wire, so that the server's sending blocks.
Chosen.
"""


class ProgramSocket:
    """Socket of a program: a `urscript.Socket`, and an endpoint without events."""

    def __init__(self, controller: Controller) -> None:
        self._controller = controller
        self._come, self._to_send = bytearray(), bytearray()
        self.opening = True
        self.closing = False
        """Whether the program or the controller is about to close the connection."""
        self._ended = False
        self.wake: Callable[[], object] = _nothing
        """Function to call when there is data to send, or when the connection ends."""
        self.hold: Callable[[bool], object] = _ignore_hold
        """Function to call to pause or resume reading from the wire."""
        self._held = False

    # --- for the program

    @property
    def open(self) -> bool:
        """Whether the server is connected and the program has not closed the connection."""
        return not (self.opening or self.closing or self._ended)

    def take(self, count: int) -> bytes | None:
        """Return this many received bytes; None if fewer bytes have been received."""
        if len(self._come) < count:
            return None
        data = bytes(self._come[:count])
        del self._come[:count]
        self._limit_unread()
        return data

    def take_until(self, end: bytes) -> bytes | None:
        """Return the received bytes up to and including a terminator; None if it has not been received.

        With an empty terminator, return everything received.
        """
        at = self._come.find(end) + len(end) if end in self._come else 0
        return self.take(at or (0 if end else len(self._come)) or len(self._come) + 1)

    def send(self, data: bytes) -> bool:
        """Send bytes. Return False if the other end has closed the connection."""
        if not self.open or len(self._to_send) + len(data) > UNREAD_MAX:
            return False
        self._to_send += data
        self.wake()
        return True

    def hang_up(self) -> None:
        """Close the connection after all pending data has been sent."""
        if not self.closing:
            self.closing = True
            self._come.clear()
            self._limit_unread()
            self.wake()

    # --- for the wire

    def opened(self) -> None:
        """Record that the server has accepted the connection."""
        self.opening = False

    def close(self, now: float) -> None:
        """End the connection, or stop trying to connect. Received data can still be read."""
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
        self._limit_unread()
        self._controller.motions.news += 1

    def _limit_unread(self) -> None:
        """Stop reading from a server that sends more than the program reads, as TCP does."""
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
        """Return the time of the next cycle, s. A program that communicates with a server runs even without an RTDE
        client.
        """
        path = self._controller.path
        return path.cycle_at(path.cycle + 1)

    def handle_deadline(self, now: float) -> None:
        self._controller.advance(now)


def _nothing() -> None:
    """Do nothing: there is no wire."""


def _ignore_hold(hold: bool) -> None:
    """Do nothing: there is no wire, or the wire cannot be paused."""
