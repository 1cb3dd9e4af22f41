"""The device's side of an slcan adapter: a byte wire to the host, CAN frames on the adapter's other side."""

from collections.abc import Callable, Sequence
from typing import Protocol

from hil_bridge.clock import Clock
from hil_bridge.errors import TransportError
from hil_bridge.transports.base import Frames, Transport
from protocol.can.frame import CanFrame


class Adapter(Protocol):
    """An slcan adapter as a machine without input and output."""

    def receive(self, data: bytes, now: float) -> None:
        """Bytes from the host."""

    def send_frames(self, frames: Sequence[CanFrame], now: float) -> None:
        """Frames seen on the adapter's bus."""

    def next_event(self) -> CanFrame | None:
        """A frame that the host sends, or None when there is no more."""

    def data_to_send(self, now: float) -> bytes:
        """Bytes for the host."""


class SlcanDevice:
    """A transport of frames over a byte wire, with an adapter between them."""

    def __init__(self, serial: Transport[bytes], adapter: Adapter, clock: Clock) -> None:
        self._serial = serial
        self._clock = clock
        self._adapter = adapter
        self._on_frames: Callable[[Frames], None] = lambda frames: None

    @property
    def name(self) -> str:
        """The URL of the byte wire."""
        return self._serial.name

    def start(self, on_data: Callable[[Frames], None], on_end: Callable[[TransportError], None]) -> None:
        """Begin to serve the host that talks to the adapter."""
        self._on_frames = on_data
        self._serial.start(self._from_host, on_end)

    def send(self, data: Frames) -> None:
        """Frames seen on the adapter's bus, for the host if its channel is open."""
        self._adapter.send_frames(data, self._clock.now())
        self._answer()

    async def aclose(self) -> None:
        """Close the byte wire."""
        await self._serial.aclose()

    def _from_host(self, data: bytes) -> None:
        self._adapter.receive(data, self._clock.now())
        self._answer()
        frames = []
        while (frame := self._adapter.next_event()) is not None:
            frames.append(frame)
        if frames:
            self._on_frames(frames)

    def _answer(self) -> None:
        if text := self._adapter.data_to_send(self._clock.now()):
            self._serial.send(text)
