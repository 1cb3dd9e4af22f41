"""Device package for the JR3: a sensor behind a CAN gateway, a UART gateway or a receiver board."""

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from emulators.devices.jr3 import Jr3Profiles, make_board, make_gateway, make_uart
from emulators.devices.jr3.faults import BOARD_FAULTS, CAN_GATEWAY_FAULTS, UART_GATEWAY_FAULTS
from emulators.seams import SensorFactory
from emulators.wires.slcan_adapter import SlcanAdapter, SlcanProfile
from hil_bridge.devices.kinds import CanBus, KindSettings, SensorEmulation, SensorKind
from hil_bridge.devices.sensors.jr3.emulator_fit import match_gateway, match_uart
from hil_bridge.devices.sensors.jr3.latency import late_settings
from hil_bridge.devices.sensors.jr3.registers import (
    ListenerProfile,
    Watcher,
    board_wire,
    connect_board,
    read_program,
    serve_board,
)
from hil_bridge.devices.sensors.jr3.settings import Jr3Settings
from hil_bridge.devices.wiring import Serving, Wiring
from hil_bridge.errors import ConfigError
from hil_bridge.transports import Transport
from hil_bridge.transports.can.slcan_device import SlcanDevice
from hil_bridge.transports.urls import CONNECT_BYTES, CONNECT_CAN, LISTEN_BYTES, WireUrl, parse_url
from protocol.devices.jr3 import (
    GATEWAY_BITRATE,
    UART_BAUDRATE,
    GatewayClient,
    UartGatewayClient,
    can_messages,
    client_filters,
    describe,
    gateway_filters,
    parse_frame,
    uart_gateway,
)
from protocol.devices.jr3.registers import BoardClient

SLCAN = "can+slcan+"
"""URL prefix that selects an emulated slcan adapter on a listening byte wire."""
_SECTION = "jr3"
"""Name of the configuration sections that all receivers share."""
_UART_BYTES = 18
"""Number of bytes in a frame on the UART gateway's line, each of which may be lost. Derived."""


# --- CAN gateway


def _check_can(url: str) -> None:
    """Raise ConfigError for a byte wire. The error names the receivers that use byte wires."""
    if not url.startswith("can+"):
        raise ConfigError(
            f"{f'jr3+{url}'!r}: a CAN gateway has no such wire; did you mean jr3-board+{url} for a receiver board, or "
            f"jr3-uart+{url} for a UART gateway?"
        )


def _parse_can(url: str) -> WireUrl:
    _check_can(url)
    return parse_url(url, CONNECT_CAN)


async def _connect_can(
    url: str, settings: KindSettings[Jr3Settings, Jr3Profiles], wiring: Wiring
) -> tuple[Transport[Any], Any]:
    _check_can(url)
    profile = settings.client.gateway
    wire = await wiring.can(url, client_filters(profile.node))
    return wire, GatewayClient(profile, wiring.clock.now())


async def _serve_can(
    url: str, gateway: Any, settings: KindSettings[Jr3Settings, Jr3Profiles], serving: Serving
) -> str:
    if not url.startswith(SLCAN):
        return await serving.serve_can(url, gateway.endpoint, gateway_filters(settings.emulated.gateway.node))
    if not url.startswith(f"{SLCAN}pty:"):
        raise ConfigError(f"{url!r}: an slcan adapter is a serial port; for example {SLCAN}pty:")
    listening = await serving.listen_bytes(url.removeprefix(SLCAN))
    adapter = SlcanAdapter(SlcanProfile())
    serving.attach(gateway.endpoint, SlcanDevice(listening.transport, adapter, serving.clock))
    return slcan_address(listening.address)


def slcan_address(port: str) -> str:
    """Return the CAN URL of an emulated adapter on a pseudo-terminal, including the baud rate of the line if it has
    one.
    """
    wire = parse_url(port, CONNECT_BYTES)
    rate = wire.options.get("baudrate")
    return f"can+slcan://{wire.target}?bitrate={GATEWAY_BITRATE}{f'&tty_baudrate={rate}' if rate else ''}"


def _make_gateway(settings: KindSettings[Jr3Settings, Jr3Profiles]) -> SensorFactory:
    return make_gateway(settings.emulated.sensor, settings.emulated.gateway)


# --- UART gateway


def uart_line(url: str, schemes: Mapping[str, Any]) -> str:
    """Return the URL of a serial wire with the gateway's line settings, 115200 baud 8N1, if it contains none."""
    head, _, query = url.partition("?")
    known = schemes.get(head.partition(":")[0])
    if known is None or "baudrate" not in known.options or "baudrate=" in query:
        return url
    return f"{head}?baudrate={UART_BAUDRATE}{f'&{query}' if query else ''}"


