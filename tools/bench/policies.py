"""Training of policies: decisions of the Gymnasium environment per second of processor time, resets included.

Processor time includes the processes of the emulated cells. `python -m tools.bench.policies 2` uses episodes of 2 s.
"""

import gc
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from gymnasium.vector import AsyncVectorEnv

from hil_bridge.gym import FollowEnv
from tools.bench.figures import Figure, Report, Target

EPISODE_S = 4.0
EPISODES = 5
BEGINNINGS = 2
STEPS = 100
"""Steps of each of several environments."""
CELLS = (
    ("EGM and Net F/T", "egm", "netft", 600.0),
    ("RTDE and Net F/T", "rtde", "netft", 400.0),
    ("RSI and NETCANOEM", "rsi", "ati-can", 700.0),
    ("S3 and JR3", "s3", "jr3", 300.0),
)
"""Cells, each with robot, sensor and the target of its steps per second of processor time. Chosen."""
RESET = Target("value", 100.0)
TICKS_PER_S = os.sysconf("SC_CLK_TCK")


class Cost(NamedTuple):
    """Cost of episodes in processor time."""

    steps_per_s: float
    """Steps per second, resets included."""
    reset_ms: float
    """Processor time of a reset."""
    snapshot_s: float
    """Processor time of a snapshot, which the first reset with each beginning takes."""


def children_of(pid: int | str) -> list[int]:
    """Return the processes that a process has started."""
    try:
        lists = [path.read_text() for path in Path(f"/proc/{pid}/task").glob("*/children")]
    except OSError:
        return []
    return [int(child) for text in lists for child in text.split()]


def processes_of_cells() -> list[int]:
    """Return the processes of emulated cells that this process has started, the first one first."""
    pids = [
        pid for pid in children_of("self") if b"cell_process" in Path(f"/proc/{pid}/cmdline").read_bytes()
    ]
    for pid in pids:
        pids += children_of(pid)
    return pids


def processor_time() -> float:
    """Return the processor time of this process and of the emulated cells, s."""
    while True:
        try:
            stats = [Path(f"/proc/{pid}/stat").read_text() for pid in processes_of_cells()]
        except (FileNotFoundError, ProcessLookupError):
            continue  # a process has just ended, and its parent counts its time
        break
    fields = [stat.rpartition(")")[2].split() for stat in stats]
    return time.process_time() + sum(int(ticks) for each in fields for ticks in each[11:15]) / TICKS_PER_S


def settings(seconds: float) -> dict[str, Any]:
    """Return a configuration for training: a short retraction, because the next episode begins in contact anyway."""
    return {"run": {"duration_s": seconds}, "task": {"retract_mm": 1.0, "retract_speed_mm_s": 20.0}}


def policy(observation: Any) -> Any:
    """Return an action in proportion to the error of the force."""
    return np.array([0.02 * observation[0]], np.float32)


def play(env: FollowEnv) -> int:
    """Play an episode that has begun, and return the number of its steps."""
    steps, over, observation = 0, False, np.zeros(1, np.float32)
    while not over:
        observation, _, terminated, truncated, _ = env.step(policy(observation))
        steps, over = steps + 1, terminated or truncated
    return steps


def cost_of(robot: str, sensor: str, seconds: float) -> Cost:
    """Return the cost of episodes with a cell."""
    env = FollowEnv(robot, sensor, config=settings(seconds), beginnings=BEGINNINGS)
    env.reset(seed=7)  # also starts the process and loads the devices
    began = processor_time()
    env.reset()
    snapshot_s = processor_time() - began
    steps, used_s = 0, 0.0
    resets_s: list[float] = []
    for _ in range(EPISODES):
        began = processor_time()
        env.reset()
        resets_s.append(processor_time() - began)
        steps += play(env)
        used_s += processor_time() - began
    env.close()
    del env
    gc.collect()
    return Cost(steps / used_s, sum(resets_s) / EPISODES * 1e3, snapshot_s)


def rate_of(count: int) -> float:
    """Return the steps per second by the wall of several environments in processes of their own."""
    envs = AsyncVectorEnv(
        [lambda: FollowEnv("egm", "netft", config=settings(EPISODE_S), beginnings=1)] * count, context="spawn"
    )
    try:
        observations, _ = envs.reset(seed=7)
        began = time.monotonic()
        for _ in range(STEPS):
            observations, *_ = envs.step(np.array([policy(each) for each in observations]))
        return STEPS * count / (time.monotonic() - began)
    finally:
        envs.close()


def measure(report_step: Callable[[str], None], seconds: float = EPISODE_S) -> Report:
    """Measure each cell alone, and several environments side by side up to twice the number of cores."""
    figures: list[Figure] = []
    for title, robot, sensor, target in CELLS:
        report_step(title)
        cost = cost_of(robot, sensor, seconds)
        rate = f"{title}, steps per second of processor time, resets included"
        figures += (
            Figure(rate, cost.steps_per_s, "1/s", target=Target("value", target, least=True)),
            Figure(f"{title}, reset from a snapshot, processor time", cost.reset_ms, "ms", target=RESET),
            Figure(f"{title}, snapshot, processor time", cost.snapshot_s, "s"),
        )
    alone, cores = 0.0, os.cpu_count() or 1
    for count in sorted({1, cores, 2 * cores}):
        report_step(f"{count} environments")
        rate_s = rate_of(count)
        alone = alone or rate_s
        name = f"AsyncVectorEnv of {count} (EGM and Net F/T) on {cores} cores, steps per second"
        figures.append(Figure(name, rate_s, "1/s", alone, "one environment"))
    return Report(tuple(figures))


if __name__ == "__main__":
    report = measure(lambda step: print(f"… {step}", flush=True), float(sys.argv[1]))
    print("\n".join(figure.line() for figure in report.figures))
