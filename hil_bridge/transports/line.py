"""A serial line's pace: bytes take the time that a UART gives them."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

from hil_bridge.clock import Clock, Timer
from hil_bridge.errors import TransportBroken, TransportClosed, TransportError
from hil_bridge.transports.base import Transport
from hil_bridge.transports.delivery import QUEUE_BYTES, Delivery, flush


class Parity(StrEnum):
    """The bit after the data bits."""

    NONE = "N"
    EVEN = "E"
    ODD = "O"


@dataclass(frozen=True, slots=True)
class LineSettings:
    """How characters lie on a serial line: 8 data bits after a start bit."""

    baudrate: int = 9600
    parity: Parity = Parity.NONE
    stopbits: int = 1

    @property
    def bits(self) -> int:
        """Bit times that one character takes."""
        return 1 + 8 + (self.parity is not Parity.NONE) + self.stopbits


FIFO = 14
"""Characters after which a UART hands over what it received.

Assumed: the highest receive trigger level of a 16550A, which is what drivers choose.
"""


class Paced:
    """A byte wire at the pace of a serial line, in both directions.

    A byte passes when its last bit would have: out to the wrapped transport, in as if it had come over the
    line. Bytes are handed on in chunks: after `fifo` characters or at the end of a burst (a real UART waits
    four character times to see that end; that wait is not modelled). Bursts queue after one another, and all
    times of unbroken traffic are counted from its first start bit.
    """

    __slots__ = ("_clock", "_delivery", "_end_cause", "_in", "_inner", "_out", "overruns")

    def __init__(
        self, transport: Transport[bytes], line: LineSettings, clock: Clock, fifo: int = FIFO
    ) -> None:
        self._inner = transport
        self._clock = clock
        self._delivery: Delivery[bytes] = Delivery(transport.name, QUEUE_BYTES)
        self._in = _Lane(line, clock, fifo, self._pass_in)
        self._out = _Lane(line, clock, fifo, self._pass_out)
        self._end_cause: TransportError | None = None
        self.overruns = 0
        """Received bytes that were lost because more came than the line could carry."""

    @property
    def name(self) -> str:
        return self._inner.name

    def start(self, on_data: Callable[[bytes], None], on_end: Callable[[TransportError], None]) -> None:
        self._delivery.start(on_data, on_end)
        self._inner.start(self._arrived, self._inner_ended)

    def send(self, data: bytes) -> None:
        self._delivery.check()
        if self._end_cause is not None:
            raise type(self._end_cause)(*self._end_cause.args) from self._end_cause
        if not self._out.push(data):
            raise TransportError(f"{self.name}: the queue of {QUEUE_BYTES} bytes is full; the line is slower")

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

    def _arrived(self, data: bytes) -> None:
        if not self._in.push(data):
            self.overruns += len(data)

    def _pass_in(self, data: bytes) -> None:
        self._delivery.data(data)
        if self._end_cause is not None and not self._in.waiting:
            self._delivery.end(self._end_cause)

    def _pass_out(self, data: bytes) -> None:
        if self._end_cause is not None:
            return
        try:
            self._inner.send(data)
        except TransportError as error:
            self._inner_ended(TransportBroken(f"{self.name}: {error}"))

    def _inner_ended(self, error: TransportError) -> None:
        if self._end_cause is not None:
            return
        self._end_cause = error
        # what arrived before the end is still on its way
        if not self._in.waiting or isinstance(error, TransportClosed):
            self._in.clear()
            self._delivery.end(error)


class _Lane:
    """One direction of a line."""

    __slots__ = (
        "_baudrate",
        "_begun",
        "_bits",
        "_clock",
        "_fifo",
        "_next",
        "_passed",
        "_sink",
        "_timer",
        "waiting",
    )

    def __init__(self, line: LineSettings, clock: Clock, fifo: int, sink: Callable[[bytes], None]) -> None:
        self._clock = clock
        self._bits, self._baudrate = line.bits, line.baudrate
        self._fifo = fifo
        self._sink = sink
        self.waiting = bytearray()
        self._begun = 0.0
        """When the first start bit of the present unbroken traffic began."""
        self._passed = 0
        """Characters of it that were handed on."""
        self._next = 0
        """Characters to hand on when the timer comes."""
        self._timer: Timer | None = None

    def push(self, data: bytes) -> bool:
        """Put bytes on the line; False, and nothing done, when its queue has no room for them."""
        if len(self.waiting) + len(data) > QUEUE_BYTES:
            return False
        if not data:
            return True
        if not self.waiting:
            self._begun, self._passed = self._clock.now(), 0
        self.waiting += data
        if self._timer is None or self._next < min(len(self.waiting), self._fifo):
            self._arm()
        return True

    async def drained(self) -> None:
        """Return when the last bit is through."""
        while self.waiting:
            await self._clock.sleep_until(self._at(self._passed + len(self.waiting)))

    def clear(self) -> None:
        """Lose what is on the line."""
        self.waiting.clear()
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _at(self, characters: int) -> float:
        return self._begun + characters * self._bits / self._baudrate

    def _arm(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
        self._next = min(len(self.waiting), self._fifo)
        self._timer = self._clock.call_at(self._at(self._passed + self._next), self._due)

    def _due(self) -> None:
        self._timer = None
        data = bytes(self.waiting[: self._next])
        del self.waiting[: self._next]
        self._passed += len(data)
        try:
            self._sink(data)
        finally:
            if self.waiting and self._timer is None:
                self._arm()