async def _connect_uart(
    url: str, settings: KindSettings[Jr3Settings, Jr3Profiles], wiring: Wiring
) -> tuple[Transport[Any], Any]:
    wire = await wiring.bytes(uart_line(url, CONNECT_BYTES))
    return wire, UartGatewayClient(settings.client.uart, wiring.clock.now())


async def _serve_uart(
    url: str, gateway: Any, settings: KindSettings[Jr3Settings, Jr3Profiles], serving: Serving
) -> str:
    return await serving.serve_bytes(uart_line(url, LISTEN_BYTES), gateway.endpoint)


def _make_uart(settings: KindSettings[Jr3Settings, Jr3Profiles]) -> SensorFactory:
    return make_uart(settings.emulated.sensor, settings.emulated.uart)


# --- receiver board


async def _connect_board(
    url: str, settings: KindSettings[Jr3Settings, Jr3Profiles], wiring: Wiring
) -> tuple[Transport[Any], Any]:
    path = settings.client.board.program
    program = read_program(Path(path)) if path else ()
    wire, profile = await connect_board(url, settings.client.board, wiring.clock)
    return wiring.tap(wire), BoardClient(profile, wiring.clock.now(), program)


async def _serve_board(
    url: str, board: Any, settings: KindSettings[Jr3Settings, Jr3Profiles], serving: Serving
) -> str:
    watcher = Watcher(serving.say, serving.ended)
    served = await serve_board(url, board.endpoint, ListenerProfile(), serving.clock, watcher)
    serving.stack.push_async_callback(served.aclose)
    return served.address


def _make_board(settings: KindSettings[Jr3Settings, Jr3Profiles]) -> SensorFactory:
    """Return a factory of boards. The ground truth uses the filter from the settings, even if a client's URL
    selects another filter.
    """
    return make_board(settings.emulated.sensor, settings.emulated.board, settings.client.board.filter)


# --- kinds


def _describe_frame(raw: bytes) -> list[dict[str, object]]:
    try:
        return [describe(parse_frame(raw.decode("ascii", errors="replace")))]
    except ValueError as error:
        return [{"kind": "noise", "fields": [], "problems": [str(error)]}]


def _usual(real: str, virtual: str) -> Callable[[KindSettings[Jr3Settings, Jr3Profiles], bool], str]:
    return lambda settings, in_virtual_time: virtual if in_virtual_time else real


CAN_GATEWAY = SensorKind(
    "jr3",
    "JR3 sensor behind a CAN gateway",
    Jr3Settings,
    _connect_can,
    SensorEmulation(
        Jr3Profiles,
        _make_gateway,
        _serve_can,
        _usual(f"{SLCAN}pty:", "can+memory:sensor"),
        CAN_GATEWAY_FAULTS,
        {"status": "unplugged"},
        match_gateway,
        packets_per_frame=2,
        late=partial(late_settings, "jr3"),
    ),
    parse=lambda url, settings: _parse_can(url),
    describe=_describe_frame,
    bus=CanBus("a JR3 gateway", GATEWAY_BITRATE, can_messages),
    section=_SECTION,
    period=lambda settings: settings.client.gateway.period_ms * 1e-3,
)
UART_GATEWAY = SensorKind(
    "jr3-uart",
    "JR3 sensor behind a UART gateway",
    Jr3Settings,
    _connect_uart,
    SensorEmulation(
        Jr3Profiles,
        _make_uart,
        _serve_uart,
        _usual("pty:", "memory:sensor"),
        UART_GATEWAY_FAULTS,
        {"status": "unplugged"},
        match_uart,
        packets_per_frame=_UART_BYTES,
        late=partial(late_settings, "jr3-uart"),
    ),
    parse=lambda url, settings: parse_url(uart_line(url, CONNECT_BYTES), CONNECT_BYTES),
    describe=uart_gateway.describe,
    section=_SECTION,
    period=lambda settings: settings.client.uart.period_ms * 1e-3,
)
RECEIVER_BOARD = SensorKind(
    "jr3-board",
    "JR3 sensor at a DSP receiver board, by its register protocol",
    Jr3Settings,
    _connect_board,
    SensorEmulation(
        Jr3Profiles,
        _make_board,
        _serve_board,
        _usual("tcp-listen://127.0.0.1:0", "memory:sensor"),
        BOARD_FAULTS,
        late=partial(late_settings, "jr3-board"),
    ),
    parse=lambda url, settings: parse_url(board_wire(url, settings.client.board)[0], CONNECT_BYTES),
    section=_SECTION,
    period=lambda settings: settings.client.board.period,
)
