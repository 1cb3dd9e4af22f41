"""Wires for the device packages: opened by URL, logged, and served by emulated devices.

A device package chooses the type of wire. This module adds the tap for the log, and the wrapper of a test.
"""

from collections.abc import Callable, Sequence
from contextlib import AsyncExitStack
from dataclasses import dataclass, field
from functools import partial
from typing import Any, TypeVar

from hil_bridge.clock import Clock
from hil_bridge.devices.client_port import Accept, ClientPort
from hil_bridge.devices.device_log import DeviceLog
from hil_bridge.errors import TransportClosed
from hil_bridge.errors.event_kinds import EventKind
from hil_bridge.transports import Datagrams, Frames, Listening, Tap, Transport, opening
from hil_bridge.transports.pump import Pump
from protocol.can.frame import CanFilter

_Data = TypeVar("_Data")
Wrap = Callable[[str, Transport[Any]], Transport[Any]]
"""Wrapper that a test inserts between a wire and its client. The arguments are the device, "robot" or "sensor", and
the wire.
"""


def unwrapped(device: str, wire: Transport[Any]) -> Transport[Any]:
    """Return the wire unchanged."""
    return wire


@dataclass(frozen=True, slots=True)
class Wiring:
    """Wires of one device for its client."""

    device: str
    """Name of the device under which the log receives the traffic: "robot" or "sensor"."""
    clock: Clock
    log: DeviceLog
    wrap: Wrap = unwrapped

    async def bytes(self, url: str) -> Transport[bytes]:
        """Open a byte wire. Raises ConfigError for an invalid URL, TransportUnavailable if the wire cannot be
        opened.
        """
        return self.tap(await opening.connect_bytes(url, self.clock, self.log.notice))

    async def can(self, url: str, accept: Sequence[CanFilter] = ()) -> Transport[Frames]:
        """Open a wire for CAN frames that match one of the filters, or for all frames if there are no filters.
        Errors as for `bytes`.
        """
        return self.tap(await opening.connect_can(url, self.clock, accept))

    async def datagrams(self, url: str, speak_first: bool = True) -> Transport[Datagrams]:
        """Open a wire for datagrams. `speak_first` says whether the client sends first. Errors as for `bytes`."""
        if speak_first:
            return self.tap(await opening.connect_datagrams(url, self.clock, self.log.notice))
        return self.tap((await opening.listen_datagrams(url, self.clock, self.log.notice)).transport)

    def tap(self, wire: Transport[_Data]) -> Transport[_Data]:
        """Add the log to a wire that the device package has opened, if the log accepts traffic."""
        wrapped = self.wrap(self.device, wire)
        return Tap(wrapped, partial(self.log.traffic, self.device)) if self.log.verbose else wrapped


@dataclass(frozen=True, slots=True)
class Serving:
    """Wires of the emulated devices. Closing `stack` closes everything that was opened."""

    clock: Clock
    stack: AsyncExitStack
    on_failure: Callable[[BaseException], object]
    """Callback for a device that can no longer be served; receives the reason."""
    say: Callable[[str], None]
    """Callback that receives one line for each connection that ended with an error."""
    pumps: list[Pump[Any, Any]] = field(default_factory=list)
    """Pumps of all devices. They are woken when a fault begins or ends."""
    _announced: set[str] = field(default_factory=set)
    """Kinds of datagram notices that have already been reported."""

    async def serve_bytes(self, url: str, endpoint: Any) -> str:
        """Serve an endpoint on a listening byte wire and return the URL for its client. Raises ConfigError for an
        invalid URL, TransportUnavailable if the wire cannot be opened.
        """
        listening = await self.listen_bytes(url)
        self.attach(endpoint, listening.transport)
        return listening.address

    async def listen_bytes(self, url: str) -> Listening[Transport[bytes]]:
        """Open a listening byte wire, for a device package that inserts a converter before its device. Errors as
        for `serve_bytes`.
        """
        return await opening.listen_bytes(url, self.clock)

    async def serve_clients(self, url: str, accept: Accept) -> str:
        """Serve any number of clients at a time on `tcp-listen://HOST:PORT` or `memory:NAME`, each with the endpoint
        that `accept` returns. Return the URL for a client. Errors as for `serve_bytes`.
        """
        port = ClientPort(accept, self.clock, self.pumps, self.on_failure)
        address = await port.listen(url)
        self.stack.push_async_callback(port.aclose)
        return address

    async def serve_can(self, url: str, endpoint: Any, accept: Sequence[CanFilter] = ()) -> str:
        """Serve an endpoint on CAN frames that match one of the filters, or on all frames if there are no filters."""
        listening = await opening.listen_can(url, self.clock, accept)
        self.attach(endpoint, listening.transport)
        return listening.address

    async def serve_datagrams(
        self, url: str, endpoint: Any, speak_first: bool = False, counts_late: bool = False
    ) -> str:
        """Serve an endpoint on datagrams. `speak_first` says whether the device sends first. A device that counts
        late answers (`counts_late`) reads the answers that have arrived before it ends a cycle.
        """
        if speak_first:
            wire = await opening.connect_datagrams(url, self.clock, partial(self._say_once, url))
            self.attach(_CountsLate(endpoint, wire.take_in) if counts_late else endpoint, wire)
            return url.replace("udp://", "udp-bind://", 1)
        listening = await opening.listen_datagrams(url, self.clock)
        self.attach(endpoint, listening.transport)
        return listening.address

    def _say_once(self, url: str, kind: str, text: str) -> None:
        """Report a notice of a datagram wire. Each client that leaves is reported, any other notice only once. A
        device that sends first continues while no program listens.
        """
        if kind == EventKind.LEFT or kind not in self._announced:
            self._announced.add(kind)
            waits = f"{url}: waiting for its client; no program is listening there yet"
            self.say(waits if kind == EventKind.ABSENT else text)

    def attach(self, endpoint: Any, wire: Transport[Any]) -> Pump[Any, Any]:
        """Serve an endpoint on a wire that the device package has opened."""
        self.stack.push_async_callback(wire.aclose)
        pump: Pump[Any, Any] = Pump(endpoint, wire, self.clock, _ignore, self.ended)
        pump.start()
        self.pumps.append(pump)
        return pump

    def wake(self) -> None:
        """Let every device send its pending data."""
        for pump in self.pumps:
            pump.kick()

    def ended(self, cause: BaseException) -> None:
        """Report that a device's wire has ended, unless this side closed it."""
        if not isinstance(cause, TransportClosed):
            self.on_failure(cause)


class _CountsLate:
    """Endpoint of a device that sends first and counts the answers that are missing at its next cycle.

    The deadline of the cycle may be handled late on this computer. Answers that are by then in the receive buffer
    of the operating system arrived in time, so they are read first.
    """

    __slots__ = ("_take_in", "data_to_send", "next_deadline", "next_event", "receive", "wrapped")

    def __init__(self, endpoint: Any, take_in: Callable[[], None]) -> None:
        self.wrapped, self._take_in = endpoint, take_in
        self.receive, self.next_event = endpoint.receive, endpoint.next_event
        self.data_to_send, self.next_deadline = endpoint.data_to_send, endpoint.next_deadline

    def handle_deadline(self, now: float) -> None:
        self._take_in()
        self.wrapped.handle_deadline(now)


def _ignore(event: object) -> None:
    """Ignore an event: emulated devices report their events on the wire only."""
