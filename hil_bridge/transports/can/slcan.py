"""Transport over a serial CAN adapter. Frames are sent over any byte wire: a serial port or TCP."""

from collections.abc import Callable, Sequence
from contextlib import suppress

from hil_bridge.clock import Clock
from hil_bridge.errors import TransportError
from hil_bridge.transports.base import Frames, Transport
from hil_bridge.transports.can.queue import CanStatistics
from hil_bridge.transports.delivery import QUEUE_FRAMES
from protocol.can.frame import CanFilter
from protocol.can.slcan import SlcanClient


class SlcanWire:
    """Transport over an adapter. The adapter's channel is opened at once.

    The slcan protocol does not report bus errors, and does not confirm every sent frame. Frames that wait for the
    adapter are queued in the byte wire, with its limits.
    """

    def __init__(
        self, wire: Transport[bytes], bitrate: int | None, clock: Clock, accept: Sequence[CanFilter] = ()
    ) -> None:
        self._wire = wire
        self._clock = clock
        self._accept = tuple(accept)
        self._client = SlcanClient(bitrate)
        self._on_frames: Callable[[Frames], None] = lambda frames: None
        self._sent = self._received = 0
        self._closing = False
        self._push()

    @property
    def name(self) -> str:
        return self._wire.name

    @property
    def statistics(self) -> CanStatistics:
        """Counts since opening."""
        return CanStatistics(sent=self._sent, received=self._received, malformed=self._client.malformed)

    def start(self, on_data: Callable[[Frames], None], on_end: Callable[[TransportError], None]) -> None:
        self._on_frames = on_data
        self._wire.start(self._arrived, on_end)

    def send(self, data: Frames) -> None:
        if any(frame.error for frame in data):
            raise ValueError("an error report is not a frame that a node can send")
        if len(data) > QUEUE_FRAMES:
            raise TransportError(f"{self.name}: the send queue is full, {QUEUE_FRAMES} frames")
        self._client.send(data)
        self._push()
        self._sent += len(data)

    async def aclose(self) -> None:
        if not self._closing:
            self._closing = True
            self._client.close()
            with suppress(TransportError):
                self._push()
        await self._wire.aclose()

    def _push(self) -> None:
        self._wire.send(self._client.data_to_send(self._clock.now()))

    def _arrived(self, data: bytes) -> None:
        client, frames = self._client, []
        client.receive(data, self._clock.now())
        while (frame := client.next_event()) is not None:
            if not self._accept or any(choice.accepts(frame) for choice in self._accept):
                frames.append(frame)
        if frames:
            self._received += len(frames)
            self._on_frames(frames)
