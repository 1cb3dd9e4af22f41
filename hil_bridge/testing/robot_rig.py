"""Rig for an emulated robot in virtual time: its clients, its true pose, and tampered transports."""

import math
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager
from typing import Any

import numpy as np

from hil_bridge.clock import Clock, run_virtual
from hil_bridge.devices.device_log import NullLog
from hil_bridge.devices.robots.seam import MotionLimits, RobotLink
from hil_bridge.devices.wiring import Wiring
from hil_bridge.errors import BridgeError
from hil_bridge.testing.cases import RobotCase
from hil_bridge.testing.naming import Finding, orientation_mistake, position_mistake
from hil_bridge.testing.rig import Rig, serving_in_memory
from protocol.geometry import Pose, normalise, product
from protocol.robot import RobotReport

SPEED_M_S = 0.05
"""Speed limit of all orders in the suites, m/s. Chosen."""
PATIENCE_S = 30.0
"""Longest wait for a call, s. Chosen: longer than any client may wait for its robot."""
STILL_M = 0.2e-3
"""Largest motion of a robot that counts as stationary, m. Chosen."""
CHECKED_S = 0.3
"""Time for which a standstill is observed, s. Chosen."""


class RobotRig(Rig):
    """Rig for an emulated robot. `connect` creates any number of clients."""

    patience_s = PATIENCE_S

    def __init__(self, case: RobotCase, clock: Clock, robot: Any, url: str) -> None:
        emulation = case.kind.emulation
        assert emulation is not None
        super().__init__(clock, emulation.faults)
        self.case, self.robot, self._url = case, robot, url
        for target, handlers in robot.handlers.items():
            self.ledger.attach(target, handlers)
        self.over = False
        """End the check."""

    async def connect(self) -> RobotLink:
        """Return a client for the robot that is not started yet."""
        wiring = Wiring("robot", self.clock, NullLog(), self.wrap)
        link: RobotLink = await self.case.kind.connect(self._url, self.case.given, wiring)
        return link

    @asynccontextmanager
    async def started(self) -> AsyncIterator[RobotLink]:
        """Provide a client that is ready, and close it on exit."""
        link = await self.connect()
        try:
            link.start()
            await self.within(link.ready(), "ready")
            yield link
        finally:
            await link.aclose()

    async def refused(
        self,
        answer: Awaitable[Any],
        name: str,
        text: str,
        errors: type[Exception] | tuple[type[Exception], ...] = BridgeError,
    ) -> None:
        """Fail with this text unless the call raises an error."""
        try:
            await self.within(answer, name)
        except errors:
            return
        raise Finding(text)

    # --- truth

    def true_pose(self, at: float | None = None) -> Pose:
        """Return the true pose of the tool at a time, by default now."""
        times = np.array([self.clock.now() if at is None else at])
        x, y, z = self.robot.path.trajectory(times)[0][0].tolist()
        ((_, quaternion),) = self.robot.path.orientations(times)
        return Pose((x, y, z), quaternion)

    async def check_stands(self, text: str) -> None:
        """Fail with this text if the robot moves."""
        before = self.true_pose().position
        await self.wait(CHECKED_S)
        distance = math.dist(before, self.true_pose().position)
        if distance > STILL_M:
            raise Finding(f"{text}: the robot moved {distance * 1e3:.1f} mm within {CHECKED_S:g} s")

    def check_report(self, report: RobotReport, speed: float = 0.0) -> None:
        """Fail, with a diagnosis, if a report differs from the true pose at its time."""
        case, true = self.case, self.true_pose(min(report.pose_at, self.clock.now()))
        allowed = case.tolerance_m + speed * case.lag_s
        if mistake := position_mistake(report.pose.position, true.position, allowed):
            raise Finding(mistake)
        turn_allowed = case.tolerance_rad + (0.05 if speed else 0.0)
        if mistake := orientation_mistake(report.pose.quaternion, true.quaternion, turn_allowed):
            raise Finding(mistake)

    def place(
        self, dx_mm: float, dy_mm: float, dz_mm: float, turn: tuple[float, float, float] = (0.0,) * 3
    ) -> Pose:
        """Return a pose near the start, offset in mm and rotated in degrees about the base axes x, y, z."""
        x, y, z = self.case.start.position
        quaternion = normalise(self.case.start.quaternion)
        for axis, degrees in enumerate(turn if self.case.turns else ()):
            half = math.radians(degrees) / 2.0
            parts = [math.cos(half), 0.0, 0.0, 0.0]
            parts[axis + 1] = math.sin(half)
            quaternion = product((parts[0], parts[1], parts[2], parts[3]), quaternion)
        return Pose((x + dx_mm * 1e-3, y + dy_mm * 1e-3, z + dz_mm * 1e-3), quaternion)


LIMITS = MotionLimits(SPEED_M_S)


@asynccontextmanager
async def robot_rig(case: RobotCase, clock: Clock) -> AsyncIterator[RobotRig]:
    """Serve the emulated robot of a case in memory."""
    given = case.given
    emulation = case.kind.emulation
    assert emulation is not None
    async with serving_in_memory(clock) as serving:
        robot = emulation.make(given)(case.start, clock.now(), 1)
        url = await emulation.serve(emulation.usual(given, True), robot, given, serving)
        rig = RobotRig(case, clock, robot, url)
        rig.ledger.on_change.append(serving.wake)
        yield rig


def run_robot(case: RobotCase, check: Callable[[RobotRig], Awaitable[None]]) -> None:
    """Run a check in virtual time, and fail if it leaves anything behind."""

    async def main() -> None:
        async with robot_rig(case, Clock.running()) as rig:
            try:
                await check(rig)
            finally:
                rig.over = True

    run_virtual(main)
