"""Sensor kind `xarm-force`: the force sensor of an xArm, over the ports of its control box.

With the robot `xarm`, the emulated control box of the robot reads the sensor. With another robot, the sensor
has a box of its own, whose arm stands.
"""

from collections.abc import Sequence
from typing import Any, TypeAlias

from emulators.seams import SensorFactory, StartPose
from hil_bridge.devices.emulator_fit import Sections, SensorFigures, noise_settings
from hil_bridge.devices.kinds import KindSettings, SensorEmulation, SensorKind
from hil_bridge.devices.wiring import Serving, Wiring
from hil_bridge.transports import Transport
from hil_bridge.transports.bundle import Bundle
from hil_bridge.transports.urls import WireUrl, parse_url
from hil_xarm.describe import describe
from hil_xarm.faults import FORCE_FAULTS
from hil_xarm.force import ForceSensor
from hil_xarm.force_client import ForceClient
from hil_xarm.profile import XarmProfile
from hil_xarm.reports import Port
from hil_xarm.robot import XarmRobot
from hil_xarm.settings import ForceSettings
from hil_xarm.wires import CONNECT, open_wires, parse_address, serve_box

_Settings: TypeAlias = KindSettings[ForceSettings, XarmProfile]
_ALONE = StartPose((0.3, 0.0, 0.3), (0.0, 1.0, 0.0, 0.0))
"""Pose of the arm of a box whose sensor is used with another robot. Chosen: within its reach."""


async def _connect(url: str, settings: _Settings, wiring: Wiring) -> tuple[Transport[Any], ForceClient]:
    wires = await open_wires(url, wiring)
    bundle: Bundle[Port] = Bundle(url, wires, Port.COMMAND)
    return bundle, ForceClient(settings.client, wiring.clock.now())


def _make(settings: _Settings) -> SensorFactory:
    return lambda source, now, seed: ForceSensor(settings.emulated, source, now, seed)


async def _serve(url: str, sensor: ForceSensor, settings: _Settings, serving: Serving) -> str:
    if sensor.robot is None:
        XarmRobot(settings.emulated, _ALONE, sensor.powered_at, sensor.seed).equip(sensor)
    assert sensor.robot is not None, "a box reads the sensor"
    return await serve_box(url, sensor.robot, serving, sensor)


def _usual(settings: _Settings, virtual: bool) -> str:
    return "memory:xarm-force" if virtual else "tcp-listen://127.0.0.1:0"


def match(settings: _Settings, figures: SensorFigures) -> Sections:
    """Return noise and drift; see `hil_bridge.devices.emulator_fit`."""
    return {"cell.xarm": noise_settings(figures)}


def _other_wires(url: str, settings: _Settings) -> Sequence[WireUrl]:
    return [parse_url(parse_address(url).real, CONNECT)]


SENSOR = SensorKind(
    "xarm-force",
    "Force sensor of a UFACTORY xArm, over its control box",
    ForceSettings,
    _connect,
    SensorEmulation(XarmProfile, _make, _serve, _usual, FORCE_FAULTS, {"status": "saturated"}, match),
    parse=lambda url, settings: parse_address(url).command,
    describe=describe,
    period=lambda settings: settings.client.cycle_s,
    section="xarm",
    other_wires=_other_wires,
)
