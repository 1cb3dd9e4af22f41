"""Sensor kind: the object that hil-bridge finds by the name of the entry point."""

from dataclasses import dataclass
from typing import Any

from emulators.seams import SensorFactory
from hil_bridge.devices.kinds import KindSettings, SensorEmulation, SensorKind
from hil_bridge.devices.wiring import Serving, Wiring
from hil_bridge.transports import Datagrams, Transport
from toy_sensor.emulator import LoadCell, LoadProfile
from toy_sensor.wire import LoadClient


@dataclass(frozen=True, slots=True)
class NoSettings:
    """Empty settings: the load cell's client has none."""


async def connect_load(
    url: str, settings: KindSettings[NoSettings, LoadProfile], wiring: Wiring
) -> tuple[Transport[Datagrams], LoadClient]:
    return await wiring.datagrams(url), LoadClient(wiring.clock.now())


def make_load(settings: KindSettings[NoSettings, LoadProfile]) -> SensorFactory:
    return lambda source, now, seed: LoadCell(settings.emulated, source, seed)


async def serve(
    url: str, device: Any, settings: KindSettings[NoSettings, LoadProfile], serving: Serving
) -> str:
    return await serving.serve_datagrams(url, device.endpoint)


def usual(settings: KindSettings[NoSettings, LoadProfile], virtual: bool) -> str:
    return "udp+memory:toyload" if virtual else "udp-bind://127.0.0.1:0"


SENSOR = SensorKind(
    "toyload",
    "Toy load cell that streams over UDP",
    NoSettings,
    connect_load,
    SensorEmulation(LoadProfile, make_load, serve, usual),
)
