"""Record of a cycle."""

import math

from msgspec import Struct

from hil_bridge.control import Command, Decision, Sample, TaskParameters, numeric_explanation
from hil_bridge.devices.robots.seam import ANSWER, PACKET, QUESTION_LEFT, RobotReport
from hil_bridge.errors.causes import Reason
from hil_bridge.record import CycleRecord
from protocol.geometry import Vector


class Course(Struct, frozen=True, gc=False):
    """Values of a cycle that come from its course."""

    cycle: int
    started_at: float
    decoded_at: float
    proposed_at: float
    controlled_at: float
    answered_at: float
    sensor_counter: int
    start: Vector
    request: Reason | None
    """Request to end, or failure outside the cycles, that the decision follows, or None."""
    step: int
    correction: float
    sent_at: float
    transmitted_at: float


def cycle_record(
    report: RobotReport, sample: Sample, decision: Decision, course: Course, task: TaskParameters
) -> CycleRecord:
    """Return the record of a cycle."""
    output = decision.intent
    command = output.command or Command(decision.target.depth, 0.0)
    stamps = dict(report.stamps)
    return CycleRecord(
        cycle=course.cycle,
        phase=output.phase,
        started_at=course.started_at,
        controlled_at=course.controlled_at,
        sent_at=course.sent_at,
        answered_at=course.answered_at,
        sample=sample,
        force=decision.force,
        force_reference=task.force_n if output.reference is None else output.reference,
        depth=decision.depth,
        depth_commanded=decision.target.depth,
        travel_commanded=decision.target.travel,
        correction=course.correction,
        stiffness=command.stiffness,
        gain=command.gain,
        held=command.held,
        in_contact=output.in_contact,
        verdict=decision.verdict.kind,
        reasons=decision.reasons,
        explanation={
            **numeric_explanation(command.explanation),
            "feedback_m": command.correction,
            **output.notes,
        },
        target=decision.position,
        start=course.start,
        asked=course.request,
        status_transmitted_at=stamps.get(QUESTION_LEFT, math.nan),
        decoded_at=course.decoded_at,
        proposed_at=course.proposed_at,
        transmitted_at=course.transmitted_at,
        sensor_counter=course.sensor_counter,
        answer_s=stamps[ANSWER] - stamps[PACKET] if ANSWER in stamps else math.nan,
        across_commanded=decision.target.across,
        step=course.step,
        quaternion_commanded=decision.quaternion or (),
    )
