"""Gymnasium environment: a run of the bridge, one decision at a time."""

import math
import os
import threading
import warnings
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AsyncVectorEnv

import hil_bridge
from hil_bridge.control.laws.policy import OBSERVED
from hil_bridge.errors import Cause, ConfigError
from hil_bridge.gym import ENVIRONMENT, FollowEnv, PolicyController, Transition, replay_policy
from protocol.geometry import angle_between
from tests.policies.playing import NEAR, PLACE, STIFFNESS, gentle, play, press
from tools.bench.policies import processes_of_cells

pytestmark = pytest.mark.sweep


@pytest.mark.full
def test_environment_passes_gymnasium_checker() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for actions in (("along",), ("along", "turn")):
            env = gymnasium.make(ENVIRONMENT, config=NEAR, actions=actions, render_mode="rgb_array")
            check_env(env.unwrapped)
            env.close()


def test_seed_repeats_episodes() -> None:
    env = FollowEnv(config=NEAR, randomise=STIFFNESS)
    first, again, other = (play(env, gentle, seed) for seed in (5, 5, 6))
    assert first[0] == again[0]
    assert np.array_equal(first[1], again[1])
    assert first[2]["drawn"] == again[2]["drawn"] != other[2]["drawn"]
    assert not np.array_equal(first[1], other[1])
    env.reset(options={"episode": first[2]["seed"]})
    assert env.config(first[2]["seed"]).run.seed == first[2]["seed"]
    env.close()


@pytest.mark.parametrize(
    ("robot", "sensor", "axes"),
    [
        ("s3", "jr3", ("along",)),
        ("s3", "jr3", ("along", "across")),
        ("s3", "jr3", ("along", "turn")),
        ("egm", "netft", ("along",)),
    ],
)
def test_policy_decides_identically_in_run(robot: str, sensor: str, axes: Any) -> None:
    policy = gentle if len(axes) == 1 else lambda observation: [*gentle(observation), 0.3]
    options = {"config": NEAR, "randomise": STIFFNESS, "actions": axes}
    env = FollowEnv(robot, sensor, **options)
    observed: list[Any] = []

    def watched(observation: Any) -> Any:
        observed.append(observation)
        return policy(observation)

    _, observations, info = play(env, policy, 3)
    result = hil_bridge.simulate(env.config(info["seed"]), controller=PolicyController(watched, axes))
    assert np.array_equal(observations[:-1], observed)
    assert len(observed) > 3
    assert result.outcome == info["outcome"] == "completed"
    assert info["truncated"]
    if axes[-1] == "turn":
        commanded = result.cycles[-1].quaternion_commanded
        assert angle_between(commanded, result.cycles[0].sample.quaternion) > math.radians(0.5)
    if axes[-1] == "across":
        assert result.cycles[-1].across_commanded > 1e-4


def test_observation_equals_decoded_sample() -> None:
    samples = []

    def policy(observation: Any) -> Any:
        samples.append(observation)
        return gentle(observation)

    result = hil_bridge.simulate(NEAR, controller=PolicyController(policy), seed=4)
    cycles = [cycle for cycle in result.cycles if "action_along" in cycle.explanation]
    assert len(cycles) == len(samples)
    for cycle, observation in zip(cycles, samples, strict=True):
        sample = cycle.sample
        assert sample is not None
        values = dict(zip(PLACE, map(float, observation), strict=True))
        assert values["force_n"] == np.float32(cycle.force)
        assert values["error_n"] == np.float32(cycle.force_reference - cycle.force)
        assert values["force_age_s"] == np.float32(sample.now - sample.sensor_at)
        assert values["x_m"] == np.float32(cycle.sample.position[0])
        assert values["moment_x_nm"] == np.float32(cycle.sample.wrench[3])
        assert values["in_contact"] == cycle.in_contact


def test_truth_is_reported_on_request() -> None:
    env = FollowEnv(config=NEAR, truth=True, beginnings=1)
    _, info = env.reset(seed=1)
    assert info["truth_force"][2] > 1.0
    assert info["truth_position"] == pytest.approx([0.9, -0.1, 0.59], abs=2e-3)
    env.close()
    assert "truth_force" not in FollowEnv(config=NEAR, beginnings=1).reset(seed=1)[1]


def test_guard_stop_ends_episode_and_is_recorded(tmp_path: Path) -> None:
    env = FollowEnv(surface={"stiffness_n_m": 1e5}, config=NEAR, speed_mm_s=11.0, keep=tmp_path)
    rewards, _, info = play(env, press, 1)
    assert info["terminated"]
    assert not info["truncated"]
    assert (info["outcome"], info["cause"], info["stops"]) == ("stopped", str(Cause.FORCE), 1)
    assert rewards[-1] <= -50.0
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(np.array([0.0]))
    play(env, press)
    assert env._counts == {"episodes": 2, "stops": 2, "skipped": 0}
    kept = sorted(tmp_path.glob("*.mcap"))
    assert len(kept) == 2
    recording = tmp_path / f"episode-{info['seed']}.mcap"
    again = replay_policy(recording, PolicyController(press, speed_mm_s=11.0))
    assert len(again) >= 10
    assert not any(cycle.differences for cycle in again)
    other = replay_policy(recording, PolicyController(gentle, speed_mm_s=11.0))
    assert any(cycle.differences for cycle in other)


def test_reward_of_lost_contact_is_below_zero_force() -> None:
    def leave(observation: Any) -> Any:
        return [-1.0]

    cost = []
    for policy in (gentle, leave):
        rewards, _, _ = play(FollowEnv(config=NEAR), policy, 1)
        cost.append(-sum(rewards))
    assert cost[1] > 5 * cost[0] > 0


