"""Contact model that simulates the force sensor of a Universal Robots controller. The controller may be real,
simulated by its manufacturer, or emulated.

The force source reads the pose of the tool in each cycle, computes the force of the surface, and writes
`external_force_torque`. The force that programs of the controller read therefore belongs to a pose that is some
cycles old. With a stiff surface, a force loop of the controller may oscillate for that reason.
"""

import asyncio
import math
from collections import Counter
from dataclasses import dataclass

import numpy as np

from emulators.seams import Surface
from emulators.surface.contact import Contact
from hil_bridge.clock import Clock
from hil_bridge.devices.kinds import SURFACES, robot_of
from hil_bridge.devices.robots.rtde.room import ROBOT, open_wires
from hil_bridge.devices.wiring import Wiring
from hil_bridge.errors import BridgeError, ConfigError, DeviceError
from hil_bridge.settings.configuration import Config
from hil_bridge.settings.kinds import settings_of, surface_settings
from hil_bridge.transports.bundle import Bundle
from hil_bridge.transports.pump import Pump
from protocol.devices.rtde.force import Event, ForceClient, Lost, Seen
from protocol.devices.rtde.wires import Pieces, Port
from protocol.geometry import Wrench, inverse, rotate

_RATE_HZ = 8000
"""Lowest sample rate at which a surface with memory is computed, Hz."""
_GAP_S = 0.1
"""Longest gap between two packets across which the path is interpolated, s. Chosen."""


@dataclass(frozen=True, slots=True)
class ForceOptions:
    """Options of the force source."""

    limit_n: float = 200.0
    """Force at which the source stops because the tool is deep in the surface, N."""
    enable: bool = True
    """Whether to upload the program by which the controller accepts the force."""


def make_surface(config: Config) -> Surface:
    """Return the surface of a configuration. Raises ConfigError if its kind is unknown or its settings are invalid."""
    name = config.cell.surface_kind
    if name:
        kind = SURFACES.kind(name)
        return kind.make(surface_settings(config, kind))(lambda time: None)
    try:
        return Contact(config.cell.surface)
    except ValueError as error:
        raise ConfigError(f"cell: {error}") from error


class ForceSource:
    """Computation of the force for one controller."""

    def __init__(self, surface: Surface, limit_n: float) -> None:
        self._surface, self._limit = surface, limit_n
        self._last: Seen | None = None
        self.counts: Counter[str] = Counter()
        self.newest_n = 0.0
        """Magnitude of the newest force, N."""
        self.largest_n = 0.0

    def wrench(self, seen: Seen) -> Wrench:
        """Return the wrench at the flange for a reported tool pose, in the flange frame, N and N·m.

        Raises DeviceError if the force is too large or the clock of the reports goes back.
        """
        last = self._last
        if last is not None and seen.stamp <= last.stamp:
            raise DeviceError("the controller's clock went back, as after a restart; start again")
        if last is None or seen.stamp - last.stamp > _GAP_S:
            last = seen
            self.counts["gaps"] += 1
        count = max(1, math.ceil((seen.stamp - last.stamp) * _RATE_HZ))
        shares = np.arange(1, count + 1)[:, None] / count
        here, there = np.array(last.pose.position), np.array(seen.pose.position)
        times = last.stamp + shares[:, 0] * (seen.stamp - last.stamp)
        speeds = np.repeat(np.array([seen.velocity]), count, axis=0)
        x, y, z = self._surface.force(here + shares * (there - here), speeds, times)[-1].tolist()
        self._last = seen
        self.counts["packets"] += 1
        self.newest_n = math.hypot(x, y, z)
        self.largest_n = max(self.largest_n, self.newest_n)
        if not self.newest_n <= self._limit:
            raise DeviceError(
                f"the surface force is {self.newest_n:.0f} N; allowed: at most {self._limit:g} N; "
                "lift the tool, or set --limit-n"
            )
        force = rotate(inverse(seen.pose.quaternion), (x, y, z))
        force = rotate(seen.tip.quaternion, force)
        a, b, c = seen.tip.position
        u, v, w = force
        return u, v, w, b * w - c * v, c * u - a * w, a * v - b * u


async def feed(
    url: str, config: Config, options: ForceOptions, wiring: Wiring, stopped: asyncio.Event
) -> ForceSource:
    """Send forces to the controller at a URL until `stopped` is set. The force is reset at the end.

    Raises ConfigError for an invalid URL, DeviceError if the controller refuses or the force is too large, and
    TransportError if a wire fails.
    """
    _, wire_url = robot_of(url)
    profile = settings_of(config, ROBOT).client
    source = ForceSource(make_surface(config), options.limit_n)
    clock: Clock = wiring.clock
    client = ForceClient(1.0 / profile.cycle_s, options.enable, clock.now())
    wires = await open_wires(wire_url, profile, wiring, dashboard=False)
    bundle = Bundle(url, wires, Port.RTDE, client.farewell)
    failures: list[BaseException] = []

    def fail(cause: BaseException) -> None:
        failures.append(cause)
        stopped.set()

    def take(event: Event) -> None:
        match event:
            case Lost(text=text, remedy=remedy):
                fail(DeviceError(f"robot on {url}: {text}", remedy=remedy))
            case Seen() if not failures:
                try:
                    client.give(source.wrench(event))
                except BridgeError as error:
                    fail(error)

    pump: Pump[Pieces, Event] = Pump(client, bundle, clock, take, fail)
    pump.start()
    try:
        await stopped.wait()
    finally:
        ended = failures[:1]  # closing on this side is not a failure
        await bundle.aclose()
    if ended:
        raise ended[0]
    return source
