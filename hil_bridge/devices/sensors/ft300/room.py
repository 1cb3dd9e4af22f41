"""Device package for a Robotiq FT 300 on a serial line, 19200 baud 8N1 unless the URL sets it, or behind Robotiq's
URCap.

The URCap serves text on a UR controller: `ft300-urcap+tcp://192.168.1.20:63351`.
"""

from typing import Any, TypeAlias

from emulators.devices.ft300 import FT300_FAULTS, URCAP_FAULTS, Ft300, Ft300Profile, UrcapServer
from emulators.seams import SensorFactory
from hil_bridge.devices.emulator_fit import Sections, SensorFigures, noise_settings
from hil_bridge.devices.kinds import KindSettings, SensorEmulation, SensorKind
from hil_bridge.devices.sensors.ft300.urcap_port import serve_texts
from hil_bridge.devices.wiring import Serving, Wiring
from hil_bridge.errors import ConfigError
from hil_bridge.transports import Transport
from hil_bridge.transports.urls import CONNECT_BYTES, LISTEN_BYTES, WireUrl, parse_url, with_baudrate
from protocol.devices.ft300 import (
    BAUDRATE,
    PERIOD_S,
    URCAP_PORT,
    Ft300Client,
    Ft300ClientProfile,
    UrcapClient,
    describe,
    describe_texts,
)

_Settings: TypeAlias = KindSettings[Ft300ClientProfile, Ft300Profile]
_URCAP_WIRES = {scheme: CONNECT_BYTES[scheme] for scheme in ("tcp", "memory")}


def _match(settings: _Settings, figures: SensorFigures) -> Sections:
    """Return noise and drift; see `hil_bridge.devices.emulator_fit`."""
    return {"cell.ft300": noise_settings(figures)}


# --- serial line


def _parse(url: str, settings: _Settings) -> WireUrl:
    """Parse a URL. Raises ConfigError for an invalid URL. For the port of a URCap, the error names the right kind."""
    parsed = parse_url(with_baudrate(url, BAUDRATE, CONNECT_BYTES), CONNECT_BYTES)
    if parsed.scheme == "tcp" and parsed.host_port[1] == URCAP_PORT:
        raise ConfigError(
            f"{f'ft300+{url}'!r}: port {URCAP_PORT} is that of Robotiq's URCap, which sends text; "
            f"did you mean ft300-urcap+{url}?"
        )
    return parsed


async def _connect(url: str, settings: _Settings, wiring: Wiring) -> tuple[Transport[Any], Any]:
    wire = await wiring.bytes(_parse(url, settings).text)
    return wire, Ft300Client(settings.client, wiring.clock.now())


def _make(settings: _Settings) -> SensorFactory:
    return lambda source, now, seed: Ft300(settings.emulated, source, now, seed)


async def _serve(url: str, sensor: Any, settings: _Settings, serving: Serving) -> str:
    return await serving.serve_bytes(with_baudrate(url, BAUDRATE, LISTEN_BYTES), sensor.endpoint)


_FRAME_BYTES = 16
"""Number of bytes in a message of the stream, each of which may be lost. Derived."""

SENSOR = SensorKind(
    "ft300",
    "Robotiq FT 300: stream or Modbus RTU over a serial line",
    Ft300ClientProfile,
    _connect,
    SensorEmulation(
        Ft300Profile,
        _make,
        _serve,
        lambda settings, virtual: "memory:ft300" if virtual else "pty:",
        FT300_FAULTS,
        match=_match,
        packets_per_frame=_FRAME_BYTES,
    ),
    parse=_parse,
    describe=describe,
    period=lambda settings: PERIOD_S,
)


# --- URCap


async def _connect_urcap(url: str, settings: _Settings, wiring: Wiring) -> tuple[Transport[Any], Any]:
    wire = await wiring.bytes(parse_url(url, _URCAP_WIRES).text)
    return wire, UrcapClient(settings.client, wiring.clock.now())


def _make_urcap(settings: _Settings) -> SensorFactory:
    return lambda source, now, seed: UrcapServer(settings.emulated, source, now, seed)


async def _serve_urcap(url: str, server: Any, settings: _Settings, serving: Serving) -> str:
    return await serve_texts(url, server, settings.emulated.urcap_clients, serving)


URCAP = SensorKind(
    "ft300-urcap",
    "Robotiq FT 300 behind its URCap: texts on TCP port 63351 of a UR controller",
    Ft300ClientProfile,
    _connect_urcap,
    SensorEmulation(
        Ft300Profile,
        _make_urcap,
        _serve_urcap,
        lambda settings, virtual: "memory:ft300-urcap" if virtual else "tcp-listen://127.0.0.1:0",
        URCAP_FAULTS,
        match=_match,
    ),
    parse=lambda url, settings: parse_url(url, _URCAP_WIRES),
    describe=describe_texts,
    period=lambda settings: PERIOD_S,
    section="ft300",
)
