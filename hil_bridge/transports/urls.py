"""URLs of wires, with their options.

| connect | listen |
|---|---|
| `serial:///dev/ttyUSB0?baudrate=9600&parity=E&stopbits=1` | `pty:?baudrate=9600&parity=E&link=/tmp/robot` |
| `tcp://host:port?connect_s=30&reconnect_s=30` | `tcp-listen://127.0.0.1:0?baudrate=9600&parity=E` |
| `rfc2217://host:port?baudrate=9600&parity=E` | `rfc2217-listen://127.0.0.1:0?baudrate=9600&parity=E` |
| `memory:NAME?latency_ms=5&baudrate=9600&parity=E` | `memory:NAME?baudrate=9600&parity=E` |
| `can+memory:NAME?bitrate=1000000` | the same |
| `can+socketcan://vcan0`, `can+virtual://channel` | the same |
| `can+slcan:///dev/ttyACM0?bitrate=1000000&tty_baudrate=115200` | |
| `can+slcan+tcp://host:port?bitrate=1000000` | |
| `udp://host:port` | `udp-bind://127.0.0.1:6510?strangers=refuse` |
| `udp+memory:NAME?latency_ms=5&jitter_ms=1&loss=0.01&duplicate=0.01&reorder=0.01&seed=7` | the same, and `strangers` |

With a baud rate, a wire other than a serial port delivers bytes at the pace of a serial line. The defaults of a line
are 9600 baud, no parity and one stop bit.

The listening side's options are the settings of the emulated device's UART. The client's settings may be known, too: in
memory from its URL, on RFC 2217 from its requests, on a pseudo-terminal its baud rate only. If the two differ, the
bytes on either side are changed as by a UART. In memory, a listener without line settings is assumed to match.

Options of an emulated line:
- `damaged=drop`, `zero` or `keep`: what the device reads for a character with a parity or framing error: nothing, 00h,
  or the bits as received. Assumed: `drop`, which corresponds to a controller that ignores a wrong parity.
- `usb_latency_ms=16`: a USB adapter at the computer's end, with this latency timer.

Options of a TCP connection:
- `connect_s=30`: time for which connecting is retried, at growing intervals; by default there is one attempt.
- `reconnect_s=30`: time for which a broken connection is retried; bytes in transit are lost. By default, a broken
  connection ends the run. Time limits of the layers above continue to apply during the outage.

Datagrams: `udp` sends first, and accepts datagrams of its host and port only. `udp-bind` waits for the other side to
send first, and answers the newest sender.
- `strangers=follow` or `refuse`: a second sender becomes the peer while the first is still in use, or is refused;
  default: `follow`. It is counted in either case.
- `sender=HOST`: only this host's datagrams are accepted; others are refused and counted as strangers. Not in memory.
- `latency_ms`, `jitter_ms`: delay of every datagram, and largest additional delay.
- `loss`, `duplicate`, `reorder`: probabilities that a datagram is lost, arrives twice, or arrives after the next one.
  The faults are reproducible with the `seed`. The options of each end apply to its own path to the network, in both
  directions.

No wire is reachable from other computers unless its URL names such an address.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self
from urllib.parse import parse_qsl, unquote, urlsplit

from hil_bridge.errors import ConfigError
from hil_bridge.transports.serial.uart import Damaged, LineSettings, Parity
from protocol.can.slcan import BIT_RATE_COMMANDS

SLCAN = ("can+slcan", "can+slcan+tcp")
"""Schemes of a serial CAN adapter."""
SLCAN_BAUDRATE = 115_200
"""Default baud rate of the serial port of an slcan adapter, bit/s. Chosen: the default of python-can. Most adapters
are USB devices, which have no baud rate.
"""
SERIAL_PORTS = ("serial", "rfc2217", "rfc2217-listen")
"""Schemes whose wire is always a serial line."""


@dataclass(frozen=True, slots=True)
class WireUrl:
    """Validated URL of a wire."""

    text: str
    scheme: str
    target: str
    """Target of the wire: device, host and port, channel or name."""
    options: Mapping[str, Any]

    @property
    def name(self) -> str:
        """URL without its options, for messages."""
        return self.text.partition("?")[0]

    @property
    def line(self) -> LineSettings | None:
        """Serial line settings of the URL, or None if it contains no baud rate."""
        settings = {key: self.options[key] for key in _LINE if key in self.options}
        return LineSettings(**settings) if "baudrate" in settings or self.scheme in SERIAL_PORTS else None

    @property
    def host_port(self) -> tuple[str, int]:
        """Host and port of a TCP or UDP wire."""
        host, _, port = self.target.rpartition(":")
        return host.strip("[]"), int(port)


_DIGITS = 9
"""Maximum number of digits of an integer in a URL. Chosen: more than any rate or port has."""


def _whole(text: str) -> int:
    if not (text.isascii() and text.isdigit() and len(text) <= _DIGITS and int(text) > 0):
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


def _probability(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 <= value <= 1.0:
        raise ValueError("a probability from 0 to 1")
    return value


def _seed(text: str) -> int:
    if not (text.isascii() and text.isdigit() and len(text) <= _DIGITS):
        raise ValueError("a whole number, 0 or more")
    return int(text)


def _seconds(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 < value < math.inf:
        raise ValueError("a number of seconds above 0")
    return value


def _usb_latency(text: str) -> float:
    if not 1 <= (value := _whole(text)) <= 255:
        raise ValueError("a whole number of milliseconds from 1 to 255")
    return float(value)


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
    """Example of the address after the colon, for messages; empty if the scheme has no address."""
    options: Mapping[str, Callable[[str], Any]]


_LINE = {"baudrate": _whole, "parity": _one_of(tuple(Parity)), "stopbits": _one_of((1, 2))}
_USB = {"usb_latency_ms": _usb_latency}
_DAMAGED = {"damaged": _one_of(tuple(Damaged))}
_PATIENCE = {"connect_s": _seconds, "reconnect_s": _seconds}
_STRANGERS = {"strangers": _one_of(("follow", "refuse"))}
_NETWORK = {
    "latency_ms": _milliseconds,
    "jitter_ms": _milliseconds,
    "loss": _probability,
    "duplicate": _probability,
    "reorder": _probability,
    "seed": _seed,
}
_BITRATE = {"bitrate": _one_of(tuple(BIT_RATE_COMMANDS))}
_PORT, _NAME, _CHANNEL = "///dev/ttyUSB0", "NAME", "//vcan0"
_MEMORY_CAN = _Scheme(_NAME, {"bitrate": _whole})
_CAN_CHANNEL = _Scheme(_CHANNEL, {})

CONNECT_BYTES = {
    "serial": _Scheme(_PORT, _LINE),
    "tcp": _Scheme("//127.0.0.1:4000", _PATIENCE),
    "rfc2217": _Scheme("//127.0.0.1:4000", {**_LINE, **_PATIENCE}),
    "memory": _Scheme(_NAME, {"latency_ms": _milliseconds, **_LINE, **_USB}),
}
CONNECT_CAN = {
    "can+memory": _MEMORY_CAN,
    "can+socketcan": _CAN_CHANNEL,
    "can+virtual": _CAN_CHANNEL,
    "can+slcan": _Scheme("///dev/ttyACM0", {**_BITRATE, "tty_baudrate": _whole}),
    "can+slcan+tcp": _Scheme("//127.0.0.1:4000", _BITRATE),
}
CONNECT_DATAGRAMS = {
    "udp": _Scheme("//127.0.0.1:49152", {}),
    "udp+memory": _Scheme(_NAME, _NETWORK),
}
LISTEN_BYTES = {
    "pty": _Scheme("", {"link": _path, **_LINE, **_DAMAGED, **_USB}),
    "tcp-listen": _Scheme("//127.0.0.1:0", {**_LINE, **_USB}),
    "rfc2217-listen": _Scheme("//127.0.0.1:0", {**_LINE, **_DAMAGED, **_USB}),
    "memory": _Scheme(_NAME, {**_LINE, **_DAMAGED}),
}
LISTEN_CAN = {
    "can+memory": _MEMORY_CAN,
    "can+socketcan": _CAN_CHANNEL,
    "can+virtual": _CAN_CHANNEL,
}
LISTEN_DATAGRAMS = {
    "udp-bind": _Scheme("//127.0.0.1:6510", {**_STRANGERS, "sender": str}),
    "udp+memory": _Scheme(_NAME, {**_NETWORK, **_STRANGERS}),
}


HOST_PORTS = {
    "tcp": 1,
    "rfc2217": 1,
    "can+slcan+tcp": 1,
    "udp": 1,
    "tcp-listen": 0,
    "rfc2217-listen": 0,
    "udp-bind": 0,
}
"""Schemes whose target is a host with a port, with the lowest valid port; 0 lets the operating system choose a port."""


class UnknownScheme(ConfigError):
    """URL whose scheme is missing, or is not allowed for its device."""

    url, scheme = "", ""
    schemes: Mapping[str, _Scheme] = {}

    @classmethod
    def in_url(cls, url: str, scheme: str, schemes: Mapping[str, _Scheme], kind: str = "") -> Self:
        """Return the error. `kind` is the kind of the device if `url` does not contain it."""
        prefix = f"{kind}+" if kind else ""
        example = next(f"{name}:{one.target}" for name, one in schemes.items() if one.target)
        problem = f"unknown scheme {scheme!r}" if scheme else "the scheme is missing"
        error = cls(
            f"{prefix + url!r}: {problem}; allowed: {', '.join(schemes)}; for example {prefix}{example}"
        )
        error.url, error.scheme, error.schemes = url, scheme, schemes
        return error


@contextmanager
def naming_kind(kind: str) -> Iterator[None]:
    """Name the kind of the device in the error for an unknown scheme of its URL."""
    try:
        yield
    except UnknownScheme as error:
        raise UnknownScheme.in_url(error.url, error.scheme, error.schemes, kind) from error


def parse_url(url: str, schemes: Mapping[str, _Scheme], given: str = "") -> WireUrl:
    """Parse a URL according to one of the tables above. Raises ConfigError that names the invalid part.

    `given` is the URL of the user if `url` was derived from it.
    """
    named = given or url
    if not unquote(url).isprintable():
        raise ConfigError(f"{named!r}: a URL must not contain unprintable characters")
    try:
        parts = urlsplit(url)
    except ValueError as error:
        raise ConfigError(f"{named!r}: {error}") from error
    scheme = schemes.get(parts.scheme)
    if scheme is None:
        raise UnknownScheme.in_url(named, parts.scheme, schemes)
    target = unquote(parts.netloc + parts.path)
    if not scheme.target and target:
        raise ConfigError(f"{named!r}: nothing is allowed between {parts.scheme}: and ?, got {target!r}")
    if scheme.target and not target:
        raise ConfigError(f"{named!r}: the target is missing; for example {parts.scheme}:{scheme.target}")
    if parts.fragment:
        raise ConfigError(f"{named!r}: the part after # is not supported; remove it")
    if parts.scheme in HOST_PORTS:
        _check_host_port(named, target, HOST_PORTS[parts.scheme])
    options: dict[str, Any] = {}
    for key, text in parse_qsl(parts.query, keep_blank_values=True):
        parse = scheme.options.get(key)
        if parse is None:
            allowed = ", ".join(scheme.options) or "none"
            raise ConfigError(f"{named!r}: unknown option {key!r}; allowed: {allowed}")
        if key in options:
            raise ConfigError(f"{named!r}: option {key!r} is given twice")
        try:
            options[key] = parse(text)
        except ValueError as error:
            raise ConfigError(f"{named!r}: {key} must be {error}, got {text!r}") from error
    if parts.scheme not in SERIAL_PORTS and "baudrate" in scheme.options and "baudrate" not in options:
        for key in ("parity", "stopbits", "damaged"):
            if key in options:
                raise ConfigError(f"{named!r}: {key} needs a baudrate")
    return WireUrl(url, parts.scheme, target, options)


def split_option(url: str, name: str) -> tuple[str, str | None]:
    """Split off an option of a URL. Return the URL without the option, and the text of the option or None.

    Raises ConfigError if the option is given twice.
    """
    head, _, query = url.partition("?")
    options = [option for option in query.split("&") if option]
    named = [option for option in options if option.partition("=")[0] == name]
    if len(named) > 1:
        raise ConfigError(f"{url!r}: option {name!r} is given twice")
    if not named:
        return url, None
    options.remove(named[0])
    return (f"{head}?{'&'.join(options)}" if options else head), named[0].partition("=")[2]


def with_option(url: str, name: str, text: str) -> str:
    """Return the URL with an additional option."""
    return f"{url}{'&' if '?' in url else '?'}{name}={text}"


def with_line(url: str, line: LineSettings) -> str:
    """Return the URL with those of the line settings that it does not contain yet."""
    head, _, query = url.partition("?")
    options = [option for option in query.split("&") if option]
    named = {option.partition("=")[0] for option in options}
    values = {"baudrate": line.baudrate, "parity": line.parity.value, "stopbits": line.stopbits}
    options += (f"{key}={value}" for key, value in values.items() if key not in named)
    return f"{head}?{'&'.join(options)}"


def with_baudrate(url: str, baudrate: int, schemes: Mapping[str, _Scheme]) -> str:
    """Return the URL with a device's default baud rate, bit/s, if the URL contains none and its wire can have one."""
    scheme = schemes.get(url.partition(":")[0])
    if scheme is None or "baudrate" not in scheme.options or split_option(url, "baudrate")[1] is not None:
        return url
    return with_option(url, "baudrate", str(baudrate))


def _check_host_port(url: str, target: str, lowest: int) -> None:
    host, _, port = target.rpartition(":")
    numeric = port.isascii() and port.isdigit() and len(port) <= _DIGITS
    if not host or not (numeric and lowest <= int(port) <= 65535):
        raise ConfigError(f"{url!r}: host and port must be such as 127.0.0.1:4000, got {target!r}")
