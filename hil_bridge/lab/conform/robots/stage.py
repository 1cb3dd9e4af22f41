"""Execution of the scenarios for robot clients."""

import math
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import ClassVar

from emulators.faults.packets import WIRE
from emulators.orders import ReportingRobot
from hil_bridge.devices.kinds import ROBOTS
from hil_bridge.errors import ConfigError
from hil_bridge.lab.conform.client import Client, Where
from hil_bridge.lab.conform.robots.judging import judge
from hil_bridge.lab.conform.robots.scenarios import (
    EMERGENCY,
    LATE,
    REFUSED,
    SCENARIOS,
    STILL_M,
    STILL_RAD,
    STILL_S,
    STOPPED,
    Rules,
)
from hil_bridge.lab.conform.robots.timeline import robot_timeline
from hil_bridge.lab.conform.robots.watching import RobotEvidence, ToolSample, Watch
from hil_bridge.lab.conform.trial import (
    CUT,
    NOMINAL,
    Ended,
    InCell,
    Mishap,
    ScenarioResult,
    Scene,
    Trial,
    skip,
)
from hil_bridge.lab.conform.verdict import Outcome, Verdict
from hil_bridge.runs.compose import ServedCell
from hil_bridge.runs.setup import Listen
from hil_bridge.settings.devices import Robot
from hil_bridge.show.pages.timeline import TimeLine
from protocol.geometry import angle_between


@dataclass(frozen=True)
class RobotTrial(Trial[RobotEvidence]):
    """Conformance test of a robot client."""

    thing: ClassVar[str] = "robot"
    meanings: ClassVar[Mapping[str, str]] = SCENARIOS
    rules: Rules

    @property
    def mishaps(self) -> dict[str, Mishap | None]:
        kind = ROBOTS.kind(self.kind)
        if kind.emulation is None or not kind.emulation.mishaps:
            raise ConfigError(
                f"{kind.name}: cannot test its clients, its RobotEmulation has no mishaps; "
                "see the page on conform, A robot of your own"
            )
        emulation = kind.emulation
        mishaps = {
            LATE: Mishap(WIRE, "late", {"ms": emulation.late_ms, "way": "from"}),
            EMERGENCY: Mishap("robot", "emergency-stop"),
            CUT: Mishap(WIRE, "off", {"for_s": self.rules.cut_s}),
            **{name: Mishap("robot", fault) for name, fault in emulation.mishaps.items()},
        }
        return self._possible(mishaps, emulation.faults)

    @property
    def listen(self) -> Listen:
        return Listen(self.port, None)

    def device_of(self, served: ServedCell) -> Robot:
        assert served.robot is not None
        return served.robot

    def scene(self, name: str, in_cell: InCell, client: Client) -> Scene[RobotEvidence]:
        return _RobotScene(name, self, in_cell, client)

    def judge(self, name: str, evidence: RobotEvidence) -> Verdict:
        return judge(name, evidence, self.rules)

    def timeline(self, name: str, evidence: RobotEvidence) -> TimeLine:
        return robot_timeline(name, evidence, self.rules)

    def refuse(
        self, name: str, nominal: ScenarioResult[RobotEvidence]
    ) -> ScenarioResult[RobotEvidence] | None:
        if nominal.verdict.outcome is Outcome.PASSED or nominal.seen.moved_at is not None:
            return None
        unjudged = nominal.verdict.outcome is Outcome.SKIPPED
        why = "`nominal` was skipped" if unjudged else "the client does not move the tool without a fault"
        return skip(name, self, why, RobotEvidence())


class _RobotScene(Scene[RobotEvidence]):
    """Scenario for a robot client while it is executed."""

    def __init__(self, name: str, trial: RobotTrial, in_cell: InCell, client: Client) -> None:
        robot = in_cell.cell.robot
        if not isinstance(robot, ReportingRobot):
            raise ConfigError(f"the emulated {trial.kind} does not report the orders that it receives")
        self._name, self._rules, self._robot = name, trial.rules, robot
        self._mishap = trial.mishaps[name]
        stops = name in (REFUSED, STOPPED, EMERGENCY)
        self._watch = Watch(in_cell.clock.now(), trial.rules, stops=stops, from_start=name == REFUSED)
        super().__init__(self._watch.seen, in_cell, client, trial.rules.end_s)
        robot.orders.listener = self._watch.receive

    async def play(self, where: Where) -> None:
        """Run the scenario: start the client, inject the fault, end the client, and check whether the tool stops."""
        self._check()
        if self._name == REFUSED:
            self._inject_fault()
        self._client.start(where)
        with suppress(Ended):
            await self._course()
        await self._end_client()
        await self._check_standstill()

    async def _course(self) -> None:
        rules, evidence = self._rules, self.seen
        if self._name == REFUSED:
            await self._until(lambda: evidence.first_order_at is not None, rules.start_s - rules.watch_s)
            await self._until(None, rules.watch_s)
            return
        await self._until(lambda: evidence.moved_at is not None, rules.start_s)
        if evidence.moved_at is None:
            return
        if self._name == NOMINAL:
            await self._until(None, rules.run_s)
            return
        await self._until(None, rules.after_s)
        evidence.fault_at, evidence.last_before_fault_at = self._since(), evidence.last_order_at
        self._inject_fault()
        if self._name != CUT:
            await self._until(None, rules.watch_s)
            return
        await self._until(None, rules.cut_s)
        evidence.returned_at = self._since()
        await self._until(lambda: evidence.back_at is not None, rules.back_s)
        await self._until(None, STILL_S)

    def _inject_fault(self) -> None:
        if self._mishap is not None:
            self._strike(self._mishap)

    def _observe(self, now: float) -> None:
        state = self._cell.true_state(self._cell.truth_available_from(now))
        self.seen.last_pose = state.position, state.quaternion
        tool = ToolSample(state.position, state.quaternion, state.velocity)
        self._watch.update(now, tool, self._robot.hindrance(now))

    async def _check_standstill(self) -> None:
        """Check whether the tool is stationary after the client has ended."""
        evidence = self.seen
        for _ in self._checks(self._rules.stand_s):
            before, since = evidence.last_pose, self._clock.now()
            await self._clock.sleep_until(self._clock.now() + STILL_S)
            self._check()
            assert before is not None
            assert evidence.last_pose is not None
            gone = math.dist(before[0], evidence.last_pose[0])
            turned = angle_between(before[1], evidence.last_pose[1])
            span = self._clock.now() - since
            evidence.left_m_s = gone / span if gone > STILL_M else 0.0
            evidence.left_rad_s = turned / span if turned > STILL_RAD else 0.0
            if not evidence.left_m_s and not evidence.left_rad_s:
                return

    @staticmethod
    def _checks(seconds: float) -> Iterator[int]:
        return iter(range(max(1, math.ceil(seconds / STILL_S))))
