"""Sensor kind `onrobot-hex`: the object that hil-bridge finds by the name of the entry point.

The URL names the UDP port of the records: `onrobot-hex+udp://192.168.1.1:49152`. The TCP port of the emulated sensor is
in its URL as `?tcp_port=`, 49151 by default; the client reads the scales there. In virtual time, it is in memory at
`memory:NAME-tcp`.
"""

from dataclasses import replace
from typing import Any, TypeAlias

from emulators.seams import SensorFactory
from hil_bridge.devices.emulator_fit import Sections, SensorFigures, behind_filter, noise_settings
from hil_bridge.devices.kinds import KindSettings, SensorEmulation, SensorKind
from hil_bridge.devices.wiring import Serving, Wiring
from hil_bridge.errors import ConfigError
from hil_bridge.transports import Transport
from hil_bridge.transports.urls import (
    CONNECT_DATAGRAMS,
    LISTEN_DATAGRAMS,
    WireUrl,
    parse_url,
    split_option,
    with_option,
)
from hil_onrobot.calibration import read_calibration
from hil_onrobot.client import HexClient
from hil_onrobot.client_settings import HexClientSettings
from hil_onrobot.describe import describe
from hil_onrobot.faults import HEX_FAULTS
from hil_onrobot.messages import FILTERS_HZ, RATE_HZ, TCP_PORT
from hil_onrobot.profile import HexProfile
from hil_onrobot.sensor import HexSensor
from protocol.devices.netft.page import filter_weight

_Settings: TypeAlias = KindSettings[HexClientSettings, HexProfile]
_OPTION = "tcp_port"


def split_url(url: str) -> tuple[str, int | None]:
    """Split a URL into that of the records, and the TCP port. The port is None if the URL does not contain it. Raises
    ConfigError if the URL is invalid.
    """
    wire, text = split_option(url, _OPTION)
    if text is None:
        return url, None
    if not (text.isascii() and text.isdigit() and int(text[:6]) < 65536):
        raise ConfigError(f"{url!r}: {_OPTION} must be a port from 0 to 65535, got {text!r}")
    return wire, int(text)


def _parse(url: str, settings: _Settings) -> WireUrl:
    return parse_url(split_url(url)[0], CONNECT_DATAGRAMS)


async def _connect(url: str, settings: _Settings, wiring: Wiring) -> tuple[Transport[Any], HexClient]:
    client = await _with_scales(url, settings.client, wiring)
    wire = await wiring.datagrams(split_url(url)[0])
    return wire, HexClient(client, wiring.clock.now())


async def _with_scales(url: str, client: HexClientSettings, wiring: Wiring) -> HexClientSettings:
    """Return the settings with the scales that the sensor reports over TCP."""
    if not client.read_scales:
        return client
    calibration = await read_calibration(_tcp_url(url), wiring)
    if calibration is None:
        return client
    return replace(client, counts_per_n=calibration.counts_per_n, counts_per_nm=calibration.counts_per_nm)


def _tcp_url(url: str) -> str:
    wire, port = split_url(url)
    parsed = parse_url(wire, CONNECT_DATAGRAMS)
    if parsed.scheme == "udp+memory":
        return f"memory:{parsed.target}-tcp"
    host = parsed.host_port[0]
    return f"tcp://{f'[{host}]' if ':' in host else host}:{port or TCP_PORT}"


def _make(settings: _Settings) -> SensorFactory:
    return lambda source, now, seed: HexSensor(settings.emulated, source, now, seed)


async def _serve(url: str, sensor: HexSensor, settings: _Settings, serving: Serving) -> str:
    wire_url, port = split_url(url)
    parsed = parse_url(wire_url, LISTEN_DATAGRAMS)
    if parsed.scheme == "udp+memory":
        await serving.serve_clients(f"memory:{parsed.target}-tcp", lambda wire, now: sensor.connect(now))
        return await serving.serve_datagrams(wire_url, sensor.endpoint)
    host, _ = parsed.host_port
    here = f"[{host}]" if ":" in host else host
    number = settings.emulated.tcp_port if port is None else port
    tcp = await serving.serve_clients(f"tcp-listen://{here}:{number}", lambda wire, now: sensor.connect(now))
    address = await serving.serve_datagrams(wire_url, sensor.endpoint)
    return with_option(address, _OPTION, tcp.rpartition(":")[2])


def _usual(settings: _Settings, virtual: bool) -> str:
    return "udp+memory:onrobot-hex" if virtual else "udp-bind://127.0.0.1:0"


def _match(settings: _Settings, figures: SensorFigures) -> Sections:
    """Return the noise of a measured sensor before its filter; see `hil_bridge.devices.emulator_fit`."""
    reduction = behind_filter(filter_weight(FILTERS_HZ[settings.client.filter], RATE_HZ))
    return {"cell.onrobot_hex": noise_settings(figures, 1.0 / reduction)}


SENSOR = SensorKind(
    "onrobot-hex",
    "OnRobot HEX-E or HEX-H: records over UDP",
    HexClientSettings,
    _connect,
    SensorEmulation(HexProfile, _make, _serve, _usual, HEX_FAULTS, {"status": "status"}, _match),
    parse=_parse,
    describe=describe,
    period=lambda settings: settings.client.period,
)
