"""Sensor kind: the object that hil-bridge finds by the name of the entry point."""

from dataclasses import dataclass
from typing import Any

from emulators.seams import SensorFactory
from hil_bridge.devices.kinds import KindSettings, SensorEmulation, SensorKind
from hil_bridge.devices.wiring import Serving, Wiring
from hil_bridge.transports import Transport
from hil_bridge.transports.urls import CONNECT_BYTES, LISTEN_BYTES, parse_url, with_baudrate
from line_sensor.emulator import LINE_FAULTS, LineProfile, LineSensor
from line_sensor.wire import BAUDRATE, PERIOD_S, LineClient


@dataclass(frozen=True, slots=True)
class NoSettings:
    """Empty settings: the sensor's client has none."""


async def connect_line(
    url: str, settings: KindSettings[NoSettings, LineProfile], wiring: Wiring
) -> tuple[Transport[bytes], LineClient]:
    wire = await wiring.bytes(with_baudrate(url, BAUDRATE, CONNECT_BYTES))
    return wire, LineClient(wiring.clock.now())


def make_line(settings: KindSettings[NoSettings, LineProfile]) -> SensorFactory:
    return lambda source, now, seed: LineSensor(settings.emulated, source, now, seed)


async def serve(
    url: str, device: Any, settings: KindSettings[NoSettings, LineProfile], serving: Serving
) -> str:
    return await serving.serve_bytes(with_baudrate(url, BAUDRATE, LISTEN_BYTES), device.endpoint)


def usual(settings: KindSettings[NoSettings, LineProfile], virtual: bool) -> str:
    return "memory:toyline" if virtual else "pty:"


SENSOR = SensorKind(
    "toyline",
    "Toy sensor that streams unasked over a serial line",
    NoSettings,
    connect_line,
    SensorEmulation(LineProfile, make_line, serve, usual, LINE_FAULTS),
    parse=lambda url, settings: parse_url(with_baudrate(url, BAUDRATE, CONNECT_BYTES), CONNECT_BYTES),
    period=lambda settings: PERIOD_S,
)
