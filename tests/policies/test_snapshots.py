"""Episodes that begin at snapshots: equal to fresh runs, and clean ends of the processes that play them."""

import gc
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import SyncVectorEnv

from hil_bridge.errors import BridgeError, ConfigError
from hil_bridge.gym import FollowEnv, follow
from hil_bridge.gym.beginnings import Beginnings
from hil_bridge.gym.cell_process import ProcessLost, _portable
from hil_bridge.gym.channel import Channel
from hil_bridge.gym.snapshots import SUPPORTED
from tests.policies.playing import NEAR, STIFFNESS, gentle, play, press
from tools.bench.policies import processes_of_cells

pytestmark = [
    pytest.mark.sweep,
    pytest.mark.skipif(not SUPPORTED, reason="this system cannot copy a process"),
]


def saving(path: Path) -> Any:
    """Return a reward that saves the recording of each episode."""

    def reward(transition: Any) -> float:
        if transition.result is not None:
            transition.result.save(path, overwrite=True)
        return float(len(transition.cycles))

    return reward


@pytest.mark.parametrize(
    ("robot", "sensor"), [("egm", "netft"), ("s3", "jr3"), ("rtde", "ft300"), ("rsi", "ati-can")]
)
def test_episode_from_snapshot_equals_fresh_run(robot: str, sensor: str, tmp_path: Path) -> None:
    fresh, again = tmp_path / "fresh.mcap", tmp_path / "again.mcap"
    options: dict[str, Any] = {"config": NEAR, "randomise": STIFFNESS}
    expected = play(FollowEnv(robot, sensor, beginnings=0, reward=saving(fresh), **options), gentle, 5)
    env = FollowEnv(robot, sensor, beginnings=2, reward=saving(again), **options)
    for policy in (gentle, press, gentle):  # an episode leaves no trace in the snapshot
        repeated = play(env, policy, episode=expected[2]["seed"])
        env.reset(options={"episode": 1})
    env.close()
    assert repeated[0] == expected[0]
    assert np.array_equal(repeated[1], expected[1])
    assert repeated[2]["drawn"] == expected[2]["drawn"]
    assert again.read_bytes() == fresh.read_bytes()


def test_beginnings_are_used_once_per_pass() -> None:
    beginnings, random = Beginnings(3), np.random.default_rng(1)
    new = [beginnings.draw(random) for _ in range(3)]
    for seed in new:
        beginnings.keep(seed)
    passes = [[beginnings.draw(random) for _ in range(3)] for _ in range(20)]
    assert all(sorted(one) == sorted(new) for one in passes)
    assert len({tuple(one) for one in passes}) > 1
    beginnings.clear()
    assert beginnings.draw(random) not in new


def test_seed_determines_order_of_beginnings() -> None:
    env = FollowEnv(config=NEAR, beginnings=2)
    first, again = ([env.reset(seed=seed)[1]["seed"] for seed in (4, *[None] * 5)] for _ in range(2))
    assert first == again
    assert len(set(first)) == 2
    env.close()


def test_least_recently_used_snapshot_is_closed() -> None:
    env = FollowEnv(config=NEAR, beginnings=2)
    for episode in (1, 2, 3, 1):
        env.reset(options={"episode": episode})
    while len(processes_of_cells()) != 4:  # program, two snapshots, and one episode
        time.sleep(0.01)
    env.close()


def test_system_without_fork_runs_in_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    env = FollowEnv(config=NEAR)
    expected = play(env, gentle, 3)
    env.close()
    monkeypatch.setattr(follow, "SUPPORTED", False)
    repeated = play(FollowEnv(config=NEAR), gentle, 3)
    assert repeated[0] == expected[0]
    assert np.array_equal(repeated[1], expected[1])


def test_environments_play_side_by_side() -> None:
    alone = [play(FollowEnv(config=NEAR), gentle, seed)[0] for seed in (8, 9)]
    envs = SyncVectorEnv([lambda: FollowEnv(config=NEAR) for _ in range(2)])
    observations, infos = envs.reset(seed=[8, 9])
    assert infos["seed"][0] != infos["seed"][1]
    rewards = []
    for _ in alone[0]:
        observations, reward, *_ = envs.step(np.array([gentle(each) for each in observations]))
        rewards.append(reward)
    envs.close()
    assert [[float(pair[place]) for pair in rewards] for place in (0, 1)] == alone


