"""Episodes with simple policies, and the processes in which they run."""

from typing import Any

import numpy as np

from hil_bridge.control.laws.policy import OBSERVED
from tests import near_surface
from tests.near_surface import merged

NEAR = merged(near_surface.NEAR, {"run": {"duration_s": 1.0}})
PLACE = {quantity.name: place for place, quantity in enumerate(OBSERVED)}
STIFFNESS = {"cell.surface.stiffness_n_m": {"from": 3e3, "to": 2e4, "log": True}}


def gentle(observation: Any) -> Any:
    return [0.02 * float(observation[PLACE["error_n"]])]


def press(observation: Any) -> Any:
    return [1.0]


def play(
    env: Any, policy: Any, seed: int | None = None, episode: int | None = None
) -> tuple[list[float], list[Any], dict[str, Any]]:
    """Return the rewards and observations of an episode, and the last info merged with that of the reset."""
    observation, begun = env.reset(seed=seed, options=None if episode is None else {"episode": episode})
    rewards, observations, over, info = [], [observation], False, {}
    while not over:
        observation, reward, terminated, truncated, info = env.step(np.array(policy(observation)))
        rewards.append(float(reward))
        observations.append(observation)
        over = terminated or truncated
    return rewards, observations, {**begun, **info, "terminated": terminated, "truncated": truncated}
