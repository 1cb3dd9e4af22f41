"""Wires of a receiver board: byte wires for the register protocol, after the prefix `jr3-board+`.

| connect | listen |
|---|---|
| `tcp://127.0.0.1:1762?filter=2` | `tcp-listen://127.0.0.1:1762` |
| `memory:NAME?filter=2` | `memory:NAME` |
"""

from collections.abc import Awaitable, Callable
from dataclasses import dataclass, replace
from typing import Final, NamedTuple
from urllib.parse import parse_qsl, urlencode, urlsplit

from hil_bridge.clock import Clock
from hil_bridge.devices.sensors.jr3.registers.server import ListenerProfile, RegisterListener
from hil_bridge.errors import ConfigError, TransportClosed
from hil_bridge.transports import Transport, connect_bytes, listen_bytes
from hil_bridge.transports.pump import Pump
from hil_bridge.transports.urls import CONNECT_BYTES, LISTEN_BYTES, parse_url
from protocol.devices.jr3.board import Registers
from protocol.devices.jr3.registers import (
    BoardClientProfile,
    ConnectionOver,
    RegisterServer,
    RegisterServerProfile,
)

DEFAULT_PORT: Final = 1762
"""Default TCP port. Chosen: the PCI vendor number of JR3, read as a decimal number."""

_CONNECT = {scheme: CONNECT_BYTES[scheme] for scheme in ("tcp", "memory")}
_RECONNECT = "reconnect_s"
"""Option of byte wires that the wire of a board does not support."""
_LISTEN = {scheme: LISTEN_BYTES[scheme] for scheme in ("tcp-listen", "memory")}


@dataclass(frozen=True, slots=True)
class ServedBoard:
    """Board that is being served."""

    address: str
    """URL with which a client connects to the board."""
    aclose: Callable[[], Awaitable[None]]


class Watcher(NamedTuple):
    """Callbacks for events while a board is served."""

    say: Callable[[str], None]
    """Receives one line for each connection that ends with an error."""
    fail: Callable[[BaseException], None]
    """Receives the reason why the board can no longer be served."""


def board_wire(url: str, profile: BoardClientProfile) -> tuple[str, BoardClientProfile]:
    """Split a board URL into its byte wire and a profile with the options of the URL. Raises ConfigError if the URL
    is invalid.
    """
    try:
        parts = urlsplit(url)
    except ValueError as error:
        raise ConfigError(f"{url!r}: {error}") from error
    options = parse_qsl(parts.query, keep_blank_values=True)
    filters = [text for key, text in options if key == "filter"]
    if len(filters) > 1:
        raise ConfigError(f"{url!r}: option 'filter' is given twice")
    for text in filters:
        if not (text.isascii() and text.isdigit()):
            raise ConfigError(f"{url!r}: filter must be a whole number, got {text!r}")
        try:
            profile = replace(profile, filter=int(text))
        except ValueError as error:
            raise ConfigError(f"{url!r}: {error}") from error
    if any(key == _RECONNECT for key, _ in options):
        raise ConfigError(
            f"{url!r}: {_RECONNECT} is not supported: a stream ends with its connection; remove it"
        )
    query = urlencode([(key, text) for key, text in options if key != "filter"])
    head = url.partition("?")[0]
    wire = f"{head}?{query}" if query else head
    parse_url(wire, _CONNECT, url)
    return wire, profile


async def connect_board(
    url: str, profile: BoardClientProfile, clock: Clock
) -> tuple[Transport[bytes], BoardClientProfile]:
    """Open the wire to a board, and return it together with the profile for its client.

    Raises ConfigError for an invalid URL, TransportUnavailable if the wire cannot be opened.
    """
    wire, profile = board_wire(url, profile)
    return await connect_bytes(wire, clock), profile


async def serve_board(
    url: str, registers: Registers, profile: ListenerProfile, clock: Clock, watcher: Watcher
) -> ServedBoard:
    """Serve a board's registers on a listening URL.

    Raises ConfigError for an invalid URL, TransportUnavailable if the wire cannot be opened.
    """
    wire = parse_url(url, _LISTEN)
    if wire.line is not None:
        raise ConfigError(f"{url!r}: a board's wire has no baud rate")
    if wire.scheme == "tcp-listen":
        listener = RegisterListener(registers, profile, clock, watcher.say)
        host, port = await listener.listen(*wire.host_port, url)
        address = f"[{host}]:{port}" if ":" in host else f"{host}:{port}"
        return ServedBoard(f"tcp://{address}", listener.aclose)

    def ended(cause: BaseException) -> None:
        if not isinstance(cause, TransportClosed):
            watcher.fail(cause)

    listening = await listen_bytes(wire.text, clock)
    # All clients share one wire, so there is nothing to close when a client is lost or silent.
    endpoint = RegisterServer(registers, RegisterServerProfile(idle_timeout_s=0.0), clock.now())
    pump: Pump[bytes, ConnectionOver] = Pump(
        endpoint, listening.transport, clock, lambda event: watcher.say(f"{url}: {event.text}"), ended
    )
    pump.start()
    return ServedBoard(listening.address, listening.transport.aclose)
