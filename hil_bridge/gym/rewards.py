"""Rewards by name: ours, and those of other packages by the entry point group `hil_bridge.rewards`.

A reward is a number per step, from the cycles that the action has led to. A package offers a class or a function
without parameters that makes one.
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
"""Entry point group of other packages' rewards."""
_AT_WORK = ("approach", "track")


class Transition(NamedTuple):
    """A step of an environment: what an action has led to."""

    cycles: tuple[CycleRecord, ...]
    """Control cycles from the one that the action decided, to the next decision or the end of the run."""
    seconds: float
    """Time from the decision to the next one, or to the end of the tracking, s."""
    action: NDArray[np.float64]
    """Shares of the farthest way, one for each axis."""
    result: Result | None
    """Result of the run, where this step has ended it."""
    stopped: bool
    """The run was stopped: by the guard, a device or a limit of the task."""

    @property
    def at_work(self) -> tuple[CycleRecord, ...]:
        """Cycles that tracked, or looked for a contact that was lost; no retraction."""
        return tuple(cycle for cycle in self.cycles if cycle.phase in _AT_WORK)


class Reward(Protocol):
    """A reward: a pure function of a step."""

    def __call__(self, transition: Transition) -> float:
        """The reward of a step; more is better."""


@dataclass(frozen=True, slots=True)
class ForceError:
    """−∫ (|f − f_d| / f_d + p · lost) dt, less a penalty for a run that is stopped.

    The integral counts in seconds, so that robots with other cycles give comparable sums.
    """

    lost_per_s: float = 5.0
    """Penalty p while the tool has lost the surface, 1/s. Chosen: five times what no force costs."""
    stopped: float = 50.0
    """Penalty for a stop. Chosen: more than any episode of ten seconds costs that continues."""

    def __call__(self, transition: Transition) -> float:
        """The reward of a step."""
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
    """The force error, and the square of the action: for policies that shall be calm."""

    effort_per_s: float = 0.1
    """Cost of an action of 1, 1/s. Chosen: a tenth of what no force costs."""
    force_error: ForceError = ForceError()

    def __call__(self, transition: Transition) -> float:
        """The reward of a step."""
        effort = self.effort_per_s * float(np.square(transition.action).sum()) * transition.seconds
        return self.force_error(transition) - effort


Maker: TypeAlias = Callable[[], Reward]
REWARDS: Mapping[str, Maker] = MappingProxyType(
    {"force-error": ForceError, "force-and-effort": ForceAndEffort}
)
"""Our rewards by name."""


def make_reward(name: str) -> Reward:
    """A reward by its name. Raises ConfigError for a name that no package or too many offer, and for a package that
    is broken.
    """
    found = find_plugin(GROUP, "reward", name, REWARDS)
    if found is None:
        if name not in REWARDS:
            names = ", ".join([*REWARDS, *plugin_names(GROUP)])
            raise ConfigError(f"there is no reward {name!r}; choose one of {names}")
        return REWARDS[name]()
    try:
        made: Any = found.value()
    except (Exception, SystemExit) as error:
        raise ConfigError(f"{found.where} cannot be made: {failure(error)}") from error
    if not callable(made):
        raise ConfigError(
            f"{found.where}: {found.source} makes {type(made).__name__}, which cannot be called"
        )
    reward: Reward = made
    return reward
