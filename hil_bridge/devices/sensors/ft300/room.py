"""The room of a Robotiq FT 300: a serial line of 19200 baud, 8N1, where the URL says nothing else."""

from typing import Any

from emulators.devices.ft300 import FT300_FAULTS, Ft300, Ft300Profile
from emulators.seams import SensorFactory
from hil_bridge.devices.kinds import KindSettings, SensorEmulation, SensorKind
from hil_bridge.devices.sensors.ft300.matching import match
from hil_bridge.devices.wiring import Serving, Wiring
from hil_bridge.transports import Transport
from hil_bridge.transports.urls import CONNECT_BYTES, LISTEN_BYTES, parse_url, with_baudrate
from protocol.devices.ft300 import BAUDRATE, PERIOD_S, Ft300Client, Ft300ClientProfile, describe


async def _connect(
    url: str, settings: KindSettings[Ft300ClientProfile, Ft300Profile], wiring: Wiring
) -> tuple[Transport[Any], Any]:
    wire = await wiring.bytes(with_baudrate(url, BAUDRATE, CONNECT_BYTES))
    return wire, Ft300Client(settings.client, wiring.clock.now())


def _make(settings: KindSettings[Ft300ClientProfile, Ft300Profile]) -> SensorFactory:
    return lambda source, now, seed: Ft300(settings.emulated, source, now, seed)


async def _serve(
    url: str, sensor: Any, settings: KindSettings[Ft300ClientProfile, Ft300Profile], serving: Serving
) -> str:
    return await serving.serve_bytes(with_baudrate(url, BAUDRATE, LISTEN_BYTES), sensor.endpoint)


_FRAME_BYTES = 16
"""Derived: bytes of a message of the stream, each of which the line may lose."""

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
        match=match,
        packets_per_frame=_FRAME_BYTES,
    ),
    parse=lambda url, settings: parse_url(with_baudrate(url, BAUDRATE, CONNECT_BYTES), CONNECT_BYTES),
    describe=describe,
    period=lambda settings: PERIOD_S,
)
