"""Thinking time of a policy: its action takes effect later, while the previous one continues."""

import math
import runpy
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner

import hil_bridge
from hil_bridge.cli import cli
from hil_bridge.control import Measurement
from hil_bridge.control.laws.policy import THINKING
from hil_bridge.control.laws.thinking import MEASURED
from hil_bridge.errors import ConfigError
from hil_bridge.gym import FollowEnv, PolicyController, replay_policy
from tests.policies.playing import NEAR, gentle, play

pytestmark = pytest.mark.sweep

EGM: dict[str, Any] = {**NEAR, "robot": {"emulated": "egm"}, "sensor": {"emulated": "netft"}}
CYCLE_S = 0.004


def actions(controller: PolicyController, count: int, dt: float = 1.0) -> list[float]:
    """Return the action in effect in each of a number of cycles, one every `dt` seconds."""
    state, effective = controller.initial(), []
    for number in range(count):
        measurement = Measurement(number * dt, 0.0, 0.0, 0.0, dt=dt)
        state, command = controller.step(state, measurement, 1.0 + number)
        effective.append(command.explanation["action_along"])
        assert command.position == pytest.approx(min(effective[-1], 1.0) * 5e-3 * dt)
    return effective


def error(observation: Any) -> Any:
    return [float(observation[0])]


@pytest.mark.parametrize(
    ("thinking_ms", "expected"),
    [
        (0.0, [1, 2, 3, 4, 5, 6, 7]),
        (1000.0, [0, 1, 2, 3, 4, 5, 6]),
        (300.0, [0, 1, 2, 3, 4, 5, 6]),
        (1001.0, [0, 0, 1, 1, 3, 3, 5]),
        (3000.0, [0, 0, 0, 1, 1, 1, 4]),
    ],
)
def test_action_takes_effect_after_thinking_time(thinking_ms: float, expected: list[float]) -> None:
    assert actions(PolicyController(error, thinking_ms=thinking_ms), 7) == expected


