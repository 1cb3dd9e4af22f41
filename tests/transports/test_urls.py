"""URLs: valid ones, and messages on invalid ones."""

import asyncio
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import pytest

from hil_bridge.clock import Clock, run_virtual
from hil_bridge.devices.sensors.jr3.room import slcan_address
from hil_bridge.errors import ConfigError, TransportUnavailable
from hil_bridge.runs.compose import emulated_cell
from hil_bridge.runs.setup import Listen, Setup
from hil_bridge.settings.configuration import load_config
from hil_bridge.transports import (
    LineSettings,
    Parity,
    connect_bytes,
    connect_can,
    connect_datagrams,
    listen_bytes,
    listen_can,
    listen_datagrams,
)
from hil_bridge.transports.urls import (
    CONNECT_BYTES,
    CONNECT_CAN,
    CONNECT_DATAGRAMS,
    LISTEN_BYTES,
    LISTEN_DATAGRAMS,
    parse_url,
    with_line,
)

UNDERSTOOD = [
    (
        CONNECT_BYTES,
        "serial:///dev/ttyUSB0?baudrate=19200&parity=E&stopbits=2",
        "/dev/ttyUSB0",
        LineSettings(19200, Parity.EVEN, 2),
    ),
    (CONNECT_BYTES, "serial:///dev/ttyUSB0", "/dev/ttyUSB0", LineSettings(9600, Parity.NONE, 1)),
    (CONNECT_BYTES, "serial:///dev/ttyUSB0?parity=O", "/dev/ttyUSB0", LineSettings(9600, Parity.ODD, 1)),
    (CONNECT_BYTES, "tcp://192.168.0.5:4001", "192.168.0.5:4001", None),
    (CONNECT_BYTES, "memory:robot", "robot", None),
    (CONNECT_BYTES, "memory:robot?baudrate=9600&parity=E", "robot", LineSettings(9600, Parity.EVEN)),
    (LISTEN_BYTES, "pty:", "", None),
    (LISTEN_BYTES, "pty:?baudrate=9600&parity=E", "", LineSettings(9600, Parity.EVEN)),
    (LISTEN_BYTES, "tcp-listen://127.0.0.1:0?baudrate=300", "127.0.0.1:0", LineSettings(300)),
    (LISTEN_BYTES, "memory:a?baudrate=300&parity=O", "a", LineSettings(300, Parity.ODD)),
    (LISTEN_BYTES, "rfc2217-listen://127.0.0.1:0", "127.0.0.1:0", LineSettings()),
    (CONNECT_BYTES, "rfc2217://127.0.0.1:7?parity=E", "127.0.0.1:7", LineSettings(9600, Parity.EVEN)),
    (CONNECT_CAN, "can+socketcan://vcan0", "vcan0", None),
    (CONNECT_CAN, "can+slcan:///dev/ttyACM0?bitrate=1000000&tty_baudrate=115200", "/dev/ttyACM0", None),
    (CONNECT_DATAGRAMS, "udp://192.168.1.1:49152", "192.168.1.1:49152", None),
    (LISTEN_DATAGRAMS, "udp-bind://0.0.0.0:6510?strangers=refuse", "0.0.0.0:6510", None),
    (LISTEN_DATAGRAMS, "udp-bind://[::1]:0", "[::1]:0", None),
    (CONNECT_DATAGRAMS, "udp+memory:robot", "robot", None),
]


@pytest.mark.parametrize(("schemes", "url", "target", "line"), UNDERSTOOD, ids=[row[1] for row in UNDERSTOOD])
def test_url_valid_is_parsed(schemes: Any, url: str, target: str, line: LineSettings | None) -> None:
    parsed = parse_url(url, schemes)
    assert (parsed.target, parsed.line, parsed.text) == (target, line, url)


@pytest.mark.parametrize(
    ("url", "expected"),
    [
        ("serial:///dev/x", "serial:///dev/x?baudrate=300&parity=E&stopbits=1"),
        ("serial:///dev/x?parity=N", "serial:///dev/x?parity=N&baudrate=300&stopbits=1"),
        ("rfc2217://h:1?reconnect_s=5", "rfc2217://h:1?reconnect_s=5&baudrate=300&parity=E&stopbits=1"),
    ],
)
def test_url_line_settings_have_defaults(url: str, expected: str) -> None:
    assert with_line(url, LineSettings(300, Parity.EVEN)) == expected