def test_reward_may_be_a_function() -> None:
    transitions: list[Transition] = []

    def count(transition: Transition) -> float:
        transitions.append(transition)
        return float(len(transition.cycles))

    rewards, _, _ = play(FollowEnv(config=NEAR, reward=count), gentle, 1)
    assert rewards == [len(one.cycles) for one in transitions]
    assert all(one.seconds > 0.1 for one in transitions)
    assert [one.result is None for one in transitions] == [True] * (len(transitions) - 1) + [False]


def test_episode_faults_are_drawn_by_seed() -> None:
    late = {"on": "wire", "fault": "late", "phase": "approach", "with": {"ms": {"from": 1.0, "to": 9.0}}}
    env = FollowEnv(config=NEAR, faults=[late])
    drawn = [play(env, gentle, seed)[2]["drawn"] for seed in (1, 2)]
    assert drawn[0] != drawn[1]
    assert all(one["faults"][0]["fault"] == "late" for one in drawn)
    (fault,) = env.config(7).faults
    assert 1.0 <= fault.given["ms"] <= 9.0


@pytest.mark.full
def test_environments_run_in_subprocesses() -> None:
    def make() -> Any:
        import hil_bridge.gym  # noqa: F401  registers the environment in the process

        return gymnasium.make(ENVIRONMENT, config=NEAR)

    alone, _, _ = play(FollowEnv(config=NEAR), gentle, 8)
    envs = AsyncVectorEnv([make, make], context="spawn")
    try:
        observations, infos = envs.reset(seed=[8, 9])
        assert observations.shape == (2, len(OBSERVED))
        assert infos["seed"][0] != infos["seed"][1]
        rewards = []
        for _ in alone:
            actions = np.array([gentle(observation) for observation in observations])
            observations, reward, _, truncated, _ = envs.step(actions)
            rewards.append(float(reward[0]))
        assert rewards == alone
        assert truncated[0]
    finally:
        envs.close()


@pytest.mark.full
@pytest.mark.parametrize("beginnings", [0, 2])
def test_episodes_leak_no_memory_or_threads(beginnings: int) -> None:
    def resident_mb() -> float:
        pids = [os.getpid(), *processes_of_cells()]
        return sum(int(Path(f"/proc/{pid}/statm").read_text().split()[1]) for pid in pids) * 4096 / 1e6

    env = FollowEnv(config=NEAR, beginnings=beginnings)
    env.reset(seed=1)
    before = 0.0
    for number in range(60):
        play(env, gentle)
        env.reset()  # and abandoned
        if number == 39:  # by then, the collector has found the first cells
            before = resident_mb()
    assert resident_mb() - before < 8.0
    env.close()
    assert not [thread for thread in threading.enumerate() if thread.name == "episode"]
    del env
    assert not processes_of_cells()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"reward": "none-such"}, "unknown reward 'none-such'; known: force-error"),
        ({"gravity": 1}, "has no argument 'gravity'"),
        ({"actions": ("down",)}, "axes must be one or more of along, across, turn"),
        (
            {"randomise": {"cell.surface.stiffness_n_m": 5}},
            "randomise.cell.surface.stiffness_n_m must be a range",
        ),
        ({"randomise": {"cell.nothing": [1, 2]}}, "cell.nothing"),
        (
            {"faults": [{"on": "controller", "fault": "huge"}]},
            "the controller of an environment is the policy",
        ),
        (
            {"faults": [{"on": "wire", "fault": "late"}], "faults_per_run": 99},
            "faults_per_run must be a number",
        ),
        ({"config": {"robot": {"url": "s3+serial:///dev/ttyUSB0"}}}, "leave the URL empty"),
        ({"robot": "none-such"}, "none-such"),
        ({"beginnings": -1}, "beginnings must be an integer from 0"),
        ({"render_mode": "human"}, 'render_mode must be "rgb_array" or None'),
        ({"thinking_ms": -1.0}, "thinking_ms must be a number from 0"),
        ({"thinking_ms": {"from": 5.0}}, "thinking_ms must be a number from 0"),
    ],
)
def test_invalid_argument_is_refused(options: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError) as raised:
        FollowEnv(**options)
    assert message in str(raised.value)
    assert "\n" not in str(raised.value)


def test_reset_without_contact_is_refused() -> None:
    env = FollowEnv(config={**NEAR, "task": {"approach_depth_limit_mm": 0.5}})
    with pytest.raises(ConfigError, match=r"no run reaches a contact.*no contact found"):
        env.reset(options={"episode": 1})


def test_invalid_action_is_refused() -> None:
    env = FollowEnv(config=NEAR)
    env.reset(seed=1)
    for wrong in ([0.0, 0.0], [float("nan")]):
        with pytest.raises(ValueError, match="an action must be 1 numbers from -1 to 1"):
            env.step(np.array(wrong))
    env.close()


def test_plugin_reward_is_used(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    info = tmp_path / "sevens-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: sevens\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[hil_bridge.rewards]\nseven = m_sevens:make\nno = m_sevens:no\n")
    (tmp_path / "m_sevens.py").write_text(
        "def make():\n    return lambda step: 7.0\ndef no():\n    return 1\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    rewards, _, _ = play(FollowEnv(config=NEAR, reward="seven"), gentle, 1)
    assert set(rewards) == {7.0}
    with pytest.raises(ConfigError, match=r"sevens 1.0: m_sevens:no returns int, which is not callable"):
        FollowEnv(config=NEAR, reward="no")
