"""Wires for the rooms of devices: opened by URL, shown to a log, served by an emulated device.

A room says which kind of wire its device has; a tap and a test's own wrapper come to it here.
"""

from collections.abc import Callable, Sequence
from contextlib import AsyncExitStack
from dataclasses import dataclass, field
from functools import partial
from typing import Any, TypeVar

from hil_bridge.clock import Clock
from hil_bridge.devices.device_log import DeviceLog
from hil_bridge.errors import TransportClosed
from hil_bridge.errors.event_kinds import EventKind
from hil_bridge.transports import Datagrams, Frames, Listening, Tap, Transport, opening
from hil_bridge.transports.pump import Pump
from protocol.can.frame import CanFilter

_Data = TypeVar("_Data")
Wrap = Callable[[str, Transport[Any]], Transport[Any]]
"""Puts something of a test between a wire and its client: from the device, "robot" or "sensor", and the wire."""


def unwrapped(device: str, wire: Transport[Any]) -> Transport[Any]:
    """The wire as it is."""
    return wire


@dataclass(frozen=True, slots=True)
class Wiring:
    """The wires of one device, for its client."""

    device: str
    """"robot" or "sensor": under that name the log is shown what goes over them."""
    clock: Clock
    log: DeviceLog
    wrap: Wrap = unwrapped

    async def bytes(self, url: str) -> Transport[bytes]:
        """A byte wire. Raises ConfigError for the URL, TransportUnavailable for the wire."""
        return self.tap(await opening.connect_bytes(url, self.clock, self.log.notice))

    async def can(self, url: str, accept: Sequence[CanFilter] = ()) -> Transport[Frames]:
        """A wire of CAN frames, of those that one of the filters accepts; of all without filters. Errors as `bytes`."""
        return self.tap(await opening.connect_can(url, self.clock, accept))

    async def datagrams(self, url: str, speak_first: bool = True) -> Transport[Datagrams]:
        """A wire of datagrams, on which the client speaks first, or the device does. Errors as `bytes`."""
        if speak_first:
            return self.tap(await opening.connect_datagrams(url, self.clock, self.log.notice))
        return self.tap((await opening.listen_datagrams(url, self.clock, self.log.notice)).transport)

    def tap(self, wire: Transport[_Data]) -> Transport[_Data]:
        """A wire that the room has opened itself, shown to the log like every other."""
        return Tap(self.wrap(self.device, wire), partial(self.log.traffic, self.device))


@dataclass(frozen=True, slots=True)
class Serving:
    """The wires of the emulated devices, for the devices. All that is opened is closed with `stack`."""

    clock: Clock
    stack: AsyncExitStack
    on_failure: Callable[[BaseException], object]
    """Called with the reason when a device can no longer be served."""
    say: Callable[[str], None]
    """Called with a line for each connection that ended badly."""
    pumps: list[Pump[Any, Any]] = field(default_factory=list)
    """Pumps of all devices: to be woken when a fault begins or ends."""
    _announced: set[str] = field(default_factory=set)
    """Kinds of notices of datagram wires that were told."""

    async def serve_bytes(self, url: str, endpoint: Any) -> str:
        """Let an endpoint speak over a byte wire that listens; the URL for its client. Raises ConfigError for the URL,
        TransportUnavailable for the wire.
        """
        listening = await self.listen_bytes(url)
        self.attach(endpoint, listening.transport)
        return listening.address

    async def listen_bytes(self, url: str) -> Listening[Transport[bytes]]:
        """A byte wire that listens, for a room that puts something between the wire and its device. Errors as
        `serve_bytes`.
        """
        return await opening.listen_bytes(url, self.clock)

    async def serve_can(self, url: str, endpoint: Any, accept: Sequence[CanFilter] = ()) -> str:
        """The same with CAN frames, of those that one of the filters accepts; of all without filters."""
        listening = await opening.listen_can(url, self.clock, accept)
        self.attach(endpoint, listening.transport)
        return listening.address

    async def serve_datagrams(
        self, url: str, endpoint: Any, speak_first: bool = False, counts_late: bool = False
    ) -> str:
        """The same with datagrams, on which the client speaks first, or the device does. One that `counts_late` answers
        reads those that have come before it ends a cycle.
        """
        if speak_first:
            wire = await opening.connect_datagrams(url, self.clock, partial(self._say_once, url))
            self.attach(_CountsLate(endpoint, wire.take_in) if counts_late else endpoint, wire)
            return url.replace("udp://", "udp-bind://", 1)
        listening = await opening.listen_datagrams(url, self.clock)
        self.attach(endpoint, listening.transport)
        return listening.address

    def _say_once(self, url: str, kind: str, text: str) -> None:
        """A device that speaks first continues speaking where no program listens: one line is enough. Each client that
        leaves has a line.
        """
        if kind == EventKind.LEFT or kind not in self._announced:
            self._announced.add(kind)
            waits = f"{url}: waits for its client; no program listens there yet"
            self.say(waits if kind == EventKind.ABSENT else text)

    def attach(self, endpoint: Any, wire: Transport[Any]) -> Pump[Any, Any]:
        """Let an endpoint speak over a wire that the room has opened itself."""
        self.stack.push_async_callback(wire.aclose)
        pump: Pump[Any, Any] = Pump(endpoint, wire, self.clock, _ignore, self.ended)
        pump.start()
        self.pumps.append(pump)
        return pump

    def wake(self) -> None:
        """Ask every device whether it has something to say."""
        for pump in self.pumps:
            pump.kick()

    def ended(self, cause: BaseException) -> None:
        """A device's wire has ended: told, unless it was closed."""
        if not isinstance(cause, TransportClosed):
            self.on_failure(cause)


class _CountsLate:
    """A device that speaks first, and counts answers that have not come before its next beat.

    A beat may wait for this computer for long. An answer that lies in the system's buffer meanwhile has come before it.
    """

    __slots__ = ("_endpoint", "_take_in", "data_to_send", "next_deadline", "next_event", "receive")

    def __init__(self, endpoint: Any, take_in: Callable[[], None]) -> None:
        self._endpoint, self._take_in = endpoint, take_in
        self.receive, self.next_event = endpoint.receive, endpoint.next_event
        self.data_to_send, self.next_deadline = endpoint.data_to_send, endpoint.next_deadline

    def handle_deadline(self, now: float) -> None:
        self._take_in()
        self._endpoint.handle_deadline(now)


def _ignore(event: object) -> None:
    """An emulated device tells its events to its wire alone."""
