"""The link of another package's robot: whatever its code raises becomes an error that a run knows how to end by.

The last gate stands before each of its targets.
"""

from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager
from typing import Any

from hil_bridge.clock import Clock
from hil_bridge.devices.robots.gate import Bounds, Gate
from hil_bridge.devices.robots.seam import Motion, MotionLimits, RobotLink, RobotReport, Sent
from hil_bridge.errors import BridgeError, GateStop
from hil_bridge.errors.cancelling import raise_if_asked
from hil_bridge.errors.failures import RAISED, code_failed, link_cause
from protocol.geometry import Pose


@contextmanager
def _told(name: str) -> Iterator[None]:
    """Raises BridgeError alone, and what cancels the task."""
    try:
        yield
    except RAISED as error:
        raise_if_asked(error)
        raise code_failed(f"robot link {name}", error, link_cause(error)) from error


class LinkOfOthers:
    """A `RobotLink` around one of another package; all that is not here is the link's own."""

    def __init__(self, link: RobotLink, clock: Clock) -> None:
        self._link, self._clock = link, clock

    def __getattr__(self, name: str) -> Any:
        return getattr(self._link, name)

    def start(self) -> None:
        """As of the link."""
        with _told(self._link.name):
            self._link.start()

    async def ready(self) -> RobotReport:
        """As of the link."""
        with _told(self._link.name):
            return await self._link.ready()

    async def report(self, *, soon: bool = False) -> RobotReport:
        """As of the link."""
        with _told(self._link.name):
            return await self._link.report(soon=soon)

    async def release(self, report: RobotReport) -> None:
        """As of the link."""
        with _told(self._link.name):
            await self._link.release(report)

    @asynccontextmanager
    async def motion(self, limits: MotionLimits) -> AsyncIterator["MotionOfOthers"]:
        """As of the link."""
        inside: BaseException | None = None
        try:
            async with self._link.motion(limits) as motion:
                try:
                    gate = Gate(limits.bounds or Bounds(), self._clock.now())
                    yield MotionOfOthers(motion, self._link.name, gate, self._clock)
                except BaseException as error:
                    inside = error
                    raise
        except RAISED as error:
            if error is inside:  # the run's own, on its way out
                raise
            raise_if_asked(error)
            raise code_failed(f"robot link {self._link.name}", error, link_cause(error)) from error

    async def aclose(self) -> None:
        """As of the link."""
        with _told(self._link.name):
            await self._link.aclose()


class MotionOfOthers:
    """A `Motion` around one of another package; all that is not here is the movement's own."""

    _motion: Motion
    _name: str
    _gate: Gate
    _clock: Clock

    def __init__(self, motion: Motion, name: str, gate: Gate, clock: Clock) -> None:
        object.__setattr__(self, "_motion", motion)
        object.__setattr__(self, "_name", name)
        object.__setattr__(self, "_gate", gate)
        object.__setattr__(self, "_clock", clock)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._motion, name)

    def __setattr__(self, name: str, value: Any) -> None:
        setattr(self._motion, name, value)

    async def to(self, target: Pose, *, soon: bool = False) -> Sent:
        """As of the movement. Raises GateStop for a target that the last gate stops."""
        if stopped := self._gate.judge(target, self._clock.now()):
            raise GateStop(stopped)
        try:
            with _told(self._name):
                return await self._motion.to(target, soon=soon)
        except BridgeError:
            self._gate.take_back()
            raise

    async def settled(self) -> None:
        """As of the movement."""
        with _told(self._name):
            await self._motion.settled()

    async def halt(self) -> Sent:
        """As of the movement."""
        with _told(self._name):
            return await self._motion.halt()
