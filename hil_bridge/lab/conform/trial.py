"""Conformance test of a client: scenarios in sequence, each with a fresh emulated device and a fresh client."""

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
from hil_bridge.show.pages.timeline import TimeLine
from protocol.unmodelled import NotModelled

SUITE_VERSION = 2
"""Version of the scenarios. It increases when a client that passed before may fail."""
NOMINAL, CUT = "nominal", "cut"
"""Scenarios that robots and sensors share: no fault, and a cut link."""
_POLL_S = 0.01
"""Period of the checks of device and client, s. Chosen."""

Evidence = TypeVar("Evidence", bound=Ending)
"""Type of the evidence of a scenario."""


class Mishap(NamedTuple):
    """Fault that a scenario injects."""

    on: str
    fault: str
    given: Mapping[str, Any] = {}
    """Parameters and duration of the fault."""


class InCell(NamedTuple):
    """Emulated cell of a scenario."""

    cell: Cell[Any, Any]
    clock: Clock
    failures: list[BaseException]
    """Errors that ended the service of the emulated cell."""


@dataclass(frozen=True, slots=True)
class ScenarioResult(Generic[Evidence]):
    """Result of a scenario."""

    name: str
    meaning: str
    verdict: Verdict
    seen: Evidence
    output: str
    """End of the client's output as text."""
    seconds: float
    not_modelled: tuple[NotModelled, ...] = ()
    """Features that the client used and the emulated device does not model."""


class TrialRules(Protocol):
    """Rules that all trials share, as a dataclass."""

    @property
    def end_s(self) -> float:
        """Time limit for the client to terminate on request, s."""


class Ended(Exception):
    """Signal that the client has ended, which leaves the scenario."""


class Scene(ABC, Generic[Evidence]):
    """Scenario while it is executed."""

    def __init__(self, evidence: Evidence, in_cell: InCell, client: Client, end_s: float) -> None:
        self.seen = evidence
        self._cell, self._clock, self._failures = in_cell
        self._client, self._end_s = client, end_s
        self._begun = self._clock.now()

    @abstractmethod
    async def play(self, where: Where) -> None:
        """Run the scenario: start the client, inject the fault, and end the client. Raises BridgeError."""

    def _observe(self, now: float) -> None:
        """Sample the device at `now`, s."""

    def _since(self) -> float:
        return self._clock.now() - self._begun

    def _strike(self, mishap: Mishap) -> None:
        FaultPanel(self._cell, self._clock).inject(mishap.on, mishap.fault, **mishap.given)

    def _check(self) -> None:
        if self._failures:
            cause = self._failures[0]
            if isinstance(cause, BridgeError):
                raise cause
            raise DeviceError(f"the emulated device failed: {cause!r}") from cause
        self._observe(self._clock.now())

    async def _until(self, done: Callable[[], bool] | None, seconds: float) -> None:
        """Poll until `done` returns true, or until the timeout. Raises Ended if the client ends first."""
        end = self._clock.now() + seconds
        while not (done is not None and done()) and self._clock.now() < end:
            await self._clock.sleep_until(self._clock.now() + _POLL_S)
            self._check()
            if (code := self._client.poll()) is not None:
                self.seen.exit_code, self.seen.ended_at = code, self._since()
                raise Ended

    async def _end_client(self) -> None:
        """Ask the client to terminate, and kill its processes that remain."""
        evidence = self.seen
        if evidence.exit_code is None:
            evidence.end_requested, evidence.end_requested_at = True, self._since()
            self._client.ask_to_end()
            try:
                await self._until(None, self._end_s)
                evidence.killed = True
            except Ended:
                pass
        self._client.kill()


