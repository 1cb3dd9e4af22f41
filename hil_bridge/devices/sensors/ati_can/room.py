"""Device package for an ATI NETCANOEM board on a CAN bus of 250 kbit/s: a real bus, a bus in memory, or an emulated
slcan adapter.
"""

from typing import Any

from emulators.devices.ati_can import ATI_CAN_FAULTS, AtiCanBoard, AtiCanProfile
from emulators.seams import SensorFactory
from emulators.wires.slcan_adapter import SlcanAdapter, SlcanProfile
from hil_bridge.devices.kinds import CanBus, KindSettings, SensorEmulation, SensorKind
from hil_bridge.devices.sensors.ati_can.emulator_fit import match
from hil_bridge.devices.wiring import Serving, Wiring
from hil_bridge.errors import ConfigError
from hil_bridge.transports import Transport
from hil_bridge.transports.can.slcan_device import SlcanDevice
from hil_bridge.transports.urls import CONNECT_BYTES, CONNECT_CAN, parse_url
from protocol.devices.ati_can import BITRATE, AtiCanClient, AtiCanClientProfile, can_messages, describe, heard

_SLCAN = "can+slcan+"
"""URL prefix that selects an emulated slcan adapter on a listening byte wire."""


async def _connect(
    url: str, settings: KindSettings[AtiCanClientProfile, AtiCanProfile], wiring: Wiring
) -> tuple[Transport[Any], Any]:
    profile: AtiCanClientProfile = settings.client
    return await wiring.can(url, heard(profile.base)), AtiCanClient(profile, wiring.clock.now())


def _make(settings: KindSettings[AtiCanClientProfile, AtiCanProfile]) -> SensorFactory:
    return lambda source, now, seed: AtiCanBoard(settings.emulated, source, now, seed)


async def _serve(
    url: str, board: Any, settings: KindSettings[AtiCanClientProfile, AtiCanProfile], serving: Serving
) -> str:
    if not url.startswith(_SLCAN):
        return await serving.serve_can(url, board.endpoint)
    if not url.startswith(f"{_SLCAN}pty:"):
        raise ConfigError(f"{url!r}: an slcan adapter is a serial port; for example {_SLCAN}pty:")
    listening = await serving.listen_bytes(url.removeprefix(_SLCAN))
    serving.attach(
        board.endpoint,
        SlcanDevice(listening.transport, SlcanAdapter(SlcanProfile(bus_bit_rate=BITRATE)), serving.clock),
    )
    port = parse_url(listening.address, CONNECT_BYTES).target
    return f"can+slcan://{port}?bitrate={BITRATE}"


SENSOR = SensorKind(
    "ati-can",
    "ATI NETCANOEM: strain gages over CAN",
    AtiCanClientProfile,
    _connect,
    SensorEmulation(
        AtiCanProfile,
        _make,
        _serve,
        lambda settings, virtual: f"can+memory:ati-can?bitrate={BITRATE}" if virtual else f"{_SLCAN}pty:",
        ATI_CAN_FAULTS,
        {"status": "status"},
        match,
        packets_per_frame=2,
    ),
    parse=lambda url, settings: parse_url(url, CONNECT_CAN),
    describe=describe,
    bus=CanBus("an ATI NETCANOEM board", BITRATE, can_messages),
)
