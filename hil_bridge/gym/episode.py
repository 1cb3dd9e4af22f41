"""Episode: a run of the bridge in virtual time that pauses at each decision until it receives an action.

The run has its own thread and event loop. Virtual time does not advance while the policy computes. One of the two
threads always waits for the other, so they never access shared data at the same time.
"""

import threading
from queue import SimpleQueue
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hil_bridge.api import run_virtual
from hil_bridge.control.laws.policy import Axis, Observed, PolicyController
from hil_bridge.errors import BridgeError, ConfigError
from hil_bridge.record import CycleRecord
from hil_bridge.runs.simulation import Result, Simulation, simulating
from hil_bridge.settings.configuration import Config
from hil_bridge.settings.given import config_of
from protocol.geometry import Vector

Action: TypeAlias = NDArray[np.float64]


class Decision(NamedTuple):
    """Request of the run for a decision, with the true state of the tool."""

    observation: Observed
    at: float
    """Time on the run's clock, s."""
    cycles: tuple[CycleRecord, ...]
    """Number of control cycles since the previous decision."""
    position: Vector
    """True position of the tool, base frame, m."""
    force: Vector
    """True force of the surface on the tool, base frame, N."""


class EpisodeEnd(NamedTuple):
    """End of the run, with its result."""

    result: Result | None
    """Result of the run; None if a device refused to start before any motion."""
    cycles: tuple[CycleRecord, ...]
    """Number of control cycles since the previous decision."""
    text: str
    """Reason why the run ended; empty if it completed."""


class Episode:
    """Run of the bridge that is executed one decision at a time."""

    def __init__(self, config: Config, axes: tuple[Axis, ...], speeds: tuple[float, float]) -> None:
        """Create an episode. `speeds` are the speeds for an action of 1, mm/s and °/s."""
        self.config = config_of(config, controller=PolicyController(self._ask, axes, *speeds))
        self._hold = np.zeros(len(axes))
        self._cycles: list[CycleRecord] = []
        self._simulation: Simulation | None = None
        # Each holds at most one item.
        self._decisions: SimpleQueue[Decision | EpisodeEnd | BaseException] = SimpleQueue()
        self._actions: SimpleQueue[Action | None] = SimpleQueue()
        self._left = False
        self._thread = threading.Thread(target=self._run, name="episode", daemon=True)

    def start(self) -> Decision | EpisodeEnd:
        """Run to the first decision. Raises ConfigError for a configuration that cannot be run."""
        self._thread.start()
        return self._next()

    def act(self, action: Action) -> Decision | EpisodeEnd:
        """Apply an action and run to the next decision."""
        self._actions.put(action)
        return self._next()

    def leave(self) -> None:
        """End a run that waits for an action: the tool holds its position and then retracts. Idempotent."""
        if self._thread.is_alive():
            self._actions.put(None)
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
            result = run_virtual(self._main)
            self._decisions.put(EpisodeEnd(result, self._since(), result.text))
        except ConfigError as error:
            self._decisions.put(error)
        except BridgeError as error:
            self._decisions.put(EpisodeEnd(None, self._since(), str(error)))
        except BaseException as error:  # for the other thread, which waits
            self._decisions.put(error)

    async def _main(self) -> Result:
        async with simulating(self.config, self._cycles.append) as simulation:
            self._simulation = simulation
            await simulation.finished()
        return simulation.result

    def _since(self) -> tuple[CycleRecord, ...]:
        cycles = tuple(self._cycles)
        self._cycles.clear()
        return cycles

    def _ask(self, observation: Observed) -> Action:
        """Request an action from the thread of the policy."""
        simulation = self._simulation
        if self._left or simulation is None:
            return self._hold
        truth = simulation.truth()
        at = simulation.clock.now()
        self._decisions.put(Decision(observation, at, self._since(), truth.position, truth.contact_force))
        action = self._actions.get()
        if action is None:
            self._left = True
            simulation.interrupt()
            return self._hold
        return action