def test_url_options_have_types() -> None:
    assert parse_url("pty:?link=/tmp/robot", LISTEN_BYTES).options == {"link": Path("/tmp/robot")}
    assert parse_url("memory:a?latency_ms=0.5", CONNECT_BYTES).options == {"latency_ms": 0.5}
    assert parse_url("can+slcan:///dev/x?bitrate=500000", CONNECT_CAN).options == {"bitrate": 500_000}
    assert parse_url("tcp://[::1]:80", CONNECT_BYTES).host_port == ("::1", 80)
    url = "udp+memory:a?latency_ms=5&jitter_ms=0.5&loss=0.01&duplicate=0&reorder=1&seed=0"
    assert parse_url(url, CONNECT_DATAGRAMS).options == {
        "latency_ms": 5.0,
        "jitter_ms": 0.5,
        "loss": 0.01,
        "duplicate": 0.0,
        "reorder": 1.0,
        "seed": 0,
    }


REFUSED = [
    (connect_bytes, "", "the scheme is missing; allowed: serial, tcp, rfc2217, memory"),
    (connect_bytes, "/dev/ttyUSB0", "the scheme is missing; allowed: serial"),
    (connect_bytes, "usb:///dev/ttyUSB0", "unknown scheme 'usb'; allowed: serial, tcp, rfc2217, memory"),
    (connect_bytes, "serial://?baudrate=9600", "target is missing; for example serial:///dev/ttyUSB0"),
    (
        connect_bytes,
        "serial:///dev/x?baud=9600",
        "unknown option 'baud'; allowed: baudrate, parity, stopbits",
    ),
    (connect_bytes, "serial:///dev/x?baudrate=fast", "baudrate must be a whole number above 0, got 'fast'"),
    (connect_bytes, "serial:///dev/x?baudrate=0", "baudrate must be a whole number above 0"),
    (connect_bytes, "serial:///dev/x?baudrate=²", "baudrate must be a whole number above 0"),
    (connect_bytes, "serial:///dev/x?baudrate=", "baudrate must be a whole number above 0"),
    (connect_bytes, "serial:///dev/x?parity=even", "parity must be one of N, E, O, got 'even'"),
    (connect_bytes, "serial:///dev/x?stopbits=1.5", "stopbits must be one of 1, 2"),
    (connect_bytes, "serial:///dev/x?parity=E&parity=N", "'parity' is given twice"),
    (connect_bytes, "serial:///dev/x#1", "after #"),
    (connect_bytes, "memory:a?latency_ms=-1", "latency_ms must be a number of milliseconds, 0 or more"),
    (connect_bytes, "memory:a?latency_ms=nan", "latency_ms must be"),
    (connect_bytes, "memory:a?parity=E", "parity needs a baudrate"),
    (connect_bytes, "tcp://localhost", "host and port must be such as 127.0.0.1:4000"),
    (connect_bytes, "tcp://localhost:0", "host and port"),
    (connect_bytes, "tcp://localhost:99999", "host and port"),
    (connect_bytes, "tcp://[::1:4000", "Invalid IPv6"),
    (connect_can, "can+vector://0", "allowed: can+memory, can+socketcan, can+virtual, can+slcan"),
    (connect_can, "can+slcan:///dev/x?bitrate=123", "bitrate must be one of 10000, 20000"),
    (connect_can, "can+slcan+tcp://localhost", "host and port must be such as 127.0.0.1:4000"),
    (
        connect_can,
        "can+slcan+tcp://localhost:1?tty_baudrate=9600",
        "unknown option 'tty_baudrate'; allowed: bitrate",
    ),
    (connect_can, "can+socketcan://can0?bitrate=1", "unknown option 'bitrate'; allowed: none"),
    (listen_bytes, "pty:///dev/x", "nothing is allowed between"),
    (listen_bytes, "pty:?link=robot", "link must be an absolute path"),
    (listen_bytes, "memory:a?latency_ms=1", "allowed: baudrate, parity, stopbits, damaged"),
    (listen_bytes, "memory:a?damaged=drop", "damaged needs a baudrate"),
    (listen_bytes, "pty:?baudrate=9600&damaged=maybe", "damaged must be one of keep, zero, drop"),
    (listen_bytes, "pty:?usb_latency_ms=0", "usb_latency_ms must be a whole number above 0"),
    (
        listen_bytes,
        "pty:?usb_latency_ms=256",
        "usb_latency_ms must be a whole number of milliseconds from 1 to",
    ),
    (listen_bytes, "tcp-listen://:4000", "host and port must be such as 127.0.0.1:4000"),
    (listen_bytes, "tcp-listen:4000", "host and port must be such as 127.0.0.1:4000"),
    (listen_bytes, "rfc2217-listen://:4000", "host and port must be such as 127.0.0.1:4000"),
    (connect_bytes, "rfc2217://127.0.0.1:0", "host and port must be such as 127.0.0.1:4000"),
    (connect_bytes, "tcp://127.0.0.1:4000?connect_s=0", "connect_s must be a number of seconds above 0"),
    (connect_bytes, "tcp://127.0.0.1:4000?reconnect_s=for ever", "reconnect_s must be a number of seconds"),
    (connect_bytes, "tcp://127.0.0.1:4000?reconnect_s=inf", "reconnect_s must be a number of seconds"),
    (
        listen_bytes,
        "serial:///dev/x",
        "unknown scheme 'serial'; allowed: pty, tcp-listen, rfc2217-listen, memory",
    ),
    (listen_can, "can+slcan:///dev/x", "unknown scheme"),
    (
        connect_datagrams,
        "tcp://127.0.0.1:1",
        "unknown scheme 'tcp'; allowed: udp, udp+memory; for example udp://127",
    ),
    (connect_datagrams, "udp-bind://127.0.0.1:1", "unknown scheme 'udp-bind'; allowed: udp, udp+memory"),
    (connect_datagrams, "udp://127.0.0.1:0", "host and port must be such as 127.0.0.1:4000"),
    (connect_datagrams, "udp://:6510", "host and port must be such as 127.0.0.1:4000"),
    (connect_datagrams, "udp://127.0.0.1:1?loss=0.1", "unknown option 'loss'; allowed: none"),
    (connect_datagrams, "udp+memory:", "the target is missing; for example udp+memory:NAME"),
    (connect_datagrams, "udp+memory:a?strangers=refuse", "allowed: latency_ms, jitter_ms, loss, duplicate"),
    (connect_datagrams, "udp+memory:a?loss=1.1", "loss must be a probability from 0 to 1, got '1.1'"),
    (connect_datagrams, "udp+memory:a?reorder=nan", "reorder must be a probability from 0 to 1, got 'nan'"),
    (connect_datagrams, "udp+memory:a?duplicate=often", "duplicate must be a probability from 0 to 1"),
    (connect_datagrams, "udp+memory:a?jitter_ms=-1", "jitter_ms must be a number of milliseconds, 0 or more"),
    (connect_datagrams, "udp+memory:a?seed=-1", "seed must be a whole number, 0 or more, got '-1'"),
    (connect_datagrams, "udp+memory:a?seed=1&seed=2", "'seed' is given twice"),
    (listen_datagrams, "udp://127.0.0.1:1", "unknown scheme 'udp'; allowed: udp-bind, udp+memory"),
    (listen_datagrams, "udp-bind://:6510", "host and port must be such as 127.0.0.1:4000"),
    (listen_datagrams, "udp-bind:6510", "host and port must be such as 127.0.0.1:4000"),
    (listen_datagrams, "udp-bind://127.0.0.1:65536", "host and port must be such as 127.0.0.1:4000"),
    (
        listen_datagrams,
        "udp-bind://h:1?strangers=maybe",
        "strangers must be one of follow, refuse, got 'maybe'",
    ),
]


