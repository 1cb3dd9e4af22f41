"""Gymnasium environment of bridge runs, and policies as controllers under the guard.

    import gymnasium
    import hil_bridge.gym  # registers the environment

    env = gymnasium.make("hil-bridge/Follow-v0", robot="egm", sensor="netft", surface={"stiffness_n_m": 2e4})
    observation, info = env.reset(seed=7)
    observation, reward, terminated, truncated, info = env.step(env.action_space.sample())

    hil_bridge.simulate(controller=hil_bridge.gym.PolicyController(policy))

The environment needs the extra `gymnasium`; a policy as a controller does not.
"""

from contextlib import suppress
from importlib import import_module
from typing import TYPE_CHECKING, Any

from hil_bridge.control.laws.policy import AXES, OBSERVED, Policy, PolicyController, Quantity
from hil_bridge.errors import ConfigError
from hil_bridge.errors.extras import install_command
from hil_bridge.gym.replaying import replay_policy
from hil_bridge.gym.rewards import REWARDS, Reward, Transition, make_reward

if TYPE_CHECKING:
    from hil_bridge.gym.follow import FollowEnv

__all__ = [
    "AXES",
    "ENVIRONMENT",
    "OBSERVED",
    "REWARDS",
    "FollowEnv",
    "Policy",
    "PolicyController",
    "Quantity",
    "Reward",
    "Transition",
    "make_reward",
    "replay_policy",
]

ENVIRONMENT = "hil-bridge/Follow-v0"
"""Id of the environment for `gymnasium.make`."""


def _register() -> None:
    """Register the environment with Gymnasium, if installed."""
    with suppress(ModuleNotFoundError):
        gymnasium = import_module("gymnasium")
        if ENVIRONMENT not in gymnasium.registry:
            gymnasium.register(ENVIRONMENT, entry_point="hil_bridge.gym.follow:FollowEnv")


def __getattr__(name: str) -> Any:
    """Return the environment class on first use. Raises ConfigError if Gymnasium is not installed."""
    if name != "FollowEnv":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    try:
        return import_module("hil_bridge.gym.follow").FollowEnv
    except ModuleNotFoundError as error:
        if error.name != "gymnasium":
            raise
        raise ConfigError(
            f"the environment requires the package gymnasium; {install_command('gymnasium')}"
        ) from error


_register()
