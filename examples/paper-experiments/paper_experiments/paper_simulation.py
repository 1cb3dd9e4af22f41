"""The paper's simulation: a controller on a wall, through a position loop that settles within each sample.

Source: project specification of the force control, section 4. The position moves in entire resolution steps, and the
force has uniform noise of ± 0.5 N. The run begins in contact at zero force.
"""

from dataclasses import dataclass
from random import Random
from typing import NamedTuple

from hil_bridge.control import FiguresOfMerit, ForceTrace, Measurement, figures_of_merit, make_controller

RESOLUTION = 0.125e-3
"""Position resolution, m. Source: the paper."""
NOISE_N = 0.5
"""Half-width of the uniform force noise. Source: the paper."""
PERIOD = 0.18
"""Nominal time between samples, s: about as long as the computer link takes at 9600 baud."""

Parameters = tuple[tuple[str, str | float | bool | None], ...]


class PaperRun(NamedTuple):
    """Results of a run, one value per sample."""

    force: tuple[float, ...]
    """Measured force, N."""
    position: tuple[float, ...]
    """Position in m, a multiple of the resolution."""
    merit: FiguresOfMerit


@dataclass(frozen=True, slots=True)
class PaperJob:
    """Run of the paper's simulation."""

    controller: str
    parameters: Parameters
    stiffness: float
    """Stiffness k_e, N/m."""
    reference: float
    """Target force f_d, N."""
    seed: int
    samples: int = 200
    resolution: float = RESOLUTION
    """Position resolution, m."""
    noise: float = NOISE_N
    """Half-width of the uniform force noise, N."""

    def __call__(self) -> PaperRun:
        """Run the simulation."""
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
