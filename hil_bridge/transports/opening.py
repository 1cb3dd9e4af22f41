"""Opening of wires by URL: the connecting side and the listening side of byte wires, CAN buses and datagram wires.

Importing pyserial and python-can is slow, so they are imported only for wires that need them.
"""

import logging
from collections.abc import Sequence
from functools import partial
from typing import Any

from hil_bridge.clock import Clock
from hil_bridge.transports.back_off import Notice, Reconnecting, persistent
from hil_bridge.transports.base import Frames, Transport
from hil_bridge.transports.can.memory import join_memory_can
from hil_bridge.transports.can.slcan import SlcanWire
from hil_bridge.transports.datagram import DatagramWire, Path, Peer, connect_udp, listen_udp
from hil_bridge.transports.datagram import connect_memory as connect_memory_datagrams
from hil_bridge.transports.datagram import listen_memory as listen_memory_datagrams
from hil_bridge.transports.listening import Listening
from hil_bridge.transports.memory import connect_memory, listen_memory
from hil_bridge.transports.serial.line import FIFO, LineNotices, PacedLine, Uart
from hil_bridge.transports.serial.pseudo_terminal import PseudoTerminal
from hil_bridge.transports.serial.uart import Damaged, LineSettings
from hil_bridge.transports.serial.usb_adapter import UsbAdapter, UsbAdapterProfile
from hil_bridge.transports.tcp import connect_tcp, listen_tcp
from hil_bridge.transports.urls import (
    CONNECT_BYTES,
    CONNECT_CAN,
    CONNECT_DATAGRAMS,
    HOST_PORTS,
    LISTEN_BYTES,
    LISTEN_CAN,
    LISTEN_DATAGRAMS,
    SLCAN,
    SLCAN_BAUDRATE,
    WireUrl,
    parse_url,
    with_line,
)
from hil_bridge.transports.wrappers import Direction
from protocol.can.frame import CanFilter

_LOG = logging.getLogger(__name__)


def _log(kind: str, text: str) -> None:
    _LOG.info("%s: %s", kind, text)


async def connect_bytes(url: str, clock: Clock, on_notice: Notice = _log) -> Transport[bytes]:
    """Open a byte wire. Raises ConfigError for an invalid URL, TransportUnavailable if the wire cannot be opened.

    `on_notice(kind, text)` receives damaged characters and lost connections.
    """
    parsed = parse_url(url, CONNECT_BYTES)
    match parsed.scheme:
        case "serial":
            from hil_bridge.transports.serial.serial_port import open_serial_port

            return await open_serial_port(parsed.target, parsed.line or LineSettings(), clock, parsed.name)
        case "memory":
            return _connect_memory(parsed, clock, on_notice)
        case _:
            connect = partial(_connect_host, parsed, clock, on_notice)
            wire = await persistent(connect, parsed.options.get("connect_s", 0.0), clock)
            patience_s = parsed.options.get("reconnect_s")
            return wire if patience_s is None else Reconnecting(wire, connect, patience_s, clock, on_notice)


def _connect_memory(parsed: WireUrl, clock: Clock, on_notice: Notice) -> Transport[bytes]:
    latency_s = parsed.options.get("latency_ms", 0.0) / 1e3
    line = parsed.line
    wire, far = connect_memory(parsed.target, latency_s, clock, line is not None)
    if line is None and far is not None:
        line = far.settings()
    if line is None:
        return _with_adapter(wire, parsed, clock, Direction.RECEIVED)
    notices = LineNotices(parsed.name, line, clock, on_notice)
    paced = PacedLine(wire, Uart(lambda: line, on_flaw=notices), clock, _fifo(parsed), far)
    return _with_adapter(paced, parsed, clock, Direction.RECEIVED)


async def _connect_host(parsed: WireUrl, clock: Clock, on_notice: Notice) -> Transport[bytes]:
    wire = await connect_tcp(*parsed.host_port, clock, parsed.name)
    if parsed.scheme == "tcp":
        return wire
    from hil_bridge.transports.serial.rfc2217 import Rfc2217Client

    client = Rfc2217Client(wire, parsed.line or LineSettings(), clock, on_notice)
    await client.ready()
    return client


async def connect_can(url: str, clock: Clock, accept: Sequence[CanFilter] = ()) -> Transport[Frames]:
    """Open a CAN wire that receives the frames that match one of the filters, or all frames if there are no
    filters.

    Errors on the bus arrive in band, as error frames that `protocol.can.error` decodes. Raises ConfigError for an
    invalid URL, TransportUnavailable if the wire cannot be opened.
    """
    return await _open_can(parse_url(url, CONNECT_CAN), clock, accept)


async def listen_bytes(url: str, clock: Clock) -> Listening[Transport[bytes]]:
    """Open the other side of a byte wire.

    Raises ConfigError for an invalid URL, TransportUnavailable if the wire cannot be opened.
    """
    parsed = parse_url(url, LISTEN_BYTES)
    line = parsed.line
    match parsed.scheme:
        case "pty":
            return _listen_pty(parsed, clock)
        case "tcp-listen":
            wire, host, port = await listen_tcp(*parsed.host_port, clock, parsed.name)
            return Listening(
                wire if line is None else _device_line(wire, parsed, line, clock, None),
                f"tcp://{_authority(host, port)}",
            )
        case "rfc2217-listen":
            return await _listen_rfc2217(parsed, line or LineSettings(), clock)
        case _:
            # the client's side holds the emulated line, and the client names its baud rate
            end = None if line is None else Uart(lambda: line, _damaged(parsed))
            return Listening(listen_memory(parsed.target, clock, end), f"memory:{parsed.target}")


