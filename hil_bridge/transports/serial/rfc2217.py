"""Serial port behind a TCP connection according to RFC 2217: the client, and the server of an emulated port."""

import asyncio
from collections.abc import Callable
from typing import Any

from hil_bridge.clock import Clock, Timer
from hil_bridge.errors import TransportBroken, TransportError, TransportUnavailable
from hil_bridge.errors.event_kinds import EventKind
from hil_bridge.transports.back_off import Notice
from hil_bridge.transports.base import Transport
from hil_bridge.transports.delivery import QUEUE_BYTES, Delivery, flush
from hil_bridge.transports.serial.uart import Flaw, LineSettings, Parity
from protocol.endpoint import LocalProtocolError
from protocol.rfc2217 import (
    BreakSet,
    ComParity,
    ComPortClient,
    ComPortServer,
    LineState,
    LineStateChanged,
    Malformed,
    PortFailed,
    PortReady,
    PortSettings,
    SerialData,
    SettingsChanged,
    StopSize,
)

PIECE_BYTES = 4096
"""Number of bytes that are passed to a wire at once. Chosen: far less than the queue of the wire holds."""
RETRY_S = 0.01
"""Time after which sending to a full wire is retried, s. Chosen: a loopback connection has sent several pieces by
then.
"""

_PARITIES = {Parity.NONE: ComParity.NONE, Parity.ODD: ComParity.ODD, Parity.EVEN: ComParity.EVEN}
_PARITY_OF = {there: here for here, there in _PARITIES.items()}
_STATE_OF = {
    Flaw.PARITY: LineState.PARITY,
    Flaw.FRAMING: LineState.FRAMING,
    Flaw.BREAK: LineState.BREAK | LineState.FRAMING,
}
"""Line state that is reported for each flaw. A break also sets the framing bit, as in a 16550."""


def port_settings(line: LineSettings) -> PortSettings:
    """Convert the settings of a line to RFC 2217."""
    return PortSettings(line.baudrate, _PARITIES[line.parity], StopSize(line.stopbits))


def line_settings(port: PortSettings) -> LineSettings:
    """Return the line settings of a port that the emulated server serves."""
    return LineSettings(port.baudrate, _PARITY_OF[port.parity], int(port.stop_size))


