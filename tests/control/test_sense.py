"""Sample as a program receives it, compared with numpy, with a rotated tool and a frame not aligned with the base."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from msgspec.structs import replace
from scipy.spatial.transform import Rotation

from hil_bridge.control import Limits, TaskParameters
from hil_bridge.control.course.contact_sample import ContactSample
from hil_bridge.control.course.facing import FacingState
from hil_bridge.control.course.intent import Phase
from hil_bridge.control.course.state import Course, StepState
from hil_bridge.control.course.stroke import Stroke, StrokeState
from hil_bridge.control.geometry.ways import Place, Way, way_of
from hil_bridge.control.geometry.work_frame import WorkFrame
from hil_bridge.control.program.legs import Ground, legs_of
from hil_bridge.control.program.program import Program
from hil_bridge.control.program.state import ProgramState
from hil_bridge.control.sample import Sample
from hil_bridge.control.steps.approach import Approach
from hil_bridge.control.steps.move import Move
from hil_bridge.control.steps.paths import Line, Polyline
from hil_bridge.control.steps.retract import Retract
from hil_bridge.control.steps.seam import Step
from hil_bridge.control.steps.track import Track
from hil_bridge.errors import Cause, Reason
from protocol.geometry import Vector
from tests.control.test_program_course import Presses

AXES = Rotation.from_rotvec((0.3, -0.8, 0.5)).as_matrix()
FRAME = WorkFrame(*(tuple(row) for row in AXES.tolist()))
START: Vector = (0.9, -0.2, 0.6)
POSITION: Vector = (0.91, -0.17, 0.64)
ORDERED, DT = 2e-3, 0.012
BENT = Polyline(points_mm=((0.0, 0.0), (30.0, 40.0), (30.0, 90.0)))
HEADING = 0.6, 0.8
"""Direction of its first piece."""
SAMPLE = Sample(
    1.0,
    POSITION,
    9.0,
    12.0,
    0.99,
    7,
    force_travel=2.0,
    wrench=(3.0, -1.0, 7.0, 0.5, 0.6, 0.7),
    quaternion=tuple(Rotation.from_rotvec((1.0, -0.4, 0.2)).as_quat(scalar_first=True).tolist()),
    paired_force=8.5,
    force_across=-3.0,
)


@dataclass(frozen=True, slots=True)
class Sweeps(Move):
    """A move of a plug-in along a path."""

    def make_way(self, begin: Place | None) -> Way:
        return way_of(Line(length_mm=20.0).corners((0.0, 0.0)))


def program_of(*steps: Step) -> Program:
    stroke = Stroke(TaskParameters(approach_depth_limit_mm=30.0), Presses(), 50.0, 1e-6)
    return Program(legs_of(steps, Ground(stroke, Limits(), 50.0)), stroke, FRAME)


TRACKING = program_of(Approach(), Track(path=BENT), Retract())
ON_THE_TRACK = ProgramState(
    Course(leg=1, began=0.0, start=(0.0, 0.0), origin=(3e-3, -2e-3), base=0.1), StepState(heading=HEADING)
)


def changed(
    state: ProgramState, *, heading: Place = HEADING, at: Place = (0.0, 0.0), **course: Any
) -> ProgramState:
    """State with other values in its course, and another path."""
    return ProgramState(replace(state.course, **course), StepState(heading=heading, at=at))


def sense(
    program: Program, state: ProgramState, sample: Sample = SAMPLE
) -> tuple[ProgramState, ContactSample]:
    return program.sense(state, sample, START, ORDERED, DT)


def test_sense_uses_work_frame_axes() -> None:
    state, contact = sense(TRACKING, TRACKING.initial())
    depth, x, y = AXES @ (np.array(POSITION) - START)
    measurement = contact.measurement
    assert (measurement.position, *contact.place) == pytest.approx((depth, x, y), abs=1e-15)
    assert contact.force == (9.0, 2.0, -3.0)
    assert contact.wrench == SAMPLE.wrench
    assert (measurement.force, measurement.paired_force) == (9.0, 8.5)
    assert (measurement.time, measurement.commanded, measurement.dt) == (0.99, ORDERED, DT)
    assert measurement.travel == contact.place[0]
    assert measurement.advance == 1.0
    assert state.course.start is not None


def test_sense_held_tool_does_not_advance() -> None:
    assert sense(TRACKING, ON_THE_TRACK, replace(SAMPLE, held=True))[1].measurement.advance == 0.0


def test_sense_travel_starts_at_path_start() -> None:
    state, contact = sense(TRACKING, ON_THE_TRACK)
    x, y = contact.place
    along = (x - 3e-3) * HEADING[0] + (y + 2e-3) * HEADING[1]
    assert 0.0 < along < 50e-3, "on the first piece"
    assert state.course.reached == pytest.approx(along, abs=1e-15)
    assert contact.measurement.travel == pytest.approx(0.1 + along, abs=1e-15)
    assert contact.measurement.against == pytest.approx(2.0 * HEADING[0] - 3.0 * HEADING[1], abs=1e-15)


def test_sense_new_step_uses_its_own_path() -> None:
    before = changed(ON_THE_TRACK, began=None, at=(2e-3, 1e-3), heading=(0.0, 1.0), reached=0.01)
    _, contact = sense(TRACKING, before)
    x, y = contact.place
    along = (x - 2e-3) * HEADING[0] + (y - 1e-3) * HEADING[1]
    assert contact.measurement.travel == pytest.approx(before.step.stroke.travel + along, abs=1e-15)
    assert contact.measurement.against == pytest.approx(2.0 * HEADING[0] - 3.0 * HEADING[1], abs=1e-15)


def test_sense_leaving_tool_keeps_last_direction() -> None:
    leaving = changed(ON_THE_TRACK, began=None, reason=Reason(Cause.FORCE, "too much"), heading=(0.0, 1.0))
    assert sense(TRACKING, leaving)[1].measurement.against == -3.0


def test_sense_subtracts_program_zero_from_forces() -> None:
    zero = (1.0, 2.0, -4.0, 0.1, -0.2, 0.3)
    turn = Rotation.from_quat(SAMPLE.quaternion, scalar_first=True)
    added = AXES @ turn.apply(zero[:3])
    measurement = (contact := sense(TRACKING, changed(ON_THE_TRACK, zero=zero))[1]).measurement
    force = np.array((9.0, 2.0, -3.0)) + added
    assert contact.force == pytest.approx(force, abs=1e-12)
    assert measurement.force == contact.force[0]
    assert measurement.paired_force == pytest.approx(8.5 + added[0], abs=1e-12)
    assert measurement.against == pytest.approx(force[1] * HEADING[0] + force[2] * HEADING[1], abs=1e-12)
    assert contact.wrench == pytest.approx(np.array(SAMPLE.wrench) - zero, abs=1e-12)
    unpaired = sense(TRACKING, changed(ON_THE_TRACK, zero=zero), replace(SAMPLE, paired_force=None))
    assert unpaired[1].measurement.paired_force is None


def test_sense_missing_force_across_is_from_wrench() -> None:
    turn = Rotation.from_quat(SAMPLE.quaternion, scalar_first=True)
    _, contact = sense(TRACKING, ON_THE_TRACK, replace(SAMPLE, force_across=None))
    assert contact.force[2] == pytest.approx(-AXES[2] @ turn.apply(SAMPLE.wrench[:3]), abs=1e-12)
    for unknown in (replace(SAMPLE, quaternion=()), replace(SAMPLE, wrench=())):
        assert sense(TRACKING, ON_THE_TRACK, replace(unknown, force_across=None))[1].force == (9.0, 2.0, 0.0)


@pytest.mark.parametrize(
    ("step", "against"), [(Move(to_mm=(5.0, 0.0)), 0.0), (Sweeps(to_mm=(5.0, 0.0)), 2.0)]
)
def test_sense_force_against_needs_a_path(step: Step, against: float) -> None:
    program = program_of(step, Approach(), Retract())
    assert program.row.legs[0].phase is Phase.MOVE
    assert sense(program, program.initial())[1].measurement.against == against


def test_sense_held_tool_along_normal_does_not_advance() -> None:
    stroke = Stroke(TaskParameters(approach_depth_limit_mm=30.0), Presses(), 50.0, 1e-6)
    row = legs_of((Approach(), Track(path=BENT), Retract()), Ground(stroke, Limits(), 50.0, follows=True))
    program = Program(row, stroke, FRAME)
    course = replace(ON_THE_TRACK.course, facing=FacingState(fall=(0.2, 0.0)))
    tracking = ProgramState(course, StepState(StrokeState(Phase.TRACK, in_contact=True), heading=HEADING))
    slope = 0.2 * HEADING[0]
    advance = 1.0 / math.sqrt(1.0 + slope * slope)
    assert sense(program, tracking)[1].measurement.advance == pytest.approx(advance)
    assert sense(program, tracking, replace(SAMPLE, held=True))[1].measurement.advance == 0.0
