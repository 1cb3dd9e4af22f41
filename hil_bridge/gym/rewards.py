"""Rewards by name: the built-in rewards, and plug-in rewards from the entry point group `hil_bridge.rewards`.

A reward maps the cycles that resulted from an action to one number per step. A plug-in provides a class or a
function without parameters that creates a reward.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, NamedTuple, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hil_bridge.errors import ConfigError
from hil_bridge.errors.failures import failure
from hil_bridge.errors.plugins import find_plugin, plugin_names
from hil_bridge.record import CycleRecord
from hil_bridge.runs.simulation import Result

GROUP = "hil_bridge.rewards"
"""Entry point group of plug-in rewards."""
_AT_WORK = ("approach", "track")


class Transition(NamedTuple):
    """One step of an environment: an action and its result."""

    cycles: tuple[CycleRecord, ...]
    """Control cycles from the cycle that applied the action to the next decision or the end of the run."""
    seconds: float
    """Time from the decision to the next decision, or to the end of the tracking, s."""
    action: NDArray[np.float64]
    """Action of each axis, -1 to 1."""
    result: Result | None
    """Result of the run if this step ended the run, otherwise None."""
    stopped: bool
    """Whether the run was stopped by the guard, a device or a limit of the task."""

    @property
    def at_work(self) -> tuple[CycleRecord, ...]:
        """Cycles in which the run tracked the surface or searched for a lost contact; retractions are excluded."""
        return tuple(cycle for cycle in self.cycles if cycle.phase in _AT_WORK)


class Reward(Protocol):
    """Pure function that maps a step to a number."""

    def __call__(self, transition: Transition) -> float:
        """Return the reward of a step; higher is better."""


@dataclass(frozen=True, slots=True)
class ForceError:
    """Reward −∫ (|f − f_d| / f_d + p · lost) dt, minus a penalty if the run was stopped.

    The integral is over time in seconds, so that the sums of robots with different cycle times are comparable.
    """

    lost_per_s: float = 5.0
    """Penalty p while contact is lost, 1/s. Chosen: five times the cost of zero force."""
    stopped: float = 50.0
    """Penalty for a stop. Chosen: more than the cost of any ten-second episode that is not stopped."""

    def __call__(self, transition: Transition) -> float:
        """Return the reward of a step."""
        cost = self.stopped if transition.stopped else 0.0
        cycles = transition.at_work
        if cycles:
            shares = (
                abs(cycle.force - cycle.force_reference) / cycle.force_reference
                + self.lost_per_s * (not cycle.in_contact)
                for cycle in cycles
            )
            cost += sum(shares) / len(cycles) * transition.seconds
        return -cost


@dataclass(frozen=True, slots=True)
class ForceAndEffort:
    """Reward for a small force error and small actions, for smooth policies."""

    effort_per_s: float = 0.1
    """Cost of an action of 1, 1/s. Chosen: a tenth of the cost of zero force."""
    force_error: ForceError = ForceError()

    def __call__(self, transition: Transition) -> float:
        """Return the reward of a step."""
        effort = self.effort_per_s * float(np.square(transition.action).sum()) * transition.seconds
        return self.force_error(transition) - effort


Maker: TypeAlias = Callable[[], Reward]
REWARDS: Mapping[str, Maker] = MappingProxyType(
    {"force-error": ForceError, "force-and-effort": ForceAndEffort}
)
"""Built-in rewards by name."""


def make_reward(name: str) -> Reward:
    """Create a reward by name. Raises ConfigError for an unknown or ambiguous name, and for an invalid plug-in."""
    plugin = find_plugin(GROUP, "reward", name, REWARDS)
    if plugin is None:
        if name not in REWARDS:
            names = ", ".join([*REWARDS, *plugin_names(GROUP)])
            raise ConfigError(f"unknown reward {name!r}; known: {names}")
        return REWARDS[name]()
    try:
        created: Any = plugin.value()
    except (Exception, SystemExit) as error:
        raise ConfigError(f"{plugin.where} cannot be created: {failure(error)}") from error
    if not callable(created):
        raise ConfigError(
            f"{plugin.where}: {plugin.source} returns {type(created).__name__}, which is not callable"
        )
    reward: Reward = created
    return reward
