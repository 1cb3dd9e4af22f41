"""Wires by URL: what may be written, and what it opens.

| connect | listen |
|---|---|
| `serial:///dev/ttyUSB0?baudrate=9600&parity=E&stopbits=1` | `pty:?baudrate=9600&parity=E&link=/tmp/robot` |
| `tcp://host:port` | `tcp-listen://127.0.0.1:0?baudrate=9600&parity=E` |
| `memory:NAME?latency_ms=5&baudrate=9600&parity=E` | `memory:NAME` |
| `can+memory:NAME?bitrate=1000000` | the same |
| `can+socketcan://vcan0`, `can+virtual://channel` | the same |
| `can+slcan:///dev/ttyACM0?bitrate=1000000&tty_baudrate=115200` | |

A baud rate on a wire that is no serial port means that bytes are paced as on such a line. Without more said a
line has 9600 baud, no parity and one stop bit.

pyserial and python-can take their time to import, so that only a wire of theirs imports them.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import parse_qsl, unquote, urlsplit

from hil_bridge.clock import Clock
from hil_bridge.errors import ConfigError
from hil_bridge.transports.base import Frames, Transport
from hil_bridge.transports.line import Paced
from hil_bridge.transports.listening import Listening
from hil_bridge.transports.memory import connect_memory, listen_memory
from hil_bridge.transports.memory_can import join_memory_can
from hil_bridge.transports.pseudo_terminal import PseudoTerminal
from hil_bridge.transports.tcp import connect_tcp, listen_tcp
from hil_bridge.transports.uart import LineSettings, Parity
from protocol.can import CanFilter

SLCAN_BITRATES = (10_000, 20_000, 50_000, 83_300, 100_000, 125_000, 250_000, 500_000, 750_000, 1_000_000)
"""Bit rates for which the slcan protocol has a command."""


@dataclass(frozen=True, slots=True)
class WireUrl:
    """A URL that was found in order."""

    text: str
    scheme: str
    target: str
    """Device, host and port, channel or name."""
    options: Mapping[str, Any]

    @property
    def line(self) -> LineSettings | None:
        """The serial line it speaks of, or None when it does not name a baud rate."""
        settings = {key: self.options[key] for key in _LINE if key in self.options}
        return LineSettings(**settings) if "baudrate" in settings or self.scheme == "serial" else None

    @property
    def host_port(self) -> tuple[str, int]:
        """Host and port of a TCP wire."""
        host, _, port = self.target.rpartition(":")
        return host.strip("[]"), int(port)


def _whole(text: str) -> int:
    if not (text.isascii() and text.isdigit() and int(text) > 0):
        raise ValueError("a whole number above 0")
    return int(text)


def _milliseconds(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 <= value < math.inf:
        raise ValueError("a number of milliseconds, 0 or more")
    return value


def _one_of(choices: tuple[Any, ...]) -> Callable[[str], Any]:
    by_text = {str(choice): choice for choice in choices}

    def parse(text: str) -> Any:
        if text not in by_text:
            raise ValueError(f"one of {', '.join(by_text)}")
        return by_text[text]

    return parse


def _path(text: str) -> Path:
    if not text.startswith("/"):
        raise ValueError("an absolute path")
    return Path(text)


@dataclass(frozen=True, slots=True)
class _Scheme:
    target: str
    """What comes after the colon, as an example for messages; empty when nothing may."""
    options: Mapping[str, Callable[[str], Any]]


_LINE = {"baudrate": _whole, "parity": _one_of(tuple(Parity)), "stopbits": _one_of((1, 2))}
_PORT, _NAME, _CHANNEL = "///dev/ttyUSB0", "NAME", "//vcan0"
_MEMORY_CAN = _Scheme(_NAME, {"bitrate": _whole})
_CAN_CHANNEL = _Scheme(_CHANNEL, {})

CONNECT_BYTES = {
    "serial": _Scheme(_PORT, _LINE),
    "tcp": _Scheme("//127.0.0.1:4000", {}),
    "memory": _Scheme(_NAME, {"latency_ms": _milliseconds, **_LINE}),
}
CONNECT_CAN = {
    "can+memory": _MEMORY_CAN,
    "can+socketcan": _CAN_CHANNEL,
    "can+virtual": _CAN_CHANNEL,
    "can+slcan": _Scheme("///dev/ttyACM0", {"bitrate": _one_of(SLCAN_BITRATES), "tty_baudrate": _whole}),
}
LISTEN_BYTES = {
    "pty": _Scheme("", {"link": _path, **_LINE}),
    "tcp-listen": _Scheme("//127.0.0.1:0", _LINE),
    "memory": _Scheme(_NAME, {}),
}
LISTEN_CAN = {
    "can+memory": _MEMORY_CAN,
    "can+socketcan": _CAN_CHANNEL,
    "can+virtual": _CAN_CHANNEL,
}


def parse_url(url: str, schemes: Mapping[str, _Scheme]) -> WireUrl:
    """Check a URL against one of the tables above. Raises ConfigError naming the part that is wrong."""
    try:
        parts = urlsplit(url)
    except ValueError as error:
        raise ConfigError(f"{url!r}: {error}") from error
    scheme = schemes.get(parts.scheme)
    if scheme is None:
        example = next(f"{name}:{scheme.target}" for name, scheme in schemes.items() if scheme.target)
        raise ConfigError(
            f"{url!r}: unknown scheme {parts.scheme!r}; allowed: {', '.join(schemes)}; for example {example}"
        )
    target = unquote(parts.netloc + parts.path)
    if not scheme.target and target:
        raise ConfigError(f"{url!r}: nothing may stand between {parts.scheme}: and ?, got {target!r}")
    if scheme.target and not target:
        raise ConfigError(f"{url!r}: the target is missing; for example {parts.scheme}:{scheme.target}")
    if parts.fragment:
        raise ConfigError(f"{url!r}: the part after # means nothing here")
    if parts.scheme in ("tcp", "tcp-listen"):
        _check_host_port(url, target, 0 if parts.scheme == "tcp-listen" else 1)
    options: dict[str, Any] = {}
    for key, text in parse_qsl(parts.query, keep_blank_values=True):
        parse = scheme.options.get(key)
        if parse is None:
            allowed = ", ".join(scheme.options) or "none"
            raise ConfigError(f"{url!r}: unknown option {key!r}; allowed: {allowed}")
        if key in options:
            raise ConfigError(f"{url!r}: option {key!r} is given twice")
        try:
            options[key] = parse(text)
        except ValueError as error:
            raise ConfigError(f"{url!r}: {key} must be {error}, got {text!r}") from error
    if parts.scheme != "serial" and "baudrate" in scheme.options and "baudrate" not in options:
        for key in ("parity", "stopbits"):
            if key in options:
                raise ConfigError(f"{url!r}: {key} means nothing without a baudrate")
    return WireUrl(url, parts.scheme, target, options)


def _check_host_port(url: str, target: str, lowest: int) -> None:
    host, _, port = target.rpartition(":")
    if not host or not (port.isascii() and port.isdigit() and lowest <= int(port) <= 65535):
        raise ConfigError(f"{url!r}: host and port must be like 127.0.0.1:4000, got {target!r}")


async def connect_bytes(url: str, clock: Clock) -> Transport[bytes]:
    """Open a byte wire. Raises ConfigError for the URL, TransportUnavailable for the wire."""
    parsed = parse_url(url, CONNECT_BYTES)
    line = parsed.line
    match parsed.scheme:
        case "serial":
            from hil_bridge.transports.serial_port import open_serial_port

            return await open_serial_port(parsed.target, line or LineSettings(), clock, url)
        case "tcp":
            return await connect_tcp(*parsed.host_port, clock, url)
        case _:
            latency_s = parsed.options.get("latency_ms", 0.0) / 1e3
            wire = connect_memory(parsed.target, latency_s, clock)
            return wire if line is None else Paced(wire, line, clock)


async def connect_can(url: str, clock: Clock, accept: Sequence[CanFilter] = ()) -> Transport[Frames]:
    """Open a CAN wire that receives what one of the filters accepts; everything without filters.

    What is wrong on the bus arrives in band, as error frames that `protocol.can_error` reads. Raises ConfigError
    for the URL, TransportUnavailable for the wire.
    """
    return await _open_can(parse_url(url, CONNECT_CAN), clock, accept)


async def listen_bytes(url: str, clock: Clock) -> Listening[bytes]:
    """Open the other side of a byte wire.

    Raises ConfigError for the URL, TransportUnavailable for the wire.
    """
    parsed = parse_url(url, LISTEN_BYTES)
    line = parsed.line
    transport: Transport[bytes]
    match parsed.scheme:
        case "pty":
            transport = terminal = PseudoTerminal(clock, parsed.options.get("link"))
            query = "" if line is None else _line_query(line)
            address = f"serial://{terminal.device}{query}"
        case "tcp-listen":
            transport, host, port = await listen_tcp(*parsed.host_port, clock, url)
            address = f"tcp://[{host}]:{port}" if ":" in host else f"tcp://{host}:{port}"
        case _:
            transport = listen_memory(parsed.target, clock)
            address = f"memory:{parsed.target}"
    return Listening(transport if line is None else Paced(transport, line, clock), address)


async def listen_can(url: str, clock: Clock, accept: Sequence[CanFilter] = ()) -> Listening[Frames]:
    """Open the other side of a CAN wire; all nodes are alike, so the address is the URL itself.

    As `connect_can`. Raises ConfigError for the URL, TransportUnavailable for the wire.
    """
    return Listening(await _open_can(parse_url(url, LISTEN_CAN), clock, accept), url)


async def _open_can(parsed: WireUrl, clock: Clock, accept: Sequence[CanFilter]) -> Transport[Frames]:
    if parsed.scheme == "can+memory":
        return join_memory_can(parsed.target, parsed.options.get("bitrate"), clock, accept)
    from hil_bridge.transports.python_can import open_python_can

    interface = parsed.scheme.removeprefix("can+")
    return await open_python_can(interface, parsed.target, clock, parsed.text, accept, **parsed.options)


def _line_query(line: LineSettings) -> str:
    return f"?baudrate={line.baudrate}&parity={line.parity.value}&stopbits={line.stopbits}"