def _listen_pty(parsed: WireUrl, clock: Clock) -> Listening[Transport[bytes]]:
    line = parsed.line
    terminal = PseudoTerminal(clock, parsed.options.get("link"), line)
    address = f"serial://{terminal.device}"
    if line is None:
        return Listening(terminal, address)

    def client() -> LineSettings:
        rate = terminal.baudrate
        return line if rate in (None, line.baudrate) else LineSettings(rate, line.parity, line.stopbits)

    return Listening(_device_line(terminal, parsed, line, clock, Uart(client)), with_line(address, line))


async def _listen_rfc2217(parsed: WireUrl, line: LineSettings, clock: Clock) -> Listening[Transport[bytes]]:
    from hil_bridge.transports.serial.rfc2217 import Rfc2217Port

    port = Rfc2217Port(line, clock)
    wire, host, number = await listen_tcp(*parsed.host_port, clock, parsed.name, port.serve)
    paced = _device_line(wire, parsed, line, clock, Uart(lambda: port.settings, on_flaw=port.flawed))
    port.on_break = partial(paced.hold, direction=Direction.RECEIVED)
    return Listening(paced, with_line(f"rfc2217://{_authority(host, number)}", line))


def _device_line(
    wire: Transport[bytes], parsed: WireUrl, line: LineSettings, clock: Clock, far: Uart | None
) -> PacedLine:
    """Return the serial line between an emulated device and its client."""
    adapted = _with_adapter(wire, parsed, clock, Direction.SENT)
    return PacedLine(adapted, Uart(lambda: line, _damaged(parsed)), clock, _fifo(parsed), far)


def _with_adapter(
    wire: Transport[bytes], parsed: WireUrl, clock: Clock, to_host: Direction
) -> Transport[bytes]:
    latency_ms = parsed.options.get("usb_latency_ms")
    if latency_ms is None:
        return wire
    return UsbAdapter(wire, UsbAdapterProfile(latency_s=latency_ms / 1e3), clock, to_host)


def _fifo(parsed: WireUrl) -> int:
    """Return the FIFO size. A USB adapter reads every character on arrival."""
    return 1 if "usb_latency_ms" in parsed.options else FIFO


def _damaged(parsed: WireUrl) -> Damaged:
    damaged: Damaged = parsed.options.get("damaged", Damaged.DROP)
    return damaged


def _authority(host: str, port: int) -> str:
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


async def listen_can(
    url: str, clock: Clock, accept: Sequence[CanFilter] = ()
) -> Listening[Transport[Frames]]:
    """Open the other side of a CAN wire. All nodes are equal, so the address is the URL itself.

    Filters and errors are as for `connect_can`. Raises ConfigError for an invalid URL, TransportUnavailable if the
    wire cannot be opened.
    """
    return Listening(await _open_can(parse_url(url, LISTEN_CAN), clock, accept), url)


async def _open_can(parsed: WireUrl, clock: Clock, accept: Sequence[CanFilter]) -> Transport[Frames]:
    if parsed.scheme == "can+memory":
        return join_memory_can(parsed.target, parsed.options.get("bitrate"), clock, accept)
    if parsed.scheme in SLCAN:
        return SlcanWire(await _adapter_line(parsed, clock), parsed.options.get("bitrate"), clock, accept)
    from hil_bridge.transports.can.python_can import open_python_can

    return await open_python_can(parsed, clock, accept)


async def _adapter_line(parsed: WireUrl, clock: Clock) -> Transport[bytes]:
    """Open the byte wire to an slcan adapter."""
    if parsed.scheme in HOST_PORTS:
        return await connect_tcp(*parsed.host_port, clock, parsed.name)
    from hil_bridge.transports.serial.serial_port import open_serial_port

    line = LineSettings(parsed.options.get("tty_baudrate", SLCAN_BAUDRATE))
    return await open_serial_port(parsed.target, line, clock, parsed.name)


async def connect_datagrams(url: str, clock: Clock, on_notice: Notice = _log) -> DatagramWire:
    """Open a datagram wire on which this side sends first. The other side may appear later.

    `on_notice(kind, text)` receives strangers and an unreachable destination. Raises ConfigError for an invalid
    URL, TransportUnavailable if the wire cannot be opened.
    """
    parsed = parse_url(url, CONNECT_DATAGRAMS)
    if parsed.scheme == "udp":
        return await connect_udp(parsed.host_port, clock, parsed.name, on_notice)
    return connect_memory_datagrams(parsed.target, _path(parsed), clock, on_notice)


async def listen_datagrams(url: str, clock: Clock, on_notice: Notice = _log) -> Listening[DatagramWire]:
    """Open a datagram wire on which the other side sends first. The wire ends only when it is closed.

    Notices are as for `connect_datagrams`. Raises ConfigError for an invalid URL, TransportUnavailable if the wire
    cannot be opened.
    """
    parsed = parse_url(url, LISTEN_DATAGRAMS)
    refuse = parsed.options.get("strangers") == "refuse"
    if parsed.scheme == "udp-bind":
        peer: Peer[tuple[Any, ...]] = Peer(refuse=refuse, sender=parsed.options.get("sender", ""))
        wire, host, port = await listen_udp(parsed.host_port, clock, parsed.name, on_notice, peer)
        return Listening(wire, f"udp://{_authority(host, port)}")
    memory = listen_memory_datagrams(parsed.target, _path(parsed), clock, on_notice, refuse)
    return Listening(memory, f"udp+memory:{parsed.target}")


def _path(parsed: WireUrl) -> Path:
    options = parsed.options
    times = {f"{key}_s": options.get(f"{key}_ms", 0.0) / 1e3 for key in ("latency", "jitter")}
    chances = {key: options[key] for key in ("loss", "duplicate", "reorder", "seed") if key in options}
    return Path(**times, **chances)
