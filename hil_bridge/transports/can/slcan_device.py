"""Device side of an slcan adapter: a byte wire to the host, and a bus between the adapter and the device."""

from collections.abc import Callable, Sequence
from typing import Protocol

from hil_bridge.clock import Clock
from hil_bridge.errors import TransportError
from hil_bridge.transports.base import Frames, Transport
from hil_bridge.transports.can.memory import MemoryCanBus, MemoryCanNode
from protocol.can.frame import CanFrame


class Adapter(Protocol):
    """State machine of an slcan adapter, without I/O."""

    @property
    def bus_bit_rate(self) -> int:
        """Bit rate of the adapter's bus, bit/s."""

    def receive(self, data: bytes, now: float) -> None:
        """Process bytes from the host."""

    def send_frames(self, frames: Sequence[CanFrame], now: float) -> None:
        """Process frames received on the adapter's bus."""

    def next_event(self) -> CanFrame | None:
        """Return a frame that the host sends, or None if there are no more frames."""

    def data_to_send(self, now: float) -> bytes:
        """Return bytes for the host."""


class SlcanDevice:
    """Transport of frames over a byte wire, with an adapter between the wire and the device.

    Frames take time on the adapter's bus in both directions. The bus has two nodes, the adapter and the device. The
    adapter acknowledges all frames, even while its channel is closed.
    """

    def __init__(self, serial: Transport[bytes], adapter: Adapter, clock: Clock) -> None:
        self._serial = serial
        self._clock = clock
        self._adapter = adapter
        bus = MemoryCanBus(clock, adapter.bus_bit_rate, serial.name)
        self._adapter_node, self._device_node = bus.connect(), bus.connect()
        self.lost = 0
        """Number of frames dropped before the bus because the queue was full, for example after a stall of
        this process.
        """

    @property
    def name(self) -> str:
        """URL of the byte wire."""
        return self._serial.name

    def start(self, on_data: Callable[[Frames], None], on_end: Callable[[TransportError], None]) -> None:
        """Start serving the host of the adapter."""
        self._device_node.start(on_data, on_end)
        self._adapter_node.start(self._from_bus, on_end)
        self._serial.start(self._from_host, on_end)

    def send(self, data: Frames) -> None:
        """Send frames of the device to the bus, and to the host if the adapter's channel is open."""
        self._queue(self._device_node, data)

    async def aclose(self) -> None:
        """Close the byte wire after the bus has sent the queued frames."""
        await self._device_node.aclose()
        await self._adapter_node.aclose()
        await self._serial.aclose()

    def _from_bus(self, frames: Frames) -> None:
        self._adapter.send_frames(frames, self._clock.now())
        self._answer()

    def _from_host(self, data: bytes) -> None:
        self._adapter.receive(data, self._clock.now())
        self._answer()
        frames = []
        while (frame := self._adapter.next_event()) is not None:
            frames.append(frame)
        if frames:
            self._queue(self._adapter_node, frames)

    def _queue(self, node: MemoryCanNode, frames: Frames) -> None:
        try:
            node.send(frames)
        except TransportError as error:
            if type(error) is not TransportError:
                raise
            self.lost += len(frames)

    def _answer(self) -> None:
        if text := self._adapter.data_to_send(self._clock.now()):
            self._serial.send(text)
