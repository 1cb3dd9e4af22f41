"""Run without steps, sample by sample: an approach, a straight path, a retraction."""

import math
from collections.abc import Callable, Sequence
from typing import Any

from hil_bridge.control import (
    ControlLoop,
    Decision,
    Intent,
    Limits,
    Measurement,
    Sample,
    Stroke,
    Supervisor,
    TaskParameters,
)
from hil_bridge.control.course.contact_sample import ContactSample
from hil_bridge.control.decision import LoopState
from hil_bridge.control.geometry.work_frame import WorkFrame
from hil_bridge.control.program.legs import Ground, legs_of
from hil_bridge.control.program.program import Program
from hil_bridge.control.program.state import ProgramState
from hil_bridge.control.steps.seam import Step
from hil_bridge.control.steps.settings import plain_steps
from hil_bridge.errors import Reason
from protocol.geometry import Vector

DOWN, ALONG, ACROSS = (0.0, 0.0, -1.0), (0.0, 1.0, 0.0), (-1.0, 0.0, 0.0)
START = (0.9, 0.0, 0.6)
"""Start position of the tool in `walk`, m."""
DT = 0.012
"""Sample time of `walk`, s."""
LONG_S = 1e6
"""Time of tracking that no test reaches, s."""


def plain_program(
    parameters: TaskParameters,
    controller: Any,
    limit: float = math.inf,
    position_step: float | None = None,
    duration_s: float = LONG_S,
) -> Program:
    """Return the program of a run without steps."""
    stroke = Stroke(parameters, controller, limit, position_step)
    limits = Limits(force_limit_n=min(limit, Limits().force_limit_n))
    row = legs_of(plain_steps(parameters, duration_s), Ground(stroke, limits), written=False)
    return Program(row, stroke, WorkFrame(DOWN, ALONG, ACROSS))


def guarded(steps: Sequence[Step], stroke: Stroke, limits: Limits) -> ControlLoop:
    """Return a control loop that runs these steps under the guard."""
    program = Program(legs_of(steps, Ground(stroke, limits)), stroke, WorkFrame(DOWN, ALONG, ACROSS))
    return ControlLoop(program, Supervisor(limits), sample_time=DT)


def walk(
    loop: ControlLoop, respond: Callable[[LoopState, float, Vector], dict[str, Any]], most: int = 3000
) -> list[Decision]:
    """Return the decisions until the run ends, for a robot that follows its orders exactly. `respond` returns the force
    and further parts of a sample; its arguments are the state before the sample, the time since the start, s, and the
    displacement from the start position, m: depth, x, y.
    """
    state, position = loop.initial(START), START
    decisions: list[Decision] = []
    for k in range(most):
        x, y, z = (at - start for at, start in zip(position, START, strict=True))
        parts = respond(state, k * DT, (-z, y, -x))
        now, force = 100.0 + k * DT, parts.pop("force")
        sample = Sample(now, position, force, abs(force), now - 1e-3, k, **parts)
        state, decision = loop.step(state, sample)
        decisions.append(decision)
        position = decision.position
        if decision.ended:
            return decisions
    raise AssertionError("the run does not end")


class PlainRun:
    """Adapter that passes measurements to a program without steps, at the ordered positions along the path."""

    def __init__(
        self,
        parameters: TaskParameters,
        controller: Any,
        limit: float = math.inf,
        position_step: float | None = None,
        duration_s: float = LONG_S,
    ) -> None:
        self.program = plain_program(parameters, controller, limit, position_step, duration_s)
        self.stroke = self.program.stroke

    def initial(self) -> ProgramState:
        return self.program.initial()

    def finish(self, state: ProgramState, reason: Reason) -> ProgramState:
        return self.program.finish(state, reason)

    def step(self, state: ProgramState, measurement: Measurement) -> tuple[ProgramState, Intent]:
        return self.program.step(*sense(self.program, state, contact_of(measurement, state.step.at)))


def sense(
    program: Program, state: ProgramState, contact: ContactSample
) -> tuple[ProgramState, ContactSample]:
    """Return the sample as this program sees it, of a tool that started at 0, 0, 0."""
    measurement = contact.measurement
    return program.sense(state, contact.sample, (0.0, 0.0, 0.0), measurement.commanded, measurement.dt)


def contact_of(
    measurement: Measurement,
    travelled: tuple[float, float] = (0.0, 0.0),
    aside: tuple[float, float] = (0.0, 0.0),
) -> ContactSample:
    """Return a program's sample of a tool that points down; `aside` holds the forces along x and y, N."""
    force = measurement.force
    position = travelled[0], travelled[1], -measurement.position
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
    return ContactSample(sample, measurement, travelled, (force, *aside), (0.0,) * 6)
