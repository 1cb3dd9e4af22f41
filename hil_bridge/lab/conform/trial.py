"""A trial of a client: one scenario after the other, each with a fresh emulated device and a fresh client."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Generic, NamedTuple, Protocol, TypeVar
from urllib.parse import parse_qsl, urlsplit

from emulators.cell import Cell
from hil_bridge.clock import Clock, Heartbeat
from hil_bridge.errors import BridgeError, ConfigError, DeviceError
from hil_bridge.lab.conform.client import Client, Where
from hil_bridge.lab.conform.ending import Ending
from hil_bridge.lab.conform.verdict import Outcome, Verdict
from hil_bridge.runs.compose import ServedCell, emulated_cell, follow_unmodelled
from hil_bridge.runs.faults.panel import FaultPanel
from hil_bridge.runs.setup import Listen, Setup
from hil_bridge.settings.configuration import Config
from hil_bridge.settings.devices import Robot, Sensor
from protocol.unmodelled import NotModelled

SUITE_VERSION = 2
"""Grows when a client that passed may fail: to be compared by those who pin it."""
NOMINAL, CUT = "nominal", "cut"
"""Scenarios of robots and of sensors: nothing is wrong, and the wire is cut."""
_LOOK_S = 0.01
"""Chosen: time between two looks at the device and the client."""

Seen = TypeVar("Seen", bound=Ending)
"""Evidence of a scenario."""


class Mishap(NamedTuple):
    """The fault of a scenario."""

    on: str
    fault: str
    given: Mapping[str, Any] = {}
    """Its parameters, and its duration."""


class InCell(NamedTuple):
    """The emulated cell of a scenario."""

    cell: Cell[Any, Any]
    clock: Clock
    failures: list[BaseException]
    """Reasons for which it can no longer be served."""


@dataclass(frozen=True, slots=True)
class Played(Generic[Seen]):
    """A scenario that was played."""

    name: str
    meaning: str
    verdict: Verdict
    seen: Seen
    output: str
    """The end of what the client wrote."""
    seconds: float
    not_modelled: tuple[NotModelled, ...] = ()
    """Things that the client used and the emulated device does not model."""


class TrialRules(Protocol):
    """Rules that every trial has. They are a dataclass."""

    @property
    def end_s(self) -> float:
        """Time in which the client must end when it is told to, s."""


class Ended(Exception):
    """The client has ended."""


class Scene(ABC, Generic[Seen]):
    """A scenario under way."""

    def __init__(self, seen: Seen, in_cell: InCell, client: Client, end_s: float) -> None:
        self.seen = seen
        self._cell, self._clock, self._failures = in_cell
        self._client, self._end_s = client, end_s
        self._begun = self._clock.now()

    @abstractmethod
    async def play(self, where: Where) -> None:
        """All of it: the client begins, the fault comes, the client ends. Raises BridgeError for the emulator."""

    def _observe(self, now: float) -> None:
        """Look at the device at `now`, s."""

    def _since(self) -> float:
        return self._clock.now() - self._begun

    def _strike(self, mishap: Mishap) -> None:
        FaultPanel(self._cell, self._clock).inject(mishap.on, mishap.fault, **mishap.given)

    def _look(self) -> None:
        if self._failures:
            cause = self._failures[0]
            if isinstance(cause, BridgeError):
                raise cause
            raise DeviceError(f"the emulated device failed: {cause!r}") from cause
        self._observe(self._clock.now())

    async def _until(self, done: Callable[[], bool] | None, seconds: float) -> None:
        """Watch until it is done, or the time is over. Raises Ended when the client ends before."""
        end = self._clock.now() + seconds
        while not (done is not None and done()) and self._clock.now() < end:
            await self._clock.sleep_until(self._clock.now() + _LOOK_S)
            self._look()
            if (code := self._client.poll()) is not None:
                self.seen.exit_code, self.seen.ended_at = code, self._since()
                raise Ended

    async def _end_client(self) -> None:
        """Let the client end, and kill what is left of it."""
        if self.seen.exit_code is None:
            self.seen.told_to_end = True
            self._client.ask_to_end()
            try:
                await self._until(None, self._end_s)
                self.seen.killed = True
            except Ended:
                pass
        self._client.kill()


@dataclass(frozen=True)
class Trial(ABC, Generic[Seen]):
    """The client under trial, and the rules of the trial."""

    thing: ClassVar[str]
    """The device: robot or sensor."""
    meanings: ClassVar[Mapping[str, str]]
    """All scenarios with their meaning, in the order in which they are played."""

    config: Config
    """Its emulated kind is the one of the trial."""
    port: str
    """URL on which the device listens."""
    rules: TrialRules
    make_client: Callable[[], Client]

    @property
    def kind(self) -> str:
        """Name of the device's kind."""
        section: Any = getattr(self.config, self.thing)
        return str(section.emulated)

    @property
    @abstractmethod
    def mishaps(self) -> Mapping[str, Mishap | None]:
        """The fault of each scenario that this device can have, in their order.

        Raises ConfigError for a device without any.
        """

    @property
    def scenarios(self) -> Mapping[str, str]:
        """Scenarios that this device can have, in their order, with their meaning. Raises ConfigError as `mishaps`."""
        return {name: self.meanings[name] for name in self.mishaps}

    def _possible(
        self, mishaps: Mapping[str, Mishap], faults: Mapping[str, Mapping[str, Any]]
    ) -> dict[str, Mishap | None]:
        """The mishaps among the faults of an emulated device, and the scenario without one."""
        return {
            name: mishap
            for name in self.meanings
            for mishap in (mishaps.get(name),)
            if name == NOMINAL or (mishap is not None and mishap.fault in faults.get(mishap.on, {}))
        }

    @property
    @abstractmethod
    def listen(self) -> Listen:
        """Where the devices of the cell listen."""

    @abstractmethod
    def device_of(self, served: ServedCell) -> Robot | Sensor:
        """The device that the client comes to."""

    @abstractmethod
    def scene(self, name: str, in_cell: InCell, client: Client) -> Scene[Seen]:
        """A scenario that is about to begin. Raises ConfigError for a device that cannot be watched."""

    @abstractmethod
    def judge(self, name: str, seen: Seen) -> Verdict:
        """The verdict on this evidence."""

    @abstractmethod
    def refuse(self, name: str, nominal: Played[Seen]) -> Played[Seen] | None:
        """The scenario as skipped, where it makes no sense behind this one; None where it is to be played."""


