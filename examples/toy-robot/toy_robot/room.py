"""Robot kind: the object that hil-bridge finds by the name of the entry point."""

from dataclasses import dataclass
from typing import Any

from emulators.arm.followed import FollowedProfile
from emulators.panel import Controls, motion_text
from emulators.seams import RobotFactory
from hil_bridge.devices.kinds import KindSettings, RobotEmulation, RobotKind
from hil_bridge.devices.robots.probe import ProbeResult, probe_link
from hil_bridge.devices.robots.seam import Pacing, RobotFacts
from hil_bridge.devices.robots.streamed import StreamedLink
from hil_bridge.devices.wiring import Serving, Wiring
from hil_bridge.transports import Datagrams
from toy_robot.emulator import ARM_FAULTS, Arm
from toy_robot.wire import CYCLE_S, ArmClient


@dataclass(frozen=True, slots=True)
class NoSettings:
    """Empty settings: the arm's client has none."""


FACTS = RobotFacts("toy arm", Pacing.STREAMED, cycle_s=CYCLE_S)


async def connect_arm(
    url: str, settings: KindSettings[NoSettings, FollowedProfile], wiring: Wiring
) -> StreamedLink[Datagrams]:
    wire = await wiring.datagrams(url)
    return StreamedLink(wire, ArmClient(wiring.clock.now()), FACTS, wiring.clock, wiring.log)


def make_arm(settings: KindSettings[NoSettings, FollowedProfile]) -> RobotFactory:
    return lambda start, now, seed: Arm(settings.emulated, start, now)


async def serve(
    url: str, device: Any, settings: KindSettings[NoSettings, FollowedProfile], serving: Serving
) -> str:
    return await serving.serve_datagrams(url, device.endpoint)


def usual(settings: KindSettings[NoSettings, FollowedProfile], virtual: bool) -> str:
    return "udp+memory:toyarm" if virtual else "udp-bind://127.0.0.1:0"


async def probe_arm(
    url: str, settings: KindSettings[NoSettings, FollowedProfile], wiring: Wiring
) -> ProbeResult:
    return await probe_link(url, lambda heard: connect_arm(url, settings, heard), wiring)


def state_of(arm: Arm, now: float) -> dict[str, Any]:
    hindrance = arm.hindrance(now)
    return {"hindrance": "" if hindrance is None else hindrance.words}


PANEL = Controls({}, state_of, lambda state: {"motion": motion_text(state["hindrance"])}, ARM_FAULTS)

ROBOT = RobotKind(
    "toyarm",
    "Toy arm that streams over UDP",
    NoSettings,
    connect_arm,
    lambda url, settings: FACTS,
    RobotEmulation(
        FollowedProfile,
        make_arm,
        serve,
        usual,
        ARM_FAULTS,
        PANEL,
        mishaps={"refused": "emergency-stop", "stopped": "emergency-stop"},
    ),
    probe=probe_arm,
)
