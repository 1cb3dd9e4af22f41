"""A run without steps, sample by sample: an approach, a straight way, a retraction."""

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
"""Where the tool of `walk` begins, m."""
DT = 0.012
"""Its sample time, s."""
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


def guarded(steps: Sequence[Step], stroke: Stroke, limits: Limits) -> ControlLoop:
    """These steps under the guard."""
    program = Program(legs_of(steps, Ground(stroke, limits)), stroke, WorkFrame(DOWN, ALONG, ACROSS))
    return ControlLoop(program, Supervisor(limits), sample_time=DT)


def walk(
    loop: ControlLoop, tell: Callable[[LoopState, float, Vector], dict[str, Any]], most: int = 3000
) -> list[Decision]:
    """Decisions until the run ends, of a robot that is where it is sent. `tell` gives the force and further parts of a
    sample, by the state before it, the time since the begin, s, and the way from the start point, m: deep, x, y.
    """
    state, position = loop.initial(START), START
    decisions: list[Decision] = []
    for k in range(most):
        x, y, z = (at - begin for at, begin in zip(position, START, strict=True))
        parts = tell(state, k * DT, (-z, y, -x))
        now, force = 100.0 + k * DT, parts.pop("force")
        sample = Sample(now, position, force, abs(force), now - 1e-3, k, **parts)
        state, decision = loop.step(state, sample)
        decisions.append(decision)
        position = decision.position
        if decision.ended:
            return decisions
    raise AssertionError("the run does not end")


class PlainRun:
    """Takes measurements through such a program, in places along the way that was ordered."""

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
        return self.program.step(*sense(self.program, state, felt_of(measurement, state.step.at)))


def sense(program: Program, state: ProgramState, felt: ContactSample) -> tuple[ProgramState, ContactSample]:
    """The sample of a tool that began at 0, 0, 0, as this program sees it."""
    measurement = felt.measurement
    return program.sense(state, felt.sample, (0.0, 0.0, 0.0), measurement.commanded, measurement.dt)


def felt_of(
    measurement: Measurement, place: tuple[float, float] = (0.0, 0.0), aside: tuple[float, float] = (0.0, 0.0)
) -> ContactSample:
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
    return ContactSample(sample, measurement, place, (force, *aside), (0.0,) * 6)
