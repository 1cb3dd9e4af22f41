"""Sensor kind `schunk-fts`: the object that hil-bridge finds by the name of the entry point.

The URL names the TCP port of the commands: `schunk-fts+tcp://192.168.0.100:82`. The sensor sends its measurements to
UDP port 54843 of the computer that holds the connection; `?data_port=` in the URL names another port. Measurements of
other senders are refused. Assumed: it sends from the address at which it is connected. In virtual time,
the commands are in memory at `memory:NAME`, the measurements at `udp+memory:NAME-data`.
"""

from collections.abc import Sequence
from typing import Any, TypeAlias

from emulators.seams import SensorFactory
from hil_bridge.devices.emulator_fit import Sections, SensorFigures, noise_settings
from hil_bridge.devices.kinds import KindSettings, SensorEmulation, SensorKind
from hil_bridge.devices.wiring import Serving, Wiring
from hil_bridge.errors import ConfigError
from hil_bridge.transports import Transport, listen_datagrams
from hil_bridge.transports.bundle import Bundle
from hil_bridge.transports.tcp import peer_of
from hil_bridge.transports.urls import (
    CONNECT_BYTES,
    LISTEN_BYTES,
    LISTEN_DATAGRAMS,
    WireUrl,
    parse_url,
    split_option,
    with_option,
)
from hil_schunk.client import FtsClient, Port
from hil_schunk.client_settings import FtsClientSettings
from hil_schunk.connection import Connection
from hil_schunk.describe import describe
from hil_schunk.faults import FTS_FAULTS
from hil_schunk.messages import DATA_PORT, PERIOD_S
from hil_schunk.profile import FtsProfile
from hil_schunk.sensor import FtsSensor

_Settings: TypeAlias = KindSettings[FtsClientSettings, FtsProfile]
_WIRES = {scheme: CONNECT_BYTES[scheme] for scheme in ("tcp", "memory")}
_OPTION = "data_port"


def split_url(url: str) -> tuple[str, int | None]:
    """Split a URL into that of the commands, and the UDP port of the measurements. The port is None if the URL does
    not contain it. Raises ConfigError if the URL is invalid.
    """
    wire, text = split_option(url, _OPTION)
    if text is None:
        return url, None
    if not (text.isascii() and text.isdigit() and 0 < int(text[:6]) < 65536):
        raise ConfigError(f"{url!r}: {_OPTION} must be a port from 1 to 65535, got {text!r}")
    return wire, int(text)


def _parse(url: str, settings: _Settings) -> WireUrl:
    return parse_url(split_url(url)[0], _WIRES)


def _data_name(parsed: WireUrl) -> str:
    """Return the name, in memory, at which the client receives measurements."""
    return f"{parsed.target}-data"


def _data_url(url: str, settings: _Settings) -> str:
    """Return the URL at which the client receives measurements."""
    commands_url, port = split_url(url)
    parsed, client = parse_url(commands_url, _WIRES), settings.client
    if parsed.scheme == "memory":
        return f"udp+memory:{_data_name(parsed)}?strangers=refuse"
    sensor = "127.0.0.1" if parsed.host_port[0] == "localhost" else parsed.host_port[0]
    local = "127.0.0.1" if sensor.startswith("127.") else "0.0.0.0"
    address = client.data_address or local
    return f"udp-bind://{address}:{port or client.data_port}?strangers=refuse&sender={sensor}"


def _other_wires(url: str, settings: _Settings) -> Sequence[WireUrl]:
    return [parse_url(_data_url(url, settings), LISTEN_DATAGRAMS)]


async def _connect(url: str, settings: _Settings, wiring: Wiring) -> tuple[Transport[Any], FtsClient]:
    data = await wiring.datagrams(_data_url(url, settings), speak_first=False)
    try:
        commands = await wiring.bytes(split_url(url)[0])
    except BaseException:
        await data.aclose()
        raise
    bundle = Bundle(url, {Port.DATA: data, Port.COMMANDS: commands}, Port.COMMANDS)
    return bundle, FtsClient(settings.client, wiring.clock.now())


def _make(settings: _Settings) -> SensorFactory:
    return lambda source, now, seed: FtsSensor(settings.emulated, source, now, seed)


async def _serve(url: str, sensor: FtsSensor, settings: _Settings, serving: Serving) -> str:
    parsed, port = parse_url(url, LISTEN_BYTES), settings.emulated.data_port
    in_memory = parsed.scheme == "memory"
    here = f"udp+memory:{parsed.target}-sensor" if in_memory else f"udp-bind://{parsed.host_port[0]}:0"
    wire = (await listen_datagrams(here, serving.clock)).transport
    serving.attach(sensor.endpoint, wire)

    sensor.on_change = serving.wake

    def accept(client: Transport[bytes], now: float) -> Connection | None:
        side = _data_name(parsed) if in_memory else (peer_of(client), port)
        wire.introduce(side)
        return sensor.connect(side, now)

    address = await serving.serve_clients(url, accept)
    return address if in_memory or port == DATA_PORT else with_option(address, _OPTION, f"{port}")


def _usual(settings: _Settings, virtual: bool) -> str:
    return "memory:schunk-fts" if virtual else "tcp-listen://127.0.0.1:0"


def _match(settings: _Settings, figures: SensorFigures) -> Sections:
    """Return the noise of a measured sensor; see `hil_bridge.devices.emulator_fit`."""
    return {"cell.schunk_fts": noise_settings(figures)}


SENSOR = SensorKind(
    "schunk-fts",
    "SCHUNK FTS with IFB-EN: commands over TCP, measurements over UDP",
    FtsClientSettings,
    _connect,
    SensorEmulation(FtsProfile, _make, _serve, _usual, FTS_FAULTS, {"status": "status"}, _match),
    parse=_parse,
    describe=describe,
    period=lambda settings: PERIOD_S,
    other_wires=_other_wires,
)
