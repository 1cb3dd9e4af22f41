"""The toys' faces: what hil-bridge finds by the names of the entry points."""

from dataclasses import dataclass
from typing import Any

from emulators.arm.followed import FollowedProfile
from emulators.seams import RobotFactory, SensorFactory, SurfaceFactory
from hil_bridge.kinds import (
    KindSettings,
    RobotEmulation,
    RobotKind,
    SensorEmulation,
    SensorKind,
    SurfaceKind,
)
from hil_bridge.robots.seam import Pacing, RobotFacts
from hil_bridge.robots.streamed import StreamedLink
from hil_bridge.transports import Datagrams, Transport
from hil_bridge.wiring import Serving, Wiring
from toydevices.emulator import Arm, LoadCell, LoadProfile, Spring, SpringProfile
from toydevices.wire import ARM_CYCLE_S, ArmClient, LoadClient


@dataclass(frozen=True, slots=True)
class NoSettings:
    """The toys' clients have none."""


def usual(name: str, virtual: bool) -> str:
    return f"udp+memory:{name}" if virtual else "udp-bind://127.0.0.1:0"


# --- the arm


FACTS = RobotFacts("toy arm", Pacing.STREAMED, cycle_s=ARM_CYCLE_S)


async def connect_arm(url: str, settings: KindSettings, wiring: Wiring) -> StreamedLink[Datagrams]:
    wire = await wiring.datagrams(url)
    return StreamedLink(wire, ArmClient(wiring.clock.now()), FACTS, wiring.clock, wiring.log)


def make_arm(settings: KindSettings) -> RobotFactory:
    return lambda start, now, seed: Arm(settings.emulated, start, now)


async def serve(url: str, device: Any, settings: KindSettings, serving: Serving) -> str:
    return await serving.serve_datagrams(url, device.endpoint)


ROBOT = RobotKind(
    "toyarm",
    "Toy arm that streams over UDP",
    NoSettings,
    connect_arm,
    lambda url, settings: FACTS,
    RobotEmulation(FollowedProfile, make_arm, serve, lambda settings, virtual: usual("toyarm", virtual)),
)


# --- the load cell


async def connect_load(
    url: str, settings: KindSettings, wiring: Wiring
) -> tuple[Transport[Datagrams], LoadClient]:
    return await wiring.datagrams(url), LoadClient(wiring.clock.now())


def make_load(settings: KindSettings) -> SensorFactory:
    return lambda source, now, seed: LoadCell(settings.emulated, source, seed)


SENSOR = SensorKind(
    "toyload",
    "Toy load cell that streams over UDP",
    NoSettings,
    connect_load,
    SensorEmulation(LoadProfile, make_load, serve, lambda settings, virtual: usual("toyload", virtual)),
)


# --- the surface


def make_spring(settings: SpringProfile) -> SurfaceFactory:
    return lambda changed: Spring(settings, changed)


SURFACE = SurfaceKind("toyspring", "Level plate on springs", SpringProfile, make_spring)
