"""The paper's simulation: a controller on a wall, through a position loop that settles within each sample.

Source: project specification of the force control, section 4. The position moves in whole resolution steps, and the
force has uniform noise of half a newton either way. The run begins in contact at zero force.
"""

from dataclasses import dataclass
from random import Random
from typing import NamedTuple

from hil_bridge.control import FiguresOfMerit, ForceTrace, Measurement, figures_of_merit, make_controller

RESOLUTION = 0.125e-3
"""m. Source: the paper."""
NOISE_N = 0.5
"""Half-width of the uniform force noise. Source: the paper."""
PERIOD = 0.18
"""s between samples, which only names them: the computer link at 9600 baud takes about as long."""

Parameters = tuple[tuple[str, str | float | bool | None], ...]


class PaperRun(NamedTuple):
    """Results of a run, one value a sample."""

    force: tuple[float, ...]
    """N, as measured."""
    position: tuple[float, ...]
    """m, whole resolution steps."""
    merit: FiguresOfMerit


@dataclass(frozen=True, slots=True)
class PaperJob:
    """One run of the paper's simulation."""

    controller: str
    parameters: Parameters
    stiffness: float
    """k_e, N/m"""
    reference: float
    """f_d, N"""
    seed: int
    samples: int = 200
    resolution: float = RESOLUTION
    """m"""
    noise: float = NOISE_N
    """Half-width of the uniform force noise, N."""

    def __call__(self) -> PaperRun:
        """Run it."""
        controller = make_controller(self.controller, **dict(self.parameters))
        noise, state, commanded = Random(self.seed), controller.initial(), 0.0
        forces, positions = [], []
        for k in range(self.samples):
            position = round(commanded / self.resolution) * self.resolution
            force = self.stiffness * max(position, 0.0) + noise.uniform(-self.noise, self.noise)
            measurement = Measurement(k * PERIOD, force, position, commanded)
            state, command = controller.step(state, measurement, self.reference)
            forces.append(force)
            positions.append(position)
            commanded = command.position
        times, touching = [k * PERIOD for k in range(self.samples)], [True] * self.samples
        trace = ForceTrace(times, forces, self.reference, positions, touching)
        merit = figures_of_merit(trace, self.resolution * 1e3)
        return PaperRun(tuple(forces), tuple(positions), merit)
