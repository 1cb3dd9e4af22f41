"""Movement of a robot that drives the cycle."""

from collections.abc import Awaitable, Callable
from typing import Generic, NamedTuple

from hil_bridge.clock import Clock
from hil_bridge.devices.robots.gate import Gate
from hil_bridge.devices.robots.last_order import LastOrder
from hil_bridge.devices.robots.seam import Sent
from hil_bridge.devices.robots.setpoint_responder import SetpointResponder
from hil_bridge.errors import GateStop, OrderRefused
from hil_bridge.transports.pump import Data
from protocol.geometry import Pose
from protocol.robot import pose_fault


class Stream(NamedTuple):
    """Packets of the robot, as used by a movement."""

    name: str
    """Name of the robot's wire."""
    check: Callable[[], None]
    """Raises an error if nothing can be ordered."""
    next_packet: Callable[[], Awaitable[object]]
    """Waits for a packet. Raises an error if none arrives."""


class StreamedMotion(LastOrder, Generic[Data]):
    """Movement in progress; see `hil_bridge.devices.robots.seam.Motion`."""

    def __init__(self, stream: Stream, answering: SetpointResponder[Data], clock: Clock, gate: Gate) -> None:
        """Create a movement. `gate` checks the targets."""
        self._name, self._check_link, self._next_packet = stream
        self._answering, self._clock, self._gate = answering, clock, gate
        super().__init__()

    @property
    def speed(self) -> float:
        """Speed along the path to the targets, m/s."""
        return self._answering.speed

    @speed.setter
    def speed(self, speed: float) -> None:
        self._answering.speed = speed

    async def to(self, target: Pose, *, soon: bool = False) -> Sent:
        self._check()
        if wrong := pose_fault(target):
            raise OrderRefused(f"robot on {self._name} is not sent to {wrong}")
        now = self._clock.now()
        if stopped := self._gate.judge(target, now):
            raise GateStop(stopped)
        self._answering.aim(target, now)
        self._last = target
        return Sent(now)

    async def settled(self) -> None:
        while not self._answering.arrived:
            self._check()
            self._answering.renew(self._clock.now())
            await self._next_packet()
        self._check()

    def hold(self) -> None:
        self._answering.stay()

    async def halt(self) -> Sent:
        self.halted = True
        self._answering.stay()
        return Sent(self._clock.now())

    def abandon(self) -> None:
        self.abandoned = True
        self._answering.stay()

    def _check(self) -> None:
        if self.halted or self.abandoned:
            raise OrderRefused(f"robot on {self._name} was halted: nothing more is ordered in this movement")
        self._check_link()