@pytest.mark.parametrize(("open_wire", "url", "message"), REFUSED, ids=[row[1] for row in REFUSED])
def test_url_invalid_is_refused(open_wire: Callable[..., Awaitable[object]], url: str, message: str) -> None:
    async def main() -> None:
        with pytest.raises(ConfigError) as caught:
            await open_wire(url, Clock.running())
        assert message in str(caught.value)
        assert repr(url) in str(caught.value)

    run_virtual(main)


@pytest.mark.parametrize(
    ("open_wire", "url"),
    [
        (connect_bytes, "serial:///dev/nowhere?baudrate=9600&parity=E"),
        (connect_bytes, "tcp://127.0.0.1:1?connect_s=0.001"),
        (connect_can, "can+slcan:///dev/nowhere?bitrate=1000000"),
    ],
)
def test_url_in_messages_has_no_options(open_wire: Callable[..., Awaitable[object]], url: str) -> None:
    async def main() -> None:
        with pytest.raises(TransportUnavailable) as caught:
            await open_wire(url, Clock.running())
        name, _, _ = url.partition("?")
        assert str(caught.value).startswith(f"{name}: cannot be opened: ")

    asyncio.run(main())


@pytest.mark.parametrize(
    ("port", "address"),
    [
        ("serial:///dev/pts/4", "can+slcan:///dev/pts/4?bitrate=1000000"),
        (
            "serial:///dev/pts/4?baudrate=115200&parity=N&stopbits=1",
            "can+slcan:///dev/pts/4?bitrate=1000000&tty_baudrate=115200",
        ),
    ],
)
def test_url_of_emulated_slcan_adapter_is_readable(port: str, address: str) -> None:
    assert slcan_address(port) == address
    assert parse_url(address, CONNECT_CAN).options["bitrate"] == 1_000_000


def test_url_of_slcan_adapter_is_serial_port() -> None:
    async def main() -> None:
        listen = Listen(None, "jr3+can+slcan+tcp-listen://127.0.0.1:0")
        with pytest.raises(
            ConfigError, match=r"an slcan adapter is a serial port; for example can\+slcan\+pty:"
        ):
            async with emulated_cell(
                Setup(load_config(None, {}), listen), Clock.running(), lambda cause: None
            ):
                pass

    run_virtual(main)
