"""Train a linear policy for the force by CMA-ES, and write it as ONNX.

    python examples/policy/train.py policy.onnx

CMA-ES of the package cma needs neither gradients nor torch: it searches for three numbers, on two cores, in minutes. It
requires `pip install 'hil-bridge[gymnasium,onnx]' onnx cma`.
"""

import argparse
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import cache
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from hil_bridge.gym import ENVIRONMENT, OBSERVED

PLACE = {quantity.name: place for place, quantity in enumerate(OBSERVED)}
BEGIN = (1.0, 0.0, 0.0)
"""Initial weights of the search: an action of 0.1 per newton of missing force."""
SCALES = (10.0, 100.0, 1e-3)
"""A weight applies per 10 N of error, per 100 N/s of change, and per millimetre that the command is ahead."""
SEEDS = (11, 12)
"""Seeds of the episodes by which a candidate is evaluated."""
NEAR: dict[str, Any] = {
    "run": {"duration_s": 1.5},
    "task": {"retract_mm": 1.0, "retract_speed_mm_s": 20.0},
    "cell": {"start_position_mm": (900.0, -100.0, 592.0)},
}
"""Settings with a short approach and retraction, so that the episode is about the force."""
SURFACE = {"cell.surface.stiffness_n_m": {"from": 5e3, "to": 2e4, "log": True}}
LATENCY: dict[str, dict[str, Any]] = {
    "none": {
        "config": {
            **NEAR,
            "cell": {
                **NEAR["cell"],
                "egm": {"ref_delay_cycles": 0, "arm": {"natural_frequency_rad_s": 1000.0}},
            },
        },
        "randomise": SURFACE,
    },
    "drawn": {
        "config": NEAR,
        "randomise": {
            **SURFACE,
            "cell.egm.ref_delay_cycles": {"from": 2, "to": 8},
            "cell.egm.arm.natural_frequency_rad_s": {"from": 50.0, "to": 150.0, "log": True},
        },
        "faults": [
            {"on": "wire", "fault": "late", "phase": "approach", "with": {"ms": {"from": 1.0, "to": 60.0}}}
        ],
    },
}
"""Arguments of the environment: a robot that follows at once, or one whose delays are drawn again each time."""


def linear(weights: Sequence[float]) -> Callable[[Any], Any]:
    """Return the policy with these weights: tanh(w · (error, rate of the force, lead of the command))."""
    gains = np.asarray(weights, np.float64) / SCALES
    error, change, dt, ahead = (PLACE[name] for name in ("error_n", "change_n", "dt_s", "ahead_m"))

    def policy(observed: Any) -> Any:
        rate = float(observed[change]) / max(float(observed[dt]), 1e-6)
        return [float(np.tanh(gains @ (float(observed[error]), rate, float(observed[ahead]))))]

    return policy


@cache
def environment(latency: str) -> Any:
    """Return the environment, created once in each process."""
    return gymnasium.make(ENVIRONMENT, robot="egm", sensor="netft", reward="force-error", **LATENCY[latency])


def cost(task: tuple[str, tuple[float, ...]]) -> float:
    """Return the cost of a candidate: the negative sum of the rewards of its episodes."""
    latency, weights = task
    env, policy, total = environment(latency), linear(weights), 0.0
    for seed in SEEDS:
        observed, _ = env.reset(seed=seed)
        over = False
        while not over:
            observed, reward, terminated, truncated, _ = env.step(np.array(policy(observed)))
            total -= float(reward)
            over = terminated or truncated
    return total / len(SEEDS)


def train(latency: str, generations: int, tell: Callable[[str], object] = print) -> list[float]:
    """Return the weights of the best candidate. The same arguments give the same weights."""
    import cma

    options = {"seed": 1, "popsize": 8, "verbose": -9, "bounds": [[0.0, -20.0, -20.0], [50.0, 20.0, 20.0]]}
    search = cma.CMAEvolutionStrategy(list(BEGIN), 0.7, options)
    with ProcessPoolExecutor(2, get_context("spawn")) as pool:
        for number in range(generations):
            asked = search.ask()
            costs = list(pool.map(cost, [(latency, tuple(map(float, one))) for one in asked]))
            search.tell(asked, costs)
            tell(f"generation {number + 1}: best cost {search.best.f:.3f}")
    return [round(float(weight), 3) for weight in search.best.x]


def write_onnx(weights: Sequence[float], path: Path) -> None:
    """Write the policy as an ONNX file."""
    from onnx import TensorProto, checker, helper

    gains = np.asarray(weights, np.float64) / SCALES
    names = ("error_n", "change_n", "dt_s", "ahead_m")
    fixed = [helper.make_tensor(f"at_{name}", TensorProto.INT64, [1], [PLACE[name]]) for name in names]
    fixed.append(helper.make_tensor("gains", TensorProto.FLOAT, [3, 1], gains.tolist()))
    nodes = [helper.make_node("Gather", ["observation", f"at_{name}"], [name], axis=1) for name in names]
    nodes += [
        helper.make_node("Div", ["change_n", "dt_s"], ["rate"]),
        helper.make_node("Concat", ["error_n", "rate", "ahead_m"], ["features"], axis=1),
        helper.make_node("MatMul", ["features", "gains"], ["sum"]),
        helper.make_node("Tanh", ["sum"], ["action"]),
    ]
    given = helper.make_tensor_value_info("observation", TensorProto.FLOAT, [1, len(OBSERVED)])
    answer = helper.make_tensor_value_info("action", TensorProto.FLOAT, [1, 1])
    graph = helper.make_graph(nodes, "linear policy", [given], [answer], fixed)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    checker.check_model(model)
    path.write_bytes(model.SerializeToString())


def main() -> None:
    """Train, and write the file; an existing file is an error."""
    options = argparse.ArgumentParser(description="Train a linear policy, and write it as ONNX.")
    options.add_argument("file", type=Path)
    options.add_argument("--latency", choices=LATENCY, default="drawn")
    options.add_argument("--generations", type=int, default=10)
    options.add_argument("--weights", type=float, nargs=3, help="write these, and search for none")
    chosen = options.parse_args()
    if chosen.file.exists():
        options.error(f"{chosen.file} already exists; give another name")
    weights = chosen.weights or train(chosen.latency, chosen.generations)
    write_onnx(weights, chosen.file)
    print(f"weights {weights} are in {chosen.file}")


if __name__ == "__main__":
    main()
