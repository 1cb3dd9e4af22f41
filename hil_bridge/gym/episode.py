"""Episode: a run of the bridge in virtual time that pauses at each decision until it receives an action.

Virtual time does not advance while the policy computes, unless the settings contain a thinking time.
"""

import threading
from collections.abc import Callable
from pathlib import Path
from queue import SimpleQueue
from typing import NamedTuple, Protocol

import numpy as np

from hil_bridge.api import run_virtual
from hil_bridge.control.laws.policy import Axis, Observed, PolicyController
from hil_bridge.control.laws.thinking import Thinking
from hil_bridge.errors import BridgeError, ConfigError
from hil_bridge.lab.campaign.overlay import config_with
from hil_bridge.record import CycleRecord, Outcome
from hil_bridge.runs.simulation import Result, Simulation, simulating
from hil_bridge.settings.configuration import Config
from hil_bridge.settings.given import config_of
from protocol.geometry import Vector


class EpisodeSettings(NamedTuple):
    """Settings of an episode, as plain values that another process can receive."""

    base: str
    """Common configuration of the episodes, as JSON."""
    drawn: str
    """Settings and faults drawn for this episode, as JSON."""
    seed: int
    axes: tuple[Axis, ...]
    speeds: tuple[float, float]
    """Speeds for an action of 1, mm/s and °/s."""
    thinking_ms: Thinking
    truth: bool
    """Whether decisions contain the true state. It takes a tenth of the time of a step."""
    keep: Path | None
    """Folder for the recording of a stopped run; None if it is not saved."""

    def config(self) -> Config:
        """Return the configuration of the run. Raises ConfigError for contradictory settings."""
        return config_with(self.base, self.drawn, self.seed)


class Truth(NamedTuple):
    """True state of the tool."""

    position: Vector
    """Position in the base frame, m."""
    force: Vector
    """Force of the surface on the tool in the base frame, N."""


class Decision(NamedTuple):
    """Request of the run for a decision."""

    observed: bytes
    """Observation as bytes, which pass between processes much faster than an array."""
    at: float
    """Time on the run's clock, s."""
    cycles: tuple[CycleRecord, ...]
    """Control cycles since the previous decision; empty for the first one."""
    truth: Truth | None

    @property
    def observation(self) -> Observed:
        """Observation as a new array."""
        return np.frombuffer(self.observed, np.float32).copy()


class Choice(NamedTuple):
    """Answer of the policy to a decision."""

    action: tuple[float, ...]
    thought_s: float
    """Wall-clock time that the policy took, s."""


class EpisodeEnd(NamedTuple):
    """End of the run, with its result."""

    result: Result | None
    """Result of the run; None if a device refused to start before any motion."""
    cycles: tuple[CycleRecord, ...]
    """Control cycles since the previous decision."""
    text: str
    """Reason why the run ended; empty if it completed."""

    @property
    def stopped(self) -> bool:
        """Whether the run was stopped by the guard, a device or a limit of the task."""
        return self.result is None or self.result.outcome is Outcome.STOPPED


class Episode(Protocol):
    """Run of the bridge that is executed one decision at a time."""

    def start(self) -> Decision | EpisodeEnd:
        """Run to the first decision. Raises ConfigError for a configuration that cannot be run."""

    def act(self, choice: Choice) -> Decision | EpisodeEnd:
        """Apply an action and run to the next decision."""

    def leave(self) -> None:
        """Abandon a run that waits for an action. Idempotent."""


