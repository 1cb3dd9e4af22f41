"""The paper's simulation: a controller on a wall, with a robot that only reports whole resolution steps."""

from collections.abc import Callable
from dataclasses import dataclass
from random import Random
from typing import Any

import pytest

from hil_bridge.control import FiguresOfMerit, ForceTrace, Measurement, figures_of_merit

STEP = 0.125e-3
PERIOD = 0.18


@dataclass(frozen=True)
class WallRun:
    forces: list[float]
    commanded: list[float]
    stiffnesses: list[float | None]
    merit: FiguresOfMerit


def press_on_wall(
    controller, stiffness: float, seed: int, reference: float = 50.0, samples: int = 200
) -> WallRun:
    """Simulate a start in contact at zero force; the position loop settles within a sample; noise is uniform ±0.5 N."""
    noise, state, commanded = Random(seed), controller.initial(), 0.0
    forces, commands, estimates = [], [], []
    for k in range(samples):
        position = round(commanded / STEP) * STEP
        force = stiffness * max(position, 0.0) + noise.uniform(-0.5, 0.5)
        measurement = Measurement(k * PERIOD, force, position, commanded)
        state, command = controller.step(state, measurement, reference)
        forces.append(force)
        commands.append(position)
        estimates.append(command.stiffness)
        commanded = command.position
    times = [k * PERIOD for k in range(samples)]
    merit = figures_of_merit(ForceTrace(times, forces, reference, commands, [True] * samples))
    return WallRun(forces, commands, estimates, merit)


@pytest.fixture(scope="session")
def wall() -> Callable[..., WallRun]:
    return press_on_wall


@pytest.fixture(scope="session")
def wall_means() -> Callable[..., dict[str, float]]:
    """Mean figures of merit of 20 noise seeds."""

    def means(controller, stiffness: float, **how: Any) -> dict[str, float]:
        runs = [press_on_wall(controller, stiffness, seed, **how).merit for seed in range(20)]
        names = (
            "rise_samples",
            "overshoot_percent",
            "steady_peak_to_peak_n",
            "steady_mean_error_n",
            "steps_per_s",
        )
        return {name: sum(getattr(run, name) for run in runs) / len(runs) for name in names}

    return means
