"""USB serial adapter. Received bytes wait for the latency timer, sent bytes for the next USB frame.

Reference: FTDI application note AN232B-04, Data Throughput, Latency and Handshaking.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from hil_bridge.clock import Clock, Timer
from hil_bridge.errors import TransportClosed, TransportError
from hil_bridge.transports.around import Around
from hil_bridge.transports.base import Transport
from hil_bridge.transports.delivery import QUEUE_BYTES, TimedQueue, flush
from hil_bridge.transports.wrappers import Direction
from protocol.marks import Mark, above, at_least, between, check_settings, setting


@dataclass(frozen=True, slots=True)
class UsbAdapterProfile:
    """Timing of an FTDI adapter. Raises ValueError if a setting is out of range."""

    latency_s: float = setting(
        0.016,
        Mark.STANDARD,
        "time since its last packet after which the adapter sends what it has, even if nothing (AN232B-04)",
        between(0.001, 0.255),
        unit="s",
    )
    packet_bytes: int = setting(
        62,
        Mark.STANDARD,
        "bytes of a full packet, which is sent at once (AN232B-04)",
        at_least(1),
        unit="bytes",
    )
    frame_s: float = setting(
        0.001,
        Mark.ASSUMED,
        "time between two USB frames of a full-speed device; a packet passes with the next one, in both directions",
        above(0.0),
        unit="s",
    )

    def __post_init__(self) -> None:
        check_settings(self)


class UsbAdapter(Around[bytes]):
    """Byte wire with a USB adapter. `to_host` is the direction from the adapter to its computer.

    For a client, the bytes to the host are received bytes. For the device at the other end of the cable, they are
    sent bytes.
    """

    __slots__ = ("_to_host", "_to_line", "_towards")

    def __init__(
        self,
        transport: Transport[bytes],
        profile: UsbAdapterProfile,
        clock: Clock,
        to_host: Direction = Direction.RECEIVED,
    ) -> None:
        super().__init__(transport)
        self._towards = to_host
        here, there = self._delivery.data, self._leave
        receives = to_host is Direction.RECEIVED
        self._to_host = _ToHost(profile, clock, here if receives else there)
        self._to_line = _ToLine(profile, clock, there if receives else here)

    def send(self, data: bytes) -> None:
        self._delivery.check()
        if self._to_host.waiting + self._to_line.waiting + len(data) > QUEUE_BYTES:
            raise TransportError(f"{self.name}: the adapter's queue of {QUEUE_BYTES} bytes is full")
        self._take(Direction.SENT, data)

    async def aclose(self) -> None:
        if not self._delivery.begin_close():
            return
        try:
            await flush(self._outward().drained())
        finally:
            await self._inner.aclose()
            self._to_host.clear()
            self._to_line.clear()
            self._delivery.closed()

    def _outward(self) -> "_ToHost | _ToLine":
        return self._to_host if self._towards is Direction.SENT else self._to_line

    def _take(self, direction: Direction, data: bytes) -> None:
        if data:
            (self._to_host if direction is self._towards else self._to_line).put(data)

    def _arrived(self, data: bytes) -> None:
        self._take(Direction.RECEIVED, data)

    def _inner_ended(self, error: TransportError) -> None:
        if isinstance(error, TransportClosed):
            self._delivery.end(error)
        elif self._towards is Direction.RECEIVED:
            self._to_host.end(partial(self._delivery.end, error))
        else:
            self._to_line.end(partial(self._delivery.end, error))


class _ToLine:
    """Direction from the computer to the adapter. Bytes are delivered with the next frame."""

    __slots__ = ("_clock", "_frame", "_origin", "_queue", "_sink")

    def __init__(self, profile: UsbAdapterProfile, clock: Clock, sink: Callable[[bytes], None]) -> None:
        self._clock = clock
        self._frame = profile.frame_s
        self._origin = clock.now()
        self._queue = TimedQueue(clock)
        self._sink = sink

    @property
    def waiting(self) -> int:
        """Number of bytes in transit."""
        return self._queue.weight

    def put(self, data: bytes) -> None:
        """Deliver bytes with the next frame."""
        self._queue.put(partial(self._sink, data), len(data), self._until_frame())

    def end(self, action: Callable[[], None]) -> None:
        """Execute `action` once all bytes have been delivered."""
        self._queue.put(action, 0, self._until_frame())

    async def drained(self) -> None:
        """Return when all bytes have been delivered."""
        await self._queue.drained()

    def clear(self) -> None:
        """Discard the bytes in transit."""
        self._queue.clear()

    def _until_frame(self) -> float:
        since = self._clock.now() - self._origin
        return _next_tick(since, self._frame) - since


class _ToHost:
    """Direction from the adapter to the computer. Full packets are sent at once, the rest when the latency timer
    expires.
    """

    __slots__ = ("_clock", "_frames", "_held", "_profile", "_sent_at", "_timer")

    def __init__(self, profile: UsbAdapterProfile, clock: Clock, sink: Callable[[bytes], None]) -> None:
        self._clock = clock
        self._profile = profile
        self._frames = _ToLine(profile, clock, sink)
        self._held = bytearray()
        self._sent_at = clock.now()
        """Time of the adapter's last packet, which may have been empty."""
        self._timer: Timer | None = None

    @property
    def waiting(self) -> int:
        """Number of bytes in transit."""
        return len(self._held) + self._frames.waiting

    def put(self, data: bytes) -> None:
        """Process bytes that the adapter has received."""
        now, size = self._clock.now(), self._profile.packet_bytes
        self._held += data
        while len(self._held) >= size:
            self._send(size, now)
        if self._held and self._timer is None:
            since = now - self._sent_at
            due = self._sent_at + _next_tick(since, self._profile.latency_s)
            self._timer = self._clock.call_at(due, self._expired)

    def end(self, action: Callable[[], None]) -> None:
        """Execute `action` once all bytes have been delivered. The adapter no longer waits for its timer."""
        if self._held:
            self._send(len(self._held), self._clock.now())
        self._frames.end(action)

    async def drained(self) -> None:
        """Return when all bytes have been delivered."""
        if self._held:
            self._send(len(self._held), self._clock.now())
        await self._frames.drained()

    def clear(self) -> None:
        """Discard the bytes in transit."""
        self._disarm()
        self._held.clear()
        self._frames.clear()

    def _expired(self) -> None:
        self._timer = None
        self._send(len(self._held), self._clock.now())

    def _send(self, count: int, now: float) -> None:
        self._disarm()
        self._sent_at = now
        packet = bytes(self._held[:count])
        del self._held[:count]
        self._frames.put(packet)

    def _disarm(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None


def _next_tick(since: float, period: float) -> float:
    """Return the first multiple of a period after `since`; both in s."""
    # a time that differs from the tick only by rounding belongs to the next tick
    return (math.floor(since / period + 1e-6) + 1) * period
