"""One scenario after the other, each with a fresh emulated robot and a fresh client."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, NamedTuple
from urllib.parse import parse_qsl, urlsplit

from emulators.cell import Cell
from emulators.faults.packets import WIRE
from emulators.orders import TellingRobot
from hil_bridge.clock import Clock
from hil_bridge.devices.kinds import ROBOTS
from hil_bridge.errors import BridgeError, ConfigError, DeviceError
from hil_bridge.lab.conform.client import Client, Where
from hil_bridge.lab.conform.robots.judging import Outcome, Verdict, judge
from hil_bridge.lab.conform.robots.scenarios import (
    CUT,
    EMERGENCY,
    LATE,
    NOMINAL,
    REFUSED,
    SCENARIOS,
    STILL_M,
    STILL_RAD,
    STILL_S,
    STOPPED,
    Rules,
)
from hil_bridge.lab.conform.robots.watching import Seen, ToolLook, Watch
from hil_bridge.runs.compose import emulated_cell, follow_unmodelled
from hil_bridge.runs.faults.panel import FaultPanel
from hil_bridge.runs.setup import Listen, Setup
from hil_bridge.settings.configuration import Config
from hil_bridge.settings.devices import Robot
from protocol.geometry import angle_between
from protocol.unmodelled import NotModelled

_LOOK_S = 0.01
"""Chosen: time between two looks at the robot and the client."""


class Mishap(NamedTuple):
    """The fault of a scenario."""

    on: str
    fault: str
    given: Mapping[str, Any] = {}
    """Its parameters, and its duration."""


@dataclass(frozen=True, slots=True)
class Played:
    """A scenario that was played."""

    name: str
    verdict: Verdict
    seen: Seen
    output: str
    """The end of what the client wrote."""
    seconds: float
    not_modelled: tuple[NotModelled, ...] = ()
    """Things that the client used and the emulated robot does not model."""


@dataclass(frozen=True, slots=True)
class Trial:
    """The client under trial, and the rules of the trial."""

    config: Config
    """The kind of robot is `robot.emulated`."""
    port: str
    """URL on which the robot listens."""
    rules: Rules
    make_client: Callable[[], Client]

    @property
    def mishaps(self) -> dict[str, Mishap | None]:
        """The fault of each scenario, in the order of the scenarios. Raises ConfigError for a robot without any."""
        kind = ROBOTS.kind(self.config.robot.emulated)
        if kind.emulation is None or not kind.emulation.mishaps:
            raise ConfigError(f"{kind.name}: its emulator says no mishaps by which a client can be judged")
        emulation = kind.emulation
        mishaps = {
            LATE: Mishap(WIRE, "late", {"ms": emulation.late_ms, "way": "from"}),
            EMERGENCY: Mishap("robot", "emergency-stop"),
            CUT: Mishap(WIRE, "off", {"for_s": self.rules.cut_s}),
            **{name: Mishap("robot", fault) for name, fault in emulation.mishaps.items()},
        }
        can_have = {
            name: mishap
            for name, mishap in mishaps.items()
            if mishap.fault in emulation.faults.get(mishap.on, {})
        }
        return {name: can_have.get(name) for name in SCENARIOS if name == NOMINAL or name in can_have}


def choose_scenarios(trial: Trial, only: Sequence[str]) -> list[str]:
    """Names of the scenarios to be played. Raises ConfigError for one that this robot does not have."""
    there = trial.mishaps
    for name in only:
        if name not in there:
            raise ConfigError(
                f"no scenario {name!r} for {trial.config.robot.emulated}; there are {', '.join(there)}"
            )
    return [name for name in there if not only or name in only]


async def play(name: str, trial: Trial) -> Played:
    """Play one scenario and judge. Raises BridgeError when the emulator cannot be served."""
    clock = Clock.running()
    client = trial.make_client()
    failures: list[BaseException] = []
    things: list[NotModelled] = []
    begun = clock.now()
    try:
        setup = Setup(trial.config, Listen(trial.port, None))
        async with emulated_cell(setup, clock, failures.append) as served:
            assert served.robot is not None
            follow_unmodelled(served.cell, things.append)
            scene = _Scene(name, trial, _ServedCell(served.cell, clock, failures), client)
            await scene.play(where_of(served.robot))
            seen = scene.watch.seen
    finally:
        client.kill()
        clock.close()
    seconds = clock.now() - begun
    return Played(name, judge(name, seen, trial.rules), seen, client.output, seconds, tuple(things))


def refuse_scenario(name: str, nominal: Played) -> Played:
    """A scenario that makes no sense, because the client does not even move the tool."""
    unjudged = nominal.verdict.outcome is Outcome.SKIPPED
    why = "`nominal` was skipped" if unjudged else "the client does not move the tool when nothing is wrong"
    return Played(name, Verdict(Outcome.SKIPPED, why), Seen(), "", 0.0)


class _Ended(Exception):
    """The client has ended."""


class _ServedCell(NamedTuple):
    """The emulated cell of a scenario."""

    cell: Cell[Any, Any]
    clock: Clock
    failures: list[BaseException]
    """Reasons for which it can no longer be served."""


class _Scene:
    """A scenario under way."""

    def __init__(self, name: str, trial: Trial, served: _ServedCell, client: Client) -> None:
        cell, clock, failures = served
        robot = cell.robot
        if not isinstance(robot, TellingRobot):
            raise ConfigError(
                f"an emulated {trial.config.robot.emulated} does not tell the orders that it hears"
            )
        self._name, self._trial, self._cell, self._client, self._clock = name, trial, cell, client, clock
        self._failures, self._robot = failures, robot
        self._begun = clock.now()
        stops = name in (REFUSED, STOPPED, EMERGENCY)
        self.watch = Watch(self._begun, trial.rules, stops=stops, from_start=name == REFUSED)
        robot.orders.listener = self.watch.hear

    async def play(self, where: Where) -> None:
        """All of it: the client begins, the fault comes, the client ends, the tool stands or not."""
        self._look()
        if self._name == REFUSED:
            self._strike()
        self._client.start(where)
        with suppress(_Ended):
            await self._course()
        await self._end()

    async def _course(self) -> None:
        rules, seen = self._trial.rules, self.watch.seen
        if self._name == REFUSED:
            await self._until(lambda: seen.first_order_at is not None, rules.start_s - rules.watch_s)
            await self._until(None, rules.watch_s)
            return
        await self._until(lambda: seen.moved_at is not None, rules.start_s)
        if seen.moved_at is None:
            return
        if self._name == NOMINAL:
            await self._until(None, rules.run_s)
            return
        await self._until(None, rules.after_s)
        seen.fault_at = self._since()
        self._strike()
        if self._name != CUT:
            await self._until(None, rules.watch_s)
            return
        await self._until(None, rules.cut_s)
        seen.returned_at = self._since()
        await self._until(lambda: seen.back_at is not None, rules.back_s)
        await self._until(None, STILL_S)

    def _since(self) -> float:
        return self._clock.now() - self._begun

    def _strike(self) -> None:
        if (mishap := self._trial.mishaps[self._name]) is not None:
            FaultPanel(self._cell, self._clock).inject(mishap.on, mishap.fault, **mishap.given)

    async def _until(self, done: Callable[[], bool] | None, seconds: float) -> None:
        """Watch until it is done, or the time is over. Raises _Ended when the client ends before."""
        end = self._clock.now() + seconds
        while not (done is not None and done()) and self._clock.now() < end:
            await self._clock.sleep_until(self._clock.now() + _LOOK_S)
            self._look()
            if (code := self._client.poll()) is not None:
                self.watch.seen.exit_code, self.watch.seen.ended_at = code, self._since()
                raise _Ended

    def _look(self) -> None:
        if self._failures:
            cause = self._failures[0]
            if isinstance(cause, BridgeError):
                raise cause
            raise DeviceError(f"the emulated robot failed: {cause!r}") from cause
        now = self._clock.now()
        state = self._cell.true_state(self._cell.truth_available_from(now))
        seen = self.watch.seen
        seen.last_pose = state.position, state.quaternion
        tool = ToolLook(state.position, state.quaternion, state.velocity)
        self.watch.look(now, tool, self._robot.hindrance(now))

    async def _end(self) -> None:
        """Let the client end, then see whether the tool stands."""
        rules, seen, client = self._trial.rules, self.watch.seen, self._client
        if seen.exit_code is None:
            seen.told_to_end = True
            client.ask_to_end()
            try:
                await self._until(None, rules.end_s)
                seen.killed = True
            except _Ended:
                pass
        client.kill()
        for _ in self._looks(rules.stand_s):
            before, since = seen.last_pose, self._clock.now()
            await self._clock.sleep_until(self._clock.now() + STILL_S)
            self._look()
            assert before is not None
            assert seen.last_pose is not None
            gone = math.dist(before[0], seen.last_pose[0])
            turned = angle_between(before[1], seen.last_pose[1])
            span = self._clock.now() - since
            seen.left_m_s = gone / span if gone > STILL_M else 0.0
            seen.left_rad_s = turned / span if turned > STILL_RAD else 0.0
            if not seen.left_m_s and not seen.left_rad_s:
                return

    @staticmethod
    def _looks(seconds: float) -> Iterator[int]:
        return iter(range(max(1, math.ceil(seconds / STILL_S))))


def where_of(robot: Robot) -> Where:
    """How a client finds a robot that is served."""
    wire = robot.kind.parse(robot.url, robot.settings)
    names = {"url": robot.named_url}
    host, mark, port = wire.target.rpartition(":")
    if mark and port.isdigit():
        names |= {"host": host.strip("[]"), "port": port}
    elif wire.scheme == "serial":
        names["device"] = wire.target
    names |= {key: value for key, value in parse_qsl(urlsplit(robot.url).query) if value.isalnum()}
    return Where(robot.named_url, names)