def choose_scenarios(trial: Trial[Any], only: Sequence[str]) -> list[str]:
    """Names of the scenarios to be played. Raises ConfigError for one that this device does not have."""
    there = trial.scenarios
    for name in only:
        if name not in there:
            raise ConfigError(f"no scenario {name!r} for {trial.kind}; there are {', '.join(there)}")
    return [name for name in there if not only or name in only]


async def play(name: str, trial: Trial[Seen]) -> Played[Seen]:
    """Play one scenario and judge. Raises BridgeError when the emulator cannot be served."""
    clock = Clock.running()
    client = trial.make_client()
    failures: list[BaseException] = []
    things: list[NotModelled] = []
    heart, begun = Heartbeat(clock), clock.now()
    try:
        async with emulated_cell(Setup(trial.config, trial.listen), clock, failures.append) as served:
            follow_unmodelled(served.cell, things.append)
            scene = trial.scene(name, InCell(served.cell, clock, failures), client)
            heart.start()
            await scene.play(where_of(trial.device_of(served)))
            scene.seen.late_s = heart.take()
    finally:
        client.kill()
        heart.stop()
        clock.close()
    seconds, seen = clock.now() - begun, scene.seen
    verdict = trial.judge(name, seen)
    return Played(name, trial.scenarios[name], verdict, seen, client.output, seconds, tuple(things))


def skip(name: str, trial: Trial[Seen], reason: str, seen: Seen) -> Played[Seen]:
    """A scenario that is not played."""
    return Played(name, trial.scenarios[name], Verdict(Outcome.SKIPPED, reason), seen, "", 0.0)


def where_of(device: Robot | Sensor) -> Where:
    """How a client finds a device that is served."""
    wire = device.kind.parse(device.url, device.settings)
    names = {"url": device.named_url}
    host, mark, port = wire.target.rpartition(":")
    if mark and port.isdigit():
        names |= {"host": host.strip("[]"), "port": port}
    elif wire.scheme == "serial":
        names["device"] = wire.target
    names |= {key: value for key, value in parse_qsl(urlsplit(device.url).query) if value.isalnum()}
    return Where(device.named_url, names)
