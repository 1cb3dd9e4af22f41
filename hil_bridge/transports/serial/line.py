"""Serial line. Bytes take the time of a UART, and arrive as the UART of the other end reads them."""

from collections.abc import Callable
from dataclasses import dataclass

from hil_bridge.clock import Clock
from hil_bridge.errors import TransportBroken, TransportClosed, TransportError
from hil_bridge.errors.event_kinds import EventKind
from hil_bridge.transports.around import Around
from hil_bridge.transports.base import Transport
from hil_bridge.transports.delivery import QUEUE_BYTES, flush
from hil_bridge.transports.serial.direction import ReceivingEnd, SerialDirection
from hil_bridge.transports.serial.uart import COUNTED_AS, Damaged, Flaw, LineErrors, LineSettings
from hil_bridge.transports.wrappers import Direction

FIFO = 14
"""Number of characters after which a UART delivers received characters. Assumed: the highest receive trigger level
of a 16550A, which drivers choose.
"""

NOTICE_S = 1.0
"""Shortest time between two notices of damaged characters, s. Chosen: a wrong baud rate damages every character."""


def _no_matter(flaw: Flaw) -> None:
    """Do nothing."""


@dataclass(frozen=True, slots=True)
class Uart:
    """End of a serial line: how it sends and receives, and how its owner treats damaged characters."""

    settings: Callable[[], LineSettings]
    """Returns the present settings of this end."""
    damaged: Damaged = Damaged.KEEP
    """Treatment of damaged characters by the owner of this end."""
    on_flaw: Callable[[Flaw], None] = _no_matter
    """Called with each damaged character that this end receives."""


class LineNotices:
    """Reporter of damaged characters. The first one is reported at once; after that, at most one notice per
    `NOTICE_S`.
    """

    def __init__(
        self, name: str, line: LineSettings, clock: Clock, on_notice: Callable[[str, str], None]
    ) -> None:
        self._name = name
        self._line = line
        self._clock = clock
        self._on_notice = on_notice
        self._errors = LineErrors()
        self._next = float("-inf")

    def __call__(self, flaw: Flaw) -> None:
        self._errors += COUNTED_AS[flaw]
        now = self._clock.now()
        if now >= self._next:
            self._next = now + NOTICE_S
            self._on_notice(
                EventKind.LINE_ERROR,
                f"{self._name}: {self._errors} on a line set to {self._line}; check baudrate and parity",
            )


class PacedLine(Around[bytes]):
    """Byte wire at the pace of a serial line in both directions, with a UART at each end.

    A byte passes when its last bit would have passed on a real line. A sent byte then goes to the wrapped
    transport, a received byte to the client. Bytes are delivered in chunks: after `fifo` characters, or at the end
    of a burst. A real UART waits four character times to detect the end of a burst; this wait is not modelled.
    Bursts are queued, and all times of uninterrupted traffic are counted from its first start bit.

    Each end sends and receives with its own settings. If the settings differ, an end receives the characters that a
    UART would read from such a line. Neither end detects that the other end is gone or has different settings,
    because a serial line does not report this.
    """

    __slots__ = ("_clock", "_end_cause", "_in", "_out", "overruns")

    def __init__(
        self,
        transport: Transport[bytes],
        line: LineSettings | Uart,
        clock: Clock,
        fifo: int = FIFO,
        far: Uart | None = None,
    ) -> None:
        """Wrap a transport. `line` is the UART of this end, which holds the transport. `far` is the UART of the end
        behind the wrapped transport; by default it has the same settings.
        """
        near = line if isinstance(line, Uart) else Uart(lambda: line)
        far = far or Uart(near.settings)
        super().__init__(transport)
        self._clock = clock
        here = ReceivingEnd(near.settings, near.damaged, self._pass_in, near.on_flaw)
        there = ReceivingEnd(far.settings, far.damaged, self._pass_out, far.on_flaw)
        self._in = SerialDirection(clock, fifo, far.settings, here)
        self._out = SerialDirection(clock, fifo, near.settings, there)
        self._end_cause: TransportError | None = None
        self.overruns = 0
        """Number of received bytes that were lost because they exceeded the capacity of the line."""

    @property
    def line_errors(self) -> LineErrors:
        """Counts of damaged characters that this end has received."""
        return self._in.errors

    @property
    def far_line_errors(self) -> LineErrors:
        """Counts of damaged characters that the other end has received."""
        return self._out.errors

    def send(self, data: bytes) -> None:
        self._delivery.check()
        if self._end_cause is not None:
            raise type(self._end_cause)(*self._end_cause.args) from self._end_cause
        if not self._out.push(data):
            raise TransportError(f"{self.name}: the queue of {QUEUE_BYTES} bytes is full; the line is slower")

    def send_break(self, duration_s: float, direction: Direction = Direction.SENT) -> None:
        """Hold one direction of the line low for a time, s, beginning now.

        Characters in transit are damaged or lost, because the UART continues to send them (PC16550D, line control
        register bit 6).
        """
        line = self._way(direction)
        line.hold(True)
        line.hold(False, duration_s)

    def hold(self, low: bool, direction: Direction = Direction.SENT) -> None:
        """Begin or end a break. `send_break` does both."""
        self._way(direction).hold(low)

    async def aclose(self) -> None:
        if not self._delivery.begin_close():
            return
        try:
            await flush(self._out.drained())
        finally:
            self._out.clear()
            await self._inner.aclose()
            self._in.clear()
            self._delivery.closed()

    def _way(self, direction: Direction) -> SerialDirection:
        return self._out if direction is Direction.SENT else self._in

    def _arrived(self, data: bytes) -> None:
        if not self._in.push(data):
            self.overruns += len(data)

    def _pass_in(self, data: bytes) -> None:
        if data:
            self._delivery.data(data)
        if self._end_cause is not None and not self._in.waiting:
            self._delivery.end(self._end_cause)

    def _pass_out(self, data: bytes) -> None:
        if self._end_cause is not None or not data:
            return
        try:
            self._inner.send(data)
        except TransportError as error:
            self._inner_ended(TransportBroken(f"{self.name}: {error}"))

    def _inner_ended(self, error: TransportError) -> None:
        if self._end_cause is not None:
            return
        self._end_cause = error
        # bytes that arrived before the end are still on the line
        if not self._in.waiting or isinstance(error, TransportClosed):
            self._in.clear()
            self._delivery.end(error)