def test_killed_process_is_reported_and_replaced() -> None:
    env = FollowEnv(config=NEAR)
    expected = play(env, gentle, 3)
    env.reset(seed=3)
    os.kill(processes_of_cells()[-1], signal.SIGKILL)
    with pytest.raises(ProcessLost, match="the episode was killed by the signal SIGKILL"):
        env.step(np.array([0.0]))
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(np.array([0.0]))
    assert play(env, gentle, 3)[0] == expected[0]
    for victim in (1, 0):  # the snapshot, then the program
        play(env, gentle, 3)
        env.reset(options={"episode": 4})
        os.kill(processes_of_cells()[victim], signal.SIGKILL)
        assert play(env, gentle, 3)[0] == expected[0]
    env.close()


def test_interrupted_step_does_not_disturb_next_episode(monkeypatch: pytest.MonkeyPatch) -> None:
    env = FollowEnv(config=NEAR)
    expected = play(env, gentle, 3)
    env.reset(seed=3)
    with monkeypatch.context() as patch:
        patch.setattr(Channel, "receive", lambda channel: signal.raise_signal(signal.SIGINT))
        with pytest.raises(KeyboardInterrupt):
            env.step(np.array([0.0]))
    assert play(env, gentle, 3)[0] == expected[0]
    env.close()


def test_abandoned_environment_leaves_no_process() -> None:
    env = FollowEnv(config=NEAR)
    env.reset(seed=1)
    env.step(np.array([0.0]))
    assert processes_of_cells()
    env.itself = env  # type: ignore[attr-defined]  # only the collector finds it
    del env
    gc.collect()
    assert not processes_of_cells()


def test_policy_error_leaves_environment_usable() -> None:
    env = FollowEnv(config=NEAR)
    expected = play(env, gentle, 2)

    def wrong(observation: Any) -> Any:
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        play(env, wrong, 2)
    assert play(env, gentle, 2)[0] == expected[0]
    env.close()


PROGRAM = """
import os, signal
from hil_bridge.gym import FollowEnv
from tests.policies.playing import NEAR
from tools.bench.policies import processes_of_cells
env = FollowEnv(config=NEAR)
env.reset(seed=1)
print(*processes_of_cells(), flush=True)
os.kill({victim}, signal.{signal})
env.step([0.0])
"""


@pytest.mark.parametrize(("victim", "name"), [("os.getpid()", "SIGKILL"), ("0", "SIGINT")])
def test_processes_end_with_their_user(victim: str, name: str) -> None:
    """SIGINT goes to the group of the user's process, as Ctrl-C in a terminal does."""
    ran = subprocess.run(
        [sys.executable, "-c", PROGRAM.format(victim=victim, signal=name)],
        capture_output=True,
        text=True,
        cwd=Path(__file__).parents[2],
        start_new_session=True,
    )
    pids = ran.stdout.split()
    assert len(pids) == 3
    assert ran.stderr.count("Traceback") == (name == "SIGINT")
    while any(Path(f"/proc/{pid}").exists() for pid in pids):
        time.sleep(0.01)


def test_copy_of_user_process_does_not_end_episode() -> None:
    env = FollowEnv(config=NEAR)
    expected = play(env, gentle, 2)
    env.reset(seed=2)
    child = os.fork()
    if child == 0:
        env.close()
        os._exit(0)
    os.waitpid(child, 0)
    assert play(env, gentle, 2)[0] == expected[0]
    env.close()


def test_records_are_available_until_next_reset(tmp_path: Path) -> None:
    results: list[Any] = []

    def keep(transition: Any) -> float:
        results.append(transition.result)
        return 0.0

    env = FollowEnv(config=NEAR, reward=keep)
    play(env, gentle, 1)
    play(env, gentle)
    first, second = (result for result in results if result is not None)
    second.save(tmp_path / "run.mcap")
    with pytest.raises(ConfigError, match="already exists"):
        second.save(tmp_path / "run.mcap")
    assert len(second.cycles) > 5
    assert second.figures
    assert second.traffic.robot
    assert first.outcome == "completed"
    with pytest.raises(ConfigError, match="available until the next reset"):
        assert first.cycles
    env.close()


def test_error_without_pickle_keeps_its_text() -> None:
    class Local(Exception):
        pass

    assert "Local" in str(_portable(Local("text")))
    refused = _portable(ConfigError("no such value"))
    assert isinstance(refused, BridgeError)
    assert not hasattr(refused, "__notes__")


def test_contradictory_draw_is_refused_by_reset() -> None:
    env = FollowEnv(config={**NEAR, "task": {"approach_depth_limit_mm": 0.5}}, beginnings=1)
    with pytest.raises(ConfigError, match=r"no run reaches a contact.*no contact found"):
        env.reset(options={"episode": 1})
    env.close()