@dataclass(frozen=True)
class Trial(ABC, Generic[Evidence]):
    """Conformance test of a client, with the rules for it."""

    thing: ClassVar[str]
    """Type of device: robot or sensor."""
    meanings: ClassVar[Mapping[str, str]]
    """Description of each scenario, in the order of execution."""

    config: Config
    """Configuration of the cell. The emulated device of the kind under test is part of it."""
    port: str
    """URL on which the device listens."""
    rules: TrialRules
    make_client: Callable[[], Client]

    @property
    def kind(self) -> str:
        """Kind of the device."""
        section: Any = getattr(self.config, self.thing)
        return str(section.emulated)

    @property
    @abstractmethod
    def mishaps(self) -> Mapping[str, Mishap | None]:
        """Scenarios that this device supports, in the order of execution, each with its fault; None for no fault.

        Raises ConfigError for a device without any.
        """

    @property
    def scenarios(self) -> Mapping[str, str]:
        """Scenarios that this device supports, in the order of execution, each with its description. Raises
        ConfigError as `mishaps` does.
        """
        return {name: self.meanings[name] for name in self.mishaps}

    def _possible(
        self, mishaps: Mapping[str, Mishap], faults: Mapping[str, Mapping[str, Any]]
    ) -> dict[str, Mishap | None]:
        """Return the scenarios whose fault an emulated device supports, and the scenario without a fault."""
        return {
            name: mishap
            for name in self.meanings
            for mishap in (mishaps.get(name),)
            if name == NOMINAL or (mishap is not None and mishap.fault in faults.get(mishap.on, {}))
        }

    @property
    @abstractmethod
    def listen(self) -> Listen:
        """Addresses on which the devices of the cell listen."""

    @abstractmethod
    def device_of(self, served: ServedCell) -> Robot | Sensor:
        """Return the device that the client connects to."""

    @abstractmethod
    def scene(self, name: str, in_cell: InCell, client: Client) -> Scene[Evidence]:
        """Create a scenario. Raises ConfigError for a device that cannot be observed."""

    @abstractmethod
    def judge(self, name: str, evidence: Evidence) -> Verdict:
        """Return the verdict on this evidence."""

    @abstractmethod
    def timeline(self, name: str, evidence: Evidence) -> TimeLine:
        """Return the time line of a scenario from its evidence."""

    @abstractmethod
    def refuse(self, name: str, nominal: ScenarioResult[Evidence]) -> ScenarioResult[Evidence] | None:
        """Return the scenario as skipped if the nominal result makes it pointless; None if it is to be run."""


def choose_scenarios(trial: Trial[Any], only: Sequence[str]) -> list[str]:
    """Return the scenarios to run. Raises ConfigError for a scenario that this device does not support."""
    known = trial.scenarios
    for name in only:
        if name not in known:
            raise ConfigError(f"no scenario {name!r} for {trial.kind}; known: {', '.join(known)}")
    return [name for name in known if not only or name in only]


async def play(name: str, trial: Trial[Evidence]) -> ScenarioResult[Evidence]:
    """Run and judge one scenario. Raises BridgeError if the emulator fails."""
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
    seconds, evidence = clock.now() - begun, scene.seen
    verdict = trial.judge(name, evidence)
    return ScenarioResult(
        name, trial.scenarios[name], verdict, evidence, client.output, seconds, tuple(things)
    )


def skip(name: str, trial: Trial[Evidence], reason: str, evidence: Evidence) -> ScenarioResult[Evidence]:
    """Return the result of a skipped scenario."""
    return ScenarioResult(name, trial.scenarios[name], Verdict(Outcome.SKIPPED, reason), evidence, "", 0.0)


def where_of(device: Robot | Sensor) -> Where:
    """Return the address of a served device for a client."""
    wire = device.kind.parse(device.url, device.settings)
    names = {"url": device.named_url}
    host, mark, port = wire.target.rpartition(":")
    if mark and port.isdigit():
        names |= {"host": host.strip("[]"), "port": port}
    elif wire.scheme == "serial":
        names["device"] = wire.target
    names |= {key: value for key, value in parse_qsl(urlsplit(device.url).query) if value.isalnum()}
    return Where(device.named_url, names)