class Rfc2217Client:
    """Transport of a client of a serial port. The server is at the other end of `wire`, which is started at once to
    configure the port.
    """

    def __init__(self, wire: Transport[bytes], line: LineSettings, clock: Clock, on_notice: Notice) -> None:
        self._endpoint = ComPortClient(port_settings(line), clock.now())
        self._clock = clock
        self._on_notice = on_notice
        self._ready: asyncio.Future[None] = clock.loop.create_future()
        self._telnet = _Telnet(wire, self._endpoint, clock, self._take)
        self._telnet.open()
        self._timer: Timer | None = None
        if (deadline := self._endpoint.next_deadline()) is not None:
            self._timer = clock.call_at(deadline, self._expired)

    @property
    def name(self) -> str:
        return self._telnet.name

    async def ready(self) -> None:
        """Return when the port is configured. If that fails, close the wire and raise TransportUnavailable."""
        try:
            await self._ready
        except BaseException:
            await self.aclose()
            raise

    def start(self, on_data: Callable[[bytes], None], on_end: Callable[[TransportError], None]) -> None:
        self._telnet.delivery.start(on_data, on_end)

    def send(self, data: bytes) -> None:
        self._telnet.send(data)

    def send_break(self, duration_s: float) -> None:
        """Hold the port's line low for approximately this time, s."""
        self._telnet.delivery.check()
        self._endpoint.set_break(True)
        self._telnet.turn()
        self._clock.call_at(self._clock.now() + duration_s, self._end_break)

    async def aclose(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
        await self._telnet.aclose()

    def _end_break(self) -> None:
        if self._telnet.delivery.ended is None:
            self._endpoint.set_break(False)
            self._telnet.turn()

    def _expired(self) -> None:
        self._timer = None
        deadline = self._endpoint.next_deadline()
        if deadline is not None:
            self._endpoint.handle_deadline(max(deadline, self._clock.now()))
            self._telnet.turn()

    def _take(self, event: Any) -> None:
        match event:
            case PortReady():
                if not self._ready.done():
                    self._ready.set_result(None)
            case PortFailed(text):
                self._telnet.delivery.end(TransportBroken(f"{self.name}: broke: {text}"))
                self._not_ready(TransportUnavailable(f"{self.name}: cannot be opened: {text}"))
            case LineStateChanged(state):
                self._on_notice(EventKind.LINE_ERROR, f"{self.name}: the port reports {state.name}")
            case Malformed(text):
                self._on_notice(EventKind.TELNET_ERROR, f"{self.name}: {text}")
            case TransportError() as error:
                self._not_ready(TransportUnavailable(f"{self.name}: cannot be opened: {error}"))

    def _not_ready(self, error: TransportUnavailable) -> None:
        if not self._ready.done():
            self._ready.set_exception(error)


class Rfc2217Port:
    """Emulated port that clients configure one after the other. It keeps the last settings."""

    def __init__(self, line: LineSettings, clock: Clock) -> None:
        self.settings = line
        self._clock = clock
        self._client: Rfc2217Server | None = None
        self.on_break: Callable[[bool], None] = lambda on: None
        """Called when a client begins or ends a break."""

    def serve(self, wire: Transport[bytes]) -> Transport[bytes]:
        """Return the transport of a new client."""
        self._client = Rfc2217Server(wire, self, self._clock)
        return self._client

    def flawed(self, flaw: Flaw) -> None:
        """Handle a damaged character that the port has received."""
        if self._client is not None:
            self._client.notify(flaw)


class Rfc2217Server:
    """Transport of one client of a port. `wire` is started at once so that the client can configure the port."""

    def __init__(self, wire: Transport[bytes], port: Rfc2217Port, clock: Clock) -> None:
        self._port = port
        self._endpoint = ComPortServer(port_settings(port.settings))
        self._telnet = _Telnet(wire, self._endpoint, clock, self._take)
        self._telnet.open()

    @property
    def name(self) -> str:
        return self._telnet.name

    def start(self, on_data: Callable[[bytes], None], on_end: Callable[[TransportError], None]) -> None:
        self._telnet.delivery.start(on_data, on_end)

    def send(self, data: bytes) -> None:
        self._telnet.send(data)

    def notify(self, flaw: Flaw) -> None:
        """Report a damaged character to the client if it has requested such reports."""
        self._endpoint.notify(_STATE_OF[flaw])
        self._telnet.turn()

    async def aclose(self) -> None:
        await self._telnet.aclose()

    def _take(self, event: Any) -> None:
        match event:
            case SettingsChanged(settings):
                self._port.settings = line_settings(settings)
            case BreakSet(on):
                self._port.on_break(on)


class _Telnet:
    """Connection between a wire and an endpoint. Payload goes to a delivery, other events go to `take`."""

    def __init__(
        self,
        wire: Transport[bytes],
        endpoint: ComPortClient | ComPortServer,
        clock: Clock,
        take: Callable[[Any], None],
    ) -> None:
        self._wire = wire
        self._endpoint = endpoint
        self._clock = clock
        self._take = take
        self._pending = bytearray()
        """Bytes that the wire has not accepted yet."""
        self._timer: Timer | None = None
        self.delivery: Delivery[bytes] = Delivery(wire.name, QUEUE_BYTES)

    @property
    def name(self) -> str:
        return self._wire.name

    def open(self) -> None:
        """Start the wire. Called once."""
        self._wire.start(self._arrived, self._ended)
        self.turn()

    def send(self, data: bytes) -> None:
        """Send payload. Errors as for `Transport.send`."""
        self.delivery.check()
        self._flush()
        if not data:
            return
        if self._pending:
            raise TransportError(f"{self.name}: the queue is full; the peer does not read")
        try:
            self._endpoint.send(data)
        except LocalProtocolError as error:
            raise TransportError(f"{self.name}: {error}") from error
        self.turn()

    def turn(self) -> None:
        """Process the endpoint's events and output."""
        while (event := self._endpoint.next_event()) is not None:
            if isinstance(event, SerialData):
                self.delivery.data(event.data)
            else:
                self._take(event)
        self._flush()

    async def aclose(self) -> None:
        """Send queued data, then close the wire."""
        self.delivery.begin_close()
        try:
            await flush(self._drained())
        finally:
            if self._timer is not None:
                self._timer.cancel()
            await self._wire.aclose()
            self.delivery.closed()

    async def _drained(self) -> None:
        while self._pending:
            await self._clock.sleep_until(self._clock.now() + RETRY_S)
            self._flush()

    def _flush(self) -> None:
        if not self._pending:
            self._pending += self._endpoint.data_to_send(self._clock.now())
        try:
            while self._pending:
                self._wire.send(bytes(self._pending[:PIECE_BYTES]))
                del self._pending[:PIECE_BYTES]
        except TransportError as error:
            if type(error) is not TransportError:
                self._pending.clear()  # the wire has ended, which `_ended` handles
            elif self._timer is None:
                self._timer = self._clock.call_at(self._clock.now() + RETRY_S, self._retry)

    def _retry(self) -> None:
        self._timer = None
        self._flush()

    def _arrived(self, data: bytes) -> None:
        self._endpoint.receive(data, self._clock.now())
        self.turn()

    def _ended(self, error: TransportError) -> None:
        self._pending.clear()
        self._take(error)
        self.delivery.end(error)