class EpisodeRun:
    """Run of an episode that calls a function for each decision. The function returns None to end the run: the tool
    then holds its position and retracts.
    """

    def __init__(self, settings: EpisodeSettings, decide: Callable[[Decision], Choice | None]) -> None:
        self._settings = settings
        self._decide = decide
        self._hold = (0.0,) * len(settings.axes)
        self._cycles: list[CycleRecord] | None = None
        self._simulation: Simulation | None = None
        self._thought_s = 0.0
        self._left = False

    def carry_out(self) -> EpisodeEnd:
        """Carry out the run. Raises ConfigError for a configuration that cannot be run."""
        settings = self._settings
        controller = PolicyController(
            self._ask,
            settings.axes,
            *settings.speeds,
            thinking_ms=settings.thinking_ms,
            thinking_seed=settings.seed,
            stopwatch=lambda: self._thought_s,
        )
        config = config_of(settings.config(), controller=controller)
        try:
            result = run_virtual(lambda: self._main(config))
        except ConfigError:
            raise
        except BridgeError as error:
            return EpisodeEnd(None, self._since(), str(error))
        end = EpisodeEnd(result, self._since(), result.text)
        if end.stopped and settings.keep is not None and not self._left:
            settings.keep.mkdir(parents=True, exist_ok=True)
            result.save(_free_place(settings.keep, f"episode-{settings.seed}"))
        return end

    async def _main(self, config: Config) -> Result:
        async with simulating(config, self._observe) as simulation:
            self._simulation = simulation
            await simulation.finished()
        return simulation.result

    def _observe(self, cycle: CycleRecord) -> None:
        if self._cycles is not None:
            self._cycles.append(cycle)

    def _since(self) -> tuple[CycleRecord, ...]:
        """Return the cycles since the previous call; none for the first call."""
        cycles, self._cycles = self._cycles, []
        return tuple(cycles or ())

    def _ask(self, observation: Observed) -> tuple[float, ...]:
        """Return the action for an observation."""
        simulation = self._simulation
        if self._left or simulation is None:
            return self._hold
        truth = None
        if self._settings.truth:
            state = simulation.truth()
            truth = Truth(state.position, state.contact_force)
        at = simulation.clock.now()
        choice = self._decide(Decision(observation.tobytes(), at, self._since(), truth))
        if choice is None:
            self._left = True
            simulation.interrupt()
            return self._hold
        self._thought_s += choice.thought_s
        return choice.action


class ThreadEpisode:
    """Episode in a thread with its own event loop.

    One of the two threads always waits for the other, so they never access shared data at the same time.
    """

    def __init__(self, settings: EpisodeSettings) -> None:
        self._episode = EpisodeRun(settings, self._decide)
        # Each holds at most one item.
        self._decisions: SimpleQueue[Decision | EpisodeEnd | BaseException] = SimpleQueue()
        self._choices: SimpleQueue[Choice | None] = SimpleQueue()
        self._thread = threading.Thread(target=self._run, name="episode", daemon=True)

    def start(self) -> Decision | EpisodeEnd:
        """Run to the first decision. Raises ConfigError for a configuration that cannot be run."""
        self._thread.start()
        return self._next()

    def act(self, choice: Choice) -> Decision | EpisodeEnd:
        """Apply an action and run to the next decision."""
        self._choices.put(choice)
        return self._next()

    def leave(self) -> None:
        """End a run that waits for an action: the tool holds its position and then retracts. Idempotent."""
        if self._thread.is_alive():
            self._choices.put(None)
            self._thread.join()

    def _next(self) -> Decision | EpisodeEnd:
        answer = self._decisions.get()
        if isinstance(answer, BaseException):
            self._thread.join()
            raise answer
        if isinstance(answer, EpisodeEnd):
            self._thread.join()
        return answer

    # --- in the thread of the run

    def _run(self) -> None:
        try:
            self._decisions.put(self._episode.carry_out())
        except BaseException as error:  # for the other thread, which waits
            self._decisions.put(error)

    def _decide(self, decision: Decision) -> Choice | None:
        self._decisions.put(decision)
        return self._choices.get()


def _free_place(folder: Path, name: str) -> Path:
    """Return a file path that does not exist yet."""
    place, number = folder / f"{name}.mcap", 1
    while place.exists():
        number += 1
        place = folder / f"{name}-{number}.mcap"
    return place
