"""Record of a cycle."""

import math
from typing import NamedTuple

from hil_bridge.control import Command, Decision, Sample, TaskParameters, numeric_explanation
from hil_bridge.devices.robots.seam import ANSWER, PACKET, QUESTION_LEFT, RobotReport
from hil_bridge.errors.causes import Reason
from hil_bridge.record import CycleRecord
from protocol.geometry import Vector


class Course(NamedTuple):
    """Values of a cycle that come from its course. The fields have the names of the record's fields."""

    cycle: int
    started_at: float
    decoded_at: float
    proposed_at: float
    controlled_at: float
    answered_at: float
    sensor_counter: int
    start: Vector
    asked: Reason | None
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
        **course._asdict(),
        phase=output.phase,
        force=decision.force,
        force_reference=task.force_n if output.reference is None else output.reference,
        status_transmitted_at=stamps.get(QUESTION_LEFT, math.nan),
        answer_s=stamps[ANSWER] - stamps[PACKET] if ANSWER in stamps else math.nan,
        depth=decision.depth,
        depth_commanded=decision.target.depth,
        travel_commanded=decision.target.travel,
        across_commanded=decision.target.across,
        quaternion_commanded=decision.quaternion or (),
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
        sample=sample,
    )