def test_thinking_time_of_several_cycles_is_exact() -> None:
    """Times of cycles such as 7919.304 have rounding errors."""
    effective = actions(PolicyController(error, thinking_ms=20.0), 40, CYCLE_S)
    assert effective == [0.0] * 5 + [1.0 + 5 * (number // 5) for number in range(35)]


def test_drawn_thinking_times_repeat_and_stay_in_range() -> None:
    policy = PolicyController(error, thinking_ms={"from": 2000.0, "to": 5000.0}, thinking_seed=3)
    effective = actions(policy, 400)
    assert effective == actions(policy, 400)
    decided = sorted(set(effective))
    steps = {int(after - before) for before, after in pairwise(decided[1:])}
    assert steps == {3, 4, 5}
    other = PolicyController(error, thinking_ms={"from": 2000.0, "to": 5000.0}, thinking_seed=4)
    assert effective != actions(other, 400)


def test_measured_thinking_time_comes_from_stopwatch() -> None:
    times = iter([0.0, 2.5, 9.0, 9.1, 20.0, 25.0])
    policy = PolicyController(error, thinking_ms=MEASURED, stopwatch=lambda: next(times))
    assert actions(policy, 6) == [0, 0, 0, 1, 4, 4]


@pytest.mark.parametrize("thinking_ms", [20.0, {"from": 5.0, "to": 40.0}, MEASURED])
def test_run_with_thinking_time_replays_exactly(thinking_ms: Any, tmp_path: Path) -> None:
    policy = PolicyController(gentle, thinking_ms=thinking_ms)
    result = hil_bridge.simulate(EGM, controller=policy, seed=3)
    decided = [cycle for cycle in result.cycles if THINKING in cycle.explanation]
    assert len(decided) > 10
    result.save(tmp_path / "run.mcap")
    replayed = replay_policy(tmp_path / "run.mcap", policy)
    assert not any(cycle.differences for cycle in replayed)
    if thinking_ms != MEASURED:
        again = hil_bridge.simulate(EGM, controller=policy, seed=3)
        assert [cycle.target for cycle in again.cycles] == [cycle.target for cycle in result.cycles]


def test_replay_without_measured_times_is_refused(tmp_path: Path) -> None:
    result = hil_bridge.simulate(NEAR, controller=PolicyController(gentle), seed=3)
    with pytest.raises(ConfigError, match="contains no thinking times"):
        replay_policy(result.recording, PolicyController(gentle, thinking_ms=MEASURED))
    other = PolicyController(gentle, thinking_ms=20.0)
    assert any(cycle.differences for cycle in replay_policy(result.recording, other))


@pytest.mark.parametrize("thinking_ms", [20.0, {"from": 5.0, "to": 40.0}])
def test_environment_and_run_think_alike(thinking_ms: Any) -> None:
    env = FollowEnv("egm", "netft", config=NEAR, thinking_ms=thinking_ms, beginnings=1)
    _, observations, info = play(env, gentle, 3)
    observed: list[Any] = []

    def watched(observation: Any) -> Any:
        observed.append(observation)
        return gentle(observation)

    policy = PolicyController(watched, thinking_ms=thinking_ms, thinking_seed=info["seed"])
    result = hil_bridge.simulate(env.config(info["seed"]), controller=policy)
    assert np.array_equal(observations[:-1], observed)
    decided_at = [cycle.started_at for cycle in result.cycles if THINKING in cycle.explanation]
    gaps = [after - before for before, after in pairwise(decided_at)]
    low, high = (20.0, 20.0) if thinking_ms == 20.0 else (5.0, 40.0)
    assert min(gaps) >= low * 1e-3 - 1e-9
    assert max(gaps) <= high * 1e-3 + CYCLE_S
    env.close()


@pytest.mark.parametrize("beginnings", [0, 1])
def test_environment_measures_thinking_time(beginnings: int) -> None:
    env = FollowEnv("egm", "netft", config=NEAR, thinking_ms=MEASURED, beginnings=beginnings)
    env.reset(seed=1)
    for thought_s, cycles in ((0.01, 3), (0.021, 6), (1e-6, 1)):
        counts: list[int] = []
        env._reward = lambda transition, counts=counts: float(counts.append(len(transition.cycles)) or 0)
        env._answered_at -= thought_s
        env.step(np.array([0.1]))
        assert counts[0] >= cycles
    env.close()


def test_policy_file_thinks(tmp_path: Path) -> None:
    from tests.policies.test_policies import TRAIN, WEIGHTS

    TRAIN["write_onnx"](WEIGHTS, tmp_path / "policy.onnx")
    parameters = {"file": str(tmp_path / "policy.onnx"), "thinking_ms": 50.0}
    config = {**EGM, "controller": {"name": "policy", "parameters": parameters}}
    result = hil_bridge.simulate(config, seed=2)
    assert result.outcome == "completed"
    decided_at = [cycle.started_at for cycle in result.cycles if THINKING in cycle.explanation]
    assert all(
        0.05 <= after - before + 1e-9 < 0.05 + CYCLE_S + 1e-9 for before, after in pairwise(decided_at)
    )
    result.save(tmp_path / "run.mcap")
    replayed = CliRunner().invoke(cli, ["replay", str(tmp_path / "run.mcap")])
    assert replayed.exit_code == 0, replayed.output


def test_thinking_curve_judges_policy(monkeypatch: pytest.MonkeyPatch) -> None:
    folder = Path(__file__).resolve().parents[2] / "examples" / "policy"
    monkeypatch.syspath_prepend(str(folder))
    judge = runpy.run_path(str(folder / "thinking_curve.py"))["judge"]
    completed, mean_return = judge((2.337, -0.758, -1.065), 20.0, [101])
    assert completed == 1
    assert -1.0 < mean_return < 0.0


@pytest.mark.parametrize("thinking_ms", [-1.0, math.nan, "fast", {"from": 5.0, "to": 1.0}, {"at": 5.0}, True])
def test_invalid_thinking_time_is_refused(thinking_ms: Any) -> None:
    with pytest.raises(ValueError, match="thinking_ms must be a number from 0"):
        PolicyController(gentle, thinking_ms=thinking_ms)
