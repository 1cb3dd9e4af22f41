"""Pictures of the environment."""

import gymnasium
import numpy as np
import pytest
from numpy.typing import NDArray

from hil_bridge.gym import ENVIRONMENT, FollowEnv
from tests.policies.playing import NEAR, gentle

pytestmark = pytest.mark.sweep


def picture(env: FollowEnv) -> NDArray[np.uint8]:
    """Return the present picture."""
    pixels = env.render()
    assert pixels is not None
    return pixels


def test_picture_shows_state_of_each_step() -> None:
    env = FollowEnv(config=NEAR, render_mode="rgb_array", beginnings=1)
    with pytest.raises(gymnasium.error.ResetNeeded, match="no episode to render"):
        env.render()
    observation, _ = env.reset(seed=1)
    pictures, over = [picture(env)], False
    while not over:
        observation, _, terminated, truncated, _ = env.step(np.array(gentle(observation)))
        pictures.append(picture(env))
        over = terminated or truncated
    assert all(one.shape == (240, 480, 3) and one.dtype == np.uint8 for one in pictures)
    assert len({one.tobytes() for one in pictures}) == len(pictures)
    env.reset(options={"episode": env._seed})
    assert np.array_equal(picture(env), pictures[0])
    env.close()


def test_environment_without_render_mode_renders_nothing() -> None:
    env = FollowEnv(config=NEAR, beginnings=1)
    env.reset(seed=1)
    assert env.render() is None
    env.close()


def test_frames_of_an_episode_are_collected() -> None:
    env = gymnasium.make(ENVIRONMENT, config=NEAR, render_mode="rgb_array_list", beginnings=1)
    observation, _ = env.reset(seed=1)
    for _ in range(2):
        observation, *_ = env.step(np.array(gentle(observation), np.float32))
    pictures = env.render()
    assert isinstance(pictures, list)
    assert len(pictures) == 3
    env.close()
