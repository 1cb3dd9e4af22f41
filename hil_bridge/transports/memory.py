"""Byte wire inside one event loop, with latency but without jitter."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from hil_bridge.clock import Clock
from hil_bridge.clock.per_loop import of_loop
from hil_bridge.errors import TransportEnded, TransportError, TransportUnavailable
from hil_bridge.transports.base import Transport
from hil_bridge.transports.delivery import QUEUE_BYTES, Delivery, TimedQueue, flush
from hil_bridge.transports.listening import Exchange
from hil_bridge.transports.serial.line import Uart


@dataclass(frozen=True, slots=True)
class _Listener:
    exchange: "Exchange | _Acceptor"
    end: Uart | None


class _Acceptor:
    """Listener that accepts any number of clients at a time."""

    busy = False

    def __init__(self, on_client: Callable[[Transport[bytes]], object]) -> None:
        self.attach = on_client


def _listeners(clock: Clock) -> dict[str, _Listener]:
    """Return the listeners of this loop by name."""
    return of_loop(clock.loop, dict, "listeners of byte wires")


def memory_pair(
    clock: Clock, latency_s: float = 0.0, name: str = "memory:pair", line: bool = False
) -> tuple[Transport[bytes], Transport[bytes]]:
    """Return the two ends of a wire. Data reaches the other end unsplit after the latency, never within `send`.

    `line` promises that one of the two ends is given to a serial line, which itself takes time. A wire without
    latency then delivers within `send`, and no byte arrives earlier because of it.
    """
    at_once = line and latency_s <= 0.0
    here = _MemoryEnd(clock, latency_s, name, at_once)
    there = _MemoryEnd(clock, latency_s, name, at_once)
    here.peer, there.peer = there, here
    return here, there


def listen_memory(name: str, clock: Clock, end: Uart | None = None) -> Transport[bytes]:
    """Wait for clients that use this name in this loop, one client at a time. Raises TransportUnavailable if the
    name is in use.

    `end` is the listener's UART. The serial line itself is on the client's side of the wire.
    """
    listeners = _listeners(clock)
    if name in listeners:
        raise TransportUnavailable(f"memory:{name}: the name is already in use", remedy="choose another")
    exchange = Exchange(f"memory:{name}", free=lambda: None, stop=lambda: _forget(clock, name))
    listeners[name] = _Listener(exchange, end)
    return exchange


def listen_memory_clients(
    name: str, clock: Clock, on_client: Callable[[Transport[bytes]], object]
) -> Callable[[], None]:
    """Wait for any number of clients that use this name in this loop. `on_client` receives the transport of each
    client and closes it. Return a function that stops listening. Raises TransportUnavailable if the name is in use.
    """
    listeners = _listeners(clock)
    if name in listeners:
        raise TransportUnavailable(f"memory:{name}: the name is already in use", remedy="choose another")
    listeners[name] = _Listener(_Acceptor(on_client), None)
    return lambda: _forget(clock, name)


def connect_memory(
    name: str, latency_s: float, clock: Clock, line: bool = False
) -> tuple[Transport[bytes], Uart | None]:
    """Connect to the listener with this name. Return the wire and the listener's UART, if it has one.

    The wire must be given to a serial line if the listener has a UART, or if `line` is true.

    Raises TransportUnavailable if there is no listener, or if another client is connected.
    """
    listener = _listeners(clock).get(name)
    if listener is None:
        raise TransportUnavailable(
            f"memory:{name}: no program listens with this name", remedy="start the other side first"
        )
    if listener.exchange.busy:
        raise TransportUnavailable(
            f"memory:{name}: another client is connected", remedy="close that one first"
        )
    here, there = memory_pair(clock, latency_s, f"memory:{name}", line or listener.end is not None)
    listener.exchange.attach(there)
    return here, listener.end


def _forget(clock: Clock, name: str) -> None:
    del _listeners(clock)[name]


class _MemoryEnd:
    __slots__ = ("_at_once", "_delivery", "_latency", "_queue", "peer")

    peer: "_MemoryEnd"

    def __init__(self, clock: Clock, latency: float, name: str, at_once: bool) -> None:
        self._at_once = at_once
        self._delivery: Delivery[bytes] = Delivery(name, QUEUE_BYTES)
        self._queue = TimedQueue(clock)
        self._latency = latency

    @property
    def name(self) -> str:
        return self._delivery.name

    def start(self, on_data: Callable[[bytes], None], on_end: Callable[[TransportError], None]) -> None:
        self._delivery.start(on_data, on_end)

    def send(self, data: bytes) -> None:
        self._delivery.check()
        if not data:
            return
        arrivals = self.peer._delivery
        if self._queue.weight + arrivals.waiting + len(data) > QUEUE_BYTES:
            raise TransportError(
                f"{self.name}: the queue of {QUEUE_BYTES} bytes is full; the peer does not read"
            )
        if self._at_once:
            arrivals.data(bytes(data))
        else:
            self._queue.put(partial(arrivals.data, bytes(data)), len(data), self._latency)

    async def aclose(self) -> None:
        if not self._delivery.begin_close():
            return
        end = partial(self.peer._delivery.end, TransportEnded(f"{self.name}: the peer closed"))
        self._queue.put(end, 0, self._latency)
        try:
            await flush(self._queue.drained())
        finally:
            self._delivery.closed()
