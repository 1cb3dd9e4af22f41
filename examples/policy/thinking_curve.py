"""Judge a linear policy at several thinking times, and print a table.

    python examples/policy/thinking_curve.py --weights 2.337 -0.758 -1.065

The episodes are those of training with drawn latency, with seeds that are not used in training.
"""

import argparse
from collections.abc import Sequence
from typing import NamedTuple

import gymnasium
import numpy as np
from train import LATENCY, linear

from hil_bridge.gym import ENVIRONMENT

SEEDS = range(101, 111)
"""Seeds of the episodes."""
THINKING_MS = (0.0, 20.0, 50.0, 100.0)


class Judged(NamedTuple):
    """Results of the episodes at one thinking time."""

    completed: int
    """Number of episodes that were not stopped."""
    mean_return: float
    """Mean sum of rewards of an episode."""


def judge(weights: Sequence[float], thinking_ms: float, seeds: Sequence[int] = SEEDS) -> Judged:
    """Return the results of a policy that takes this time for each action."""
    env = gymnasium.make(
        ENVIRONMENT, robot="egm", sensor="netft", thinking_ms=thinking_ms, beginnings=1, **LATENCY["drawn"]
    )
    policy, completed, total = linear(weights), 0, 0.0
    for seed in seeds:
        observed, _ = env.reset(options={"episode": seed})
        over = False
        while not over:
            observed, reward, terminated, truncated, _ = env.step(np.array(policy(observed), np.float32))
            total += float(reward)
            over = terminated or truncated
        completed += truncated
    env.close()
    return Judged(completed, total / len(seeds))


def main() -> None:
    """Print the table."""
    options = argparse.ArgumentParser(description="Judge a linear policy at several thinking times.")
    options.add_argument("--weights", type=float, nargs=3, required=True)
    options.add_argument("--thinking-ms", type=float, nargs="*", default=THINKING_MS)
    chosen = options.parse_args()
    print("| thinking time | episodes not stopped | mean return |\n| --- | --- | --- |")
    for thinking_ms in chosen.thinking_ms:
        judged = judge(chosen.weights, thinking_ms)
        share = f"{judged.completed} of {len(SEEDS)}"
        print(f"| {thinking_ms:g} ms | {share} | {judged.mean_return:.2f} |", flush=True)


if __name__ == "__main__":
    main()
