"""A run without steps, sample by sample: an approach, a straight way, a retraction."""

import math
from typing import Any

from hil_bridge.control import Intent, Limits, Measurement, Sample, Stroke, TaskParameters
from hil_bridge.control.program.felt import WorkFrame
from hil_bridge.control.program.legs import Ground, legs_of
from hil_bridge.control.program.program import Program
from hil_bridge.control.program.state import Felt, ProgramState
from hil_bridge.control.steps.settings import plain_steps
from hil_bridge.errors import Reason

DOWN, ALONG, ACROSS = (0.0, 0.0, -1.0), (0.0, 1.0, 0.0), (-1.0, 0.0, 0.0)
LONG_S = 1e6
"""Time of tracking that no test comes to, s."""


def plain_program(
    parameters: TaskParameters,
    controller: Any,
    limit: float = math.inf,
    position_step: float | None = None,
    duration_s: float = LONG_S,
) -> Program:
    """The program of a run without steps."""
    stroke = Stroke(parameters, controller, limit, position_step)
    limits = Limits(force_limit_n=min(limit, Limits().force_limit_n))
    row = legs_of(plain_steps(parameters, duration_s), Ground(stroke, limits), written=False)
    return Program(row, stroke, WorkFrame(DOWN, ALONG, ACROSS))


class PlainRun:
    """Takes measurements through such a program, in places along the way that was ordered."""

    def __init__(
        self,
        parameters: TaskParameters,
        controller: Any,
        limit: float = math.inf,
        position_step: float | None = None,
    ) -> None:
        self.program = plain_program(parameters, controller, limit, position_step)
        self.stroke = self.program.stroke

    def initial(self) -> ProgramState:
        return self.program.initial()

    def finish(self, state: ProgramState, reason: Reason) -> ProgramState:
        return self.program.finish(state, reason)

    def step(self, state: ProgramState, measurement: Measurement) -> tuple[ProgramState, Intent]:
        return self.program.step(*sense(self.program, state, felt_of(measurement, state.at)))


def sense(program: Program, state: ProgramState, felt: Felt) -> tuple[ProgramState, Felt]:
    """The sample of a tool that began at 0, 0, 0, as this program sees it."""
    measurement = felt.measurement
    return program.sense(state, felt.sample, (0.0, 0.0, 0.0), measurement.commanded, measurement.dt)


def felt_of(
    measurement: Measurement, place: tuple[float, float] = (0.0, 0.0), aside: tuple[float, float] = (0.0, 0.0)
) -> Felt:
    """A sample as a program sees it, of a tool that points down; `aside` are the forces along x and y, N."""
    force = measurement.force
    position = place[0], place[1], -measurement.position
    sample = Sample(
        measurement.time,
        position,
        force,
        abs(force),
        measurement.time,
        1,
        saturated=measurement.saturated,
        force_travel=aside[0],
        paired_force=measurement.paired_force,
        force_across=aside[1],
    )
    return Felt(sample, measurement, place, (force, *aside), (0.0,) * 6)
