"""Scenarios of all kinds of robot in virtual time, with our own links as clients, without processes and ports."""

import asyncio
from collections.abc import Callable
from dataclasses import dataclass, field

import pytest

from hil_bridge.clock import Clock, run_virtual
from hil_bridge.devices.device_log import NullLog
from hil_bridge.devices.robots.seam import MotionLimits
from hil_bridge.devices.wiring import Wiring
from hil_bridge.errors import BridgeError
from hil_bridge.lab.conform.client import Where
from hil_bridge.lab.conform.robots.scenarios import SCENARIOS, Rules
from hil_bridge.lab.conform.robots.stage import RobotTrial
from hil_bridge.lab.conform.robots.watching import RobotEvidence
from hil_bridge.lab.conform.trial import ScenarioResult, play
from hil_bridge.lab.conform.verdict import Outcome
from hil_bridge.runs.compose import choose_port, connect_robot
from hil_bridge.settings.configuration import Config, load_config
from hil_bridge.settings.devices import robot_at
from protocol.geometry import Pose

pytestmark = pytest.mark.sweep

KINDS = ("s3", "egm", "rtde", "rsi")
RULES = Rules(run_s=3.0, start_s=12.0, watch_s=1.5, react_s=1.0)
CALM = MotionLimits(0.02)


@dataclass
class Linked:
    """Client in this process: one of our links that moves down step by step, with its reaction to a failure."""

    config: Config
    stubborn: bool = False
    output: str = ""
    on_output: "Callable[[bytes], object] | None" = None
    _task: "asyncio.Task[None] | None" = field(default=None, init=False)

    def start(self, where: Where) -> None:
        self._task = asyncio.get_running_loop().create_task(self._go(where.url))

    async def _go(self, url: str) -> None:
        clock = Clock.running()
        robot = await connect_robot(robot_at(self.config, url), Wiring("robot", clock, NullLog()))
        try:
            robot.start()
            (x, y, z), quaternion = (await robot.ready()).pose
            async with robot.motion(CALM) as motion:
                for step in range(1000):
                    await motion.to(Pose((x, y, z - 1e-4 * step), quaternion))
                    await clock.sleep_until(clock.now() + 0.02)
                    await robot.report()
        finally:
            await robot.aclose()

    def poll(self) -> int | None:
        if self._task is None or not self._task.done():
            return None
        if self._task.cancelled():
            return -15
        return 1 if isinstance(self._task.exception(), BridgeError) else -6

    def ask_to_end(self) -> None:
        assert self._task is not None
        self._task.cancel()

    def kill(self) -> None:
        if self._task is not None:
            self._task.cancel()


def trial(kind: str) -> RobotTrial:
    config = load_config(None, {"robot.emulated": kind})
    return RobotTrial(
        config, choose_port(robot_at(config, ""), virtual=True).named_url, RULES, lambda: Linked(config)
    )


def run_scenario(kind: str, scenario: str) -> ScenarioResult[RobotEvidence]:
    async def main() -> ScenarioResult[RobotEvidence]:
        one = await play(scenario, trial(kind))
        await asyncio.sleep(1.0)  # lets cancelled tasks end
        return one

    return run_virtual(main)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("scenario", [*SCENARIOS])
def test_own_robot_link_passes(kind: str, scenario: str) -> None:
    one = run_scenario(kind, scenario)
    assert one.verdict.outcome is Outcome.PASSED, one.verdict.reason
    assert one.not_modelled == ()
    if scenario != "refused":
        assert one.seen.moved_m > 0.5e-3
        assert one.seen.taken > 5
