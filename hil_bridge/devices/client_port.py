"""Listening port of an emulated device that serves any number of clients, each with an endpoint of its own."""

import asyncio
from collections.abc import Callable
from dataclasses import replace
from typing import Any, Protocol, TypeAlias

from hil_bridge.clock import Clock
from hil_bridge.errors import TransportError
from hil_bridge.transports import Transport
from hil_bridge.transports.memory import listen_memory_clients
from hil_bridge.transports.pump import Pump
from hil_bridge.transports.tcp import listen_tcp_clients
from hil_bridge.transports.urls import LISTEN_BYTES, parse_url
from protocol.endpoint import Endpoint

_WIRES = {scheme: replace(LISTEN_BYTES[scheme], options={}) for scheme in ("tcp-listen", "memory")}


class ClientEndpoint(Endpoint[bytes, bytes, None], Protocol):
    """Device's end of the connection of one client. It emits no events."""

    @property
    def closing(self) -> bool:
        """Whether the device ends the connection after the data to send now."""

    def close(self, now: float) -> None:
        """Handle the end of the connection, whichever side has ended it. Called once."""


Accept: TypeAlias = Callable[[Transport[bytes], float], ClientEndpoint | None]
"""Function that returns the endpoint of a new client, from its wire and the time, s. None: the client is refused, and
its connection is closed.
"""


class Hangup:
    """Event that reports that a device closes its connection."""


class HangupEndpoint:
    """Endpoint that reports when the device closes its connection."""

    def __init__(self, server: ClientEndpoint) -> None:
        self.wrapped = server
        self._is_reported = False
        self.receive, self.data_to_send = server.receive, server.data_to_send
        self.next_deadline, self.handle_deadline = server.next_deadline, server.handle_deadline

    def next_event(self) -> Hangup | None:
        if self.wrapped.closing and not self._is_reported:
            self._is_reported = True
            return Hangup()
        return None


class ClientPort:
    """Port that serves clients until it is closed."""

    def __init__(
        self,
        accept: Accept,
        clock: Clock,
        pumps: list[Pump[Any, Any]],
        on_failure: Callable[[BaseException], object],
    ) -> None:
        """Create a port. The pumps of its connections are in `pumps` while they are open. `on_failure` receives an
        error of an endpoint.
        """
        self._accept, self._clock, self._pumps, self._on_failure = accept, clock, pumps, on_failure
        self._wires: set[Transport[bytes]] = set()
        self._closing: set[asyncio.Task[None]] = set()
        self._stop: Callable[[], None] = _stop_nothing

    async def listen(self, url: str) -> str:
        """Listen on `tcp-listen://HOST:PORT` or `memory:NAME`, and return the URL for a client. Raises ConfigError for
        an invalid URL, TransportUnavailable if the port cannot be opened.
        """
        parsed, clock = parse_url(url, _WIRES), self._clock
        if parsed.scheme == "memory":
            self._stop = listen_memory_clients(parsed.target, clock, self._welcome)
            return f"memory:{parsed.target}"
        self._stop, host, port = await listen_tcp_clients(
            *parsed.host_port, clock, parsed.name, self._welcome
        )
        return f"tcp://{f'[{host}]' if ':' in host else host}:{port}"

    async def aclose(self) -> None:
        """Stop listening, and close all connections."""
        self._stop()
        self._stop = _stop_nothing
        for wire in list(self._wires):
            await wire.aclose()
        await asyncio.gather(*self._closing)

    def _welcome(self, wire: Transport[bytes]) -> None:
        clock = self._clock
        server = self._accept(wire, clock.now())
        self._wires.add(wire)
        if server is None:
            wire.start(_ignore, _ignore)
            self._hang_up(wire)
            return

        def ended(cause: BaseException) -> None:
            server.close(clock.now())
            self._pumps.remove(pump)
            self._hang_up(wire)
            if not isinstance(cause, TransportError):
                self._on_failure(cause)

        def hang_up(event: Hangup) -> None:
            rest = server.data_to_send(clock.now())
            if rest:
                wire.send(rest)
            self._hang_up(wire)

        pump: Pump[bytes, Hangup] = Pump(HangupEndpoint(server), wire, clock, hang_up, ended)
        self._pumps.append(pump)
        pump.start()

    def _hang_up(self, wire: Transport[bytes]) -> None:
        """Close a wire without waiting."""
        self._wires.discard(wire)
        task = self._clock.loop.create_task(wire.aclose())
        self._closing.add(task)
        task.add_done_callback(self._closing.discard)


def _ignore(event: object) -> None:
    """Ignore data from a connection that is closed at once."""


def _stop_nothing() -> None:
    """Do nothing, because the port is not open."""
