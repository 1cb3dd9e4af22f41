"""Point at which an interrupted program can continue, from its recording. A program never resumes by itself; an
operator requests it.
"""

from dataclasses import replace
from typing import Any

from hil_bridge.control.course.intent import Phase
from hil_bridge.control.program.leg import Leg
from hil_bridge.control.program.program import Program
from hil_bridge.control.program.resume import FIRST, OVERLAP_MM, good_until
from hil_bridge.control.steps.settings import ResumePoint
from hil_bridge.errors import ConfigError
from hil_bridge.record import CycleRecord, Recording
from hil_bridge.runs.replay import recorded_config
from hil_bridge.runs.setup import Setup
from hil_bridge.settings.configuration import Config
from protocol.geometry import normalise

_BAND_SHARE = 0.1
"""Largest error of the force for a step without a criterion, as a share of the desired force. Chosen."""


def resume_config(recording: Recording, changes: dict[str, Any], overlap_mm: float = OVERLAP_MM) -> Config:
    """Return the configuration of a recorded run with the given changes, and the point at which its program
    continues.

    Raises ConfigError for a run without a program, for a run that was not interrupted, or if its program cannot be
    compiled.
    """
    config = recorded_config(recording, changes)
    if not config.task.step:
        raise ConfigError("the recorded run has no program (task.step): start it again")
    if recording.end.get("outcome") == "completed":
        raise ConfigError("the recorded run completed: there is nothing to resume")
    point = _point(Setup(config).loop.program, recording, config, overlap_mm)
    # injected faults belonged to the first run
    return config.model_copy(update={"task": replace(config.task, resume=point), "faults": ()})


def _point(program: Program, recording: Recording, config: Config, overlap_mm: float) -> ResumePoint:
    """Return the point from which the program continues, a little before the interruption."""
    cycles, before = recording.cycles, config.task.resume
    number = max((cycle.step for cycle in cycles), default=0) - 1
    if number < 0:
        raise ConfigError("the recording does not say which step was in progress: start the program again")
    if before is not None and number < FIRST:
        return before  # it never returned to the step
    leg, own = program.row.legs[number], [cycle for cycle in cycles if cycle.step == number + 1]
    cut = own[0]
    number_first = cycles.index(cut)
    origin = (0.0, 0.0) if not number_first else _place(cycles[number_first - 1])
    way = _length_done(leg, own, origin, overlap_mm)
    x, y = leg.way.at(way) if leg.way is not None else (0.0, 0.0)
    start = before.start_m if before is not None else _start(recording)
    if leg.step.phase is Phase.RETRACT and number + 1 < len(program.row.legs):
        number, way = number + 1, 0.0  # the run has retracted the tool itself
        x, y = (a - b for a, b in zip(_place(own[-1]), origin, strict=True))
    first = _in_frame(program, cycles[0])
    place = first[0] + origin[0] + x, first[1] + origin[1] + y
    offset, done = (before.leg - FIRST, before.way_mm) if before is not None else (0, 0.0)
    return ResumePoint(
        leg=number + offset,
        way_mm=way * 1e3 + (done if before is not None and number == FIRST else 0.0),
        place_mm=(place[0] * 1e3, place[1] * 1e3),
        start_m=start,
        quaternion=before.quaternion if before is not None else _quaternion(recording),
        spent_s=own[-1].started_at - own[0].started_at,
    )


def _length_done(leg: Leg, own: list[CycleRecord], origin: tuple[float, float], overlap_mm: float) -> float:
    """Return the path length from which an interrupted step continues, m."""
    samples = [
        (
            (cycle.travel_commanded - origin[0], cycle.across_commanded - origin[1]),
            cycle.force,
            cycle.force_reference,
        )
        for cycle in own
        if cycle.in_contact and cycle.phase == "track"
    ]
    return max(good_until(leg, samples, _BAND_SHARE) - overlap_mm * 1e-3, 0.0)


def _in_frame(program: Program, cycle: CycleRecord) -> tuple[float, float]:
    """Return the start point of the run in the work frame, m."""
    frame = program.frame
    if frame.origin is None:
        return 0.0, 0.0
    x, y = (
        sum((p - o) * n for p, o, n in zip(cycle.start, frame.origin, axis, strict=True))
        for axis in (frame.x, frame.y)
    )
    return x, y


def _place(cycle: CycleRecord) -> tuple[float, float]:
    return cycle.travel_commanded, cycle.across_commanded


def _start(recording: Recording) -> tuple[float, float, float]:
    x, y, z = recording.cycles[0].start
    return x, y, z


def _quaternion(recording: Recording) -> tuple[float, float, float, float]:
    return normalise(recording.cycles[0].sample.quaternion)


def describe_resume(config: Config) -> str:
    """Return one line that describes where the program continues."""
    program = Setup(config).loop.program
    point = config.task.resume
    assert point is not None
    leg = program.row.legs[FIRST]
    where = "from its start" if leg.way is None else f"{point.way_mm:.1f} mm along its path"
    return f"resuming step {leg.label} {where}; first a move, a zero and an approach"
