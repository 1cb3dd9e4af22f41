"""An emulated robot behind its wire in virtual time, with its client, its truth, and hands on both."""

import asyncio
import math
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import AsyncExitStack, asynccontextmanager
from typing import Any

import numpy as np

from emulators.faults import Ledger
from hil_bridge.clock import Clock, run_virtual
from hil_bridge.devices.device_log import Silence
from hil_bridge.devices.robots.seam import MotionLimits, RobotLink
from hil_bridge.devices.wiring import Serving, Wiring
from hil_bridge.errors import BridgeError
from hil_bridge.testing.cases import RobotCase
from hil_bridge.testing.meddling import Meddled
from hil_bridge.testing.naming import Finding, orientation_mistake, position_mistake
from hil_bridge.transports import Transport
from protocol.geometry import Pose, normalise, product
from protocol.robot import RobotReport

SPEED_M_S = 0.05
"""Chosen: of all orders of the suites."""
PATIENCE_S = 30.0
"""Chosen: longer than any client may wait for its robot."""
STILL_M = 0.2e-3
"""Chosen: a robot that moves less has stood."""
CHECKED_S = 0.3
"""Chosen: for so long it is watched whether a robot stands."""


class RobotRig:
    """One emulated robot. Its client is made by `connect`, as often as wanted."""

    def __init__(self, case: RobotCase, clock: Clock, robot: Any, url: str) -> None:
        self.case, self.clock, self.robot, self._url = case, clock, robot, url
        emulation = case.kind.emulation
        assert emulation is not None
        self.ledger = Ledger(emulation.faults)
        for target, handlers in robot.handlers.items():
            self.ledger.attach(target, handlers)
        self.wires: list[Meddled] = []
        """Wires of the clients, in the order in which they were opened."""
        self.over = False
        """The check has ended."""

    async def connect(self) -> RobotLink:
        """A client for the robot, not started yet."""
        wiring = Wiring("robot", self.clock, Silence(), self._wrap)
        link: RobotLink = await self.case.kind.connect(self._url, self.case.given, wiring)
        return link

    @asynccontextmanager
    async def started(self) -> AsyncIterator[RobotLink]:
        """A client that is ready, closed when the context is left."""
        link = await self.connect()
        try:
            link.start()
            await self.within(link.ready(), "ready")
            yield link
        finally:
            await link.aclose()

    def _wrap(self, device: str, wire: Transport[Any]) -> Transport[Any]:
        meddled = Meddled(wire)
        self.wires.append(meddled)
        return meddled

    async def within(self, answer: Awaitable[Any], name: str) -> Any:
        """The answer, which must come, or fail, some time."""
        try:
            async with asyncio.timeout(PATIENCE_S):
                return await answer
        except TimeoutError:
            raise Finding(
                f"`{name}` waits for ever: no answer and no error within {PATIENCE_S:g} s"
            ) from None

    async def refused(
        self,
        answer: Awaitable[Any],
        name: str,
        words: str,
        errors: type[Exception] | tuple[type[Exception], ...] = BridgeError,
    ) -> None:
        """Fail with these words unless the answer is an error."""
        try:
            await self.within(answer, name)
        except errors:
            return
        raise Finding(words)

    async def wait(self, seconds: float) -> None:
        """Let time pass; faults end at their times."""
        ends = self.clock.now() + seconds
        while (due := self.ledger.next_deadline()) is not None and due < ends:
            await self.clock.sleep_until(due)
            self.ledger.handle_deadline(due)
        await self.clock.sleep_until(ends)

    # --- truth

    def true_pose(self, at: float | None = None) -> Pose:
        """Where the tool is, or was."""
        times = np.array([self.clock.now() if at is None else at])
        x, y, z = self.robot.path.trajectory(times)[0][0].tolist()
        ((_, quaternion),) = self.robot.path.orientations(times)
        return Pose((x, y, z), quaternion)

    async def check_stands(self, words: str) -> None:
        """Fail, with these words, where the robot moves."""
        before = self.true_pose().position
        await self.wait(CHECKED_S)
        moved = math.dist(before, self.true_pose().position)
        if moved > STILL_M:
            raise Finding(f"{words}: the robot moved {moved * 1e3:.1f} mm within {CHECKED_S:g} s")

    def check_report(self, report: RobotReport, speed: float = 0.0) -> None:
        """Fail, with the mistake's name, where a report differs from the truth of its moment."""
        case, true = self.case, self.true_pose(min(report.pose_at, self.clock.now()))
        allowed = case.tolerance_m + speed * case.lag_s
        if words := position_mistake(report.pose.position, true.position, allowed):
            raise Finding(words)
        turn_allowed = case.tolerance_rad + (0.05 if speed else 0.0)
        if words := orientation_mistake(report.pose.quaternion, true.quaternion, turn_allowed):
            raise Finding(words)

    def place(
        self, dx_mm: float, dy_mm: float, dz_mm: float, turn: tuple[float, float, float] = (0.0,) * 3
    ) -> Pose:
        """A pose around the start: so many mm off, and turned by so many degrees about base x, y, z."""
        x, y, z = self.case.start.position
        quaternion = normalise(self.case.start.quaternion)
        for axis, degrees in enumerate(turn if self.case.turns else ()):
            half = math.radians(degrees) / 2.0
            parts = [math.cos(half), 0.0, 0.0, 0.0]
            parts[axis + 1] = math.sin(half)
            quaternion = product((parts[0], parts[1], parts[2], parts[3]), quaternion)
        return Pose((x + dx_mm * 1e-3, y + dy_mm * 1e-3, z + dz_mm * 1e-3), quaternion)

    def inject(self, target: str, fault: str) -> bool:
        """Let a fault happen, with its defaults; False for one that this robot cannot have now."""
        try:
            self.ledger.inject(target, fault, self.clock.now(), self._amounts(target, fault))
        except ValueError:
            return False
        return True

    def _amounts(self, target: str, fault: str) -> dict[str, object]:
        """Values for parameters of which one must not be 0."""
        found = self.ledger.table[target][fault]
        return {name: max(found.parameters[name].maximum / 100.0, 1e-3) for name in found.amounts[:1]}

    def mend(self) -> None:
        """End the faults that last."""
        self.ledger.mend(self.clock.now())


LIMITS = MotionLimits(SPEED_M_S)


@asynccontextmanager
async def robot_rig(case: RobotCase, clock: Clock) -> AsyncIterator[RobotRig]:
    """The emulated robot of a case, listening in memory."""
    given = case.given
    emulation = case.kind.emulation
    assert emulation is not None
    failed: list[BaseException] = []
    async with AsyncExitStack() as stack:
        serving = Serving(clock, stack, failed.append, lambda text: None)
        robot = emulation.make(given)(case.start, clock.now(), 1)
        url = await emulation.serve(emulation.usual(given, True), robot, given, serving)
        rig = RobotRig(case, clock, robot, url)
        rig.ledger.on_change.append(serving.wake)
        yield rig
        if failed and not isinstance(failed[0], BridgeError):
            raise failed[0]


def run_robot(case: RobotCase, check: Callable[[RobotRig], Awaitable[None]]) -> None:
    """Run a check in virtual time; nothing may be left behind."""

    async def main() -> None:
        async with robot_rig(case, Clock.running()) as rig:
            try:
                await check(rig)
            finally:
                rig.over = True

    run_virtual(main)
