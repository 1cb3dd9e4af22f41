"""Query of a configuration's control loop about one observation at a time."""

import math
from dataclasses import dataclass, replace

from hil_bridge.control import (
    Command,
    ControlLoop,
    Decision,
    Intent,
    LoopState,
    Measurement,
    Phase,
    Proposal,
    Sample,
    StrokeState,
    SupervisorState,
    Target,
)
from hil_bridge.control.course.contact_sample import ContactSample
from hil_bridge.control.course.free_space import FreeSpace
from hil_bridge.control.course.oscillation import Advice, Finding, OscillationState
from hil_bridge.control.course.state import Course, StepState
from hil_bridge.control.course.verdict import Retreat
from hil_bridge.control.program.state import ProgramState
from hil_bridge.errors.causes import Cause, Reason
from hil_bridge.runs.setup import Setup
from hil_bridge.settings.configuration import Config
from protocol.geometry import Vector

_NOW = 1000.0
"""Time of the observation, s; arbitrary."""
_SEQUENCE = 1_000_000
"""Frame counter of the observation; arbitrary."""


@dataclass(frozen=True, slots=True)
class Situation:
    """An observation and its history. None: as in an undisturbed run of this configuration."""

    phase: Phase = Phase.TRACK
    force_n: float | None = None
    """Force along the approach; by default the target force in TRACK, else 0."""
    peak_n: float | None = None
    """Force along the approach farthest from 0 of all frames since the last decision; by default the force."""
    resultant_n: float | None = None
    """Length of the force vector; by default that of the force along the approach."""
    moment_nm: float = 0.0
    """Largest length of the moment vector since the last decision."""
    age_ms: float = 0.0
    """Age of the newest frame."""
    unchanged_ms: float = 0.0
    """Time for which frames have carried identical counts."""
    still_ms: float = 0.0
    """Time of the cycles without a new frame, this one included."""
    counter_back: int = 0
    """Counts by which the frame counter went back."""
    depth_mm: float | None = None
    """Reported depth below the start; by default the commanded one."""
    commanded_mm: float | None = None
    """Depth below the start that was ordered last; by default the reported one. Without that it is where the expected
    stiffness bears the wanted force, in APPROACH the start.
    """
    wanted_mm: float | None = None
    """Next requested depth; by default a step of the task, in TRACK the depth of the last order."""
    across_mm: float = 0.0
    """Next requested distance across the approach."""
    unanswered_mm: float = 0.0
    """Increase in depth since the force last changed."""
    moved_mm: float = 0.0
    """Distance that the reported position moved since the last cycle."""
    cycle_ms: float | None = None
    """Time since then. By default it is the least line time of a cycle, and for orders the sample time of the
    controller.
    """
    against_n: float = 0.0
    """Contact force against the travel."""
    witness_n: float | None = None
    """Force along the approach as measured by the robot itself; None if it reports none."""
    disagreed_ms: float = 60_000.0
    """Time for which that and the sensor have disagreed before; by default longer than they may."""
    pulled_ms: float = 60_000.0
    """Time for which a pull in free space has lasted before; by default longer than it may."""
    unchanged_mm: float = 0.0
    """Distance that the tool moved through free space since the counts last changed."""
    strayed_mm: float = 0.0
    """Distance of the reported depth from all recent orders."""
    tilt_deg: float = 0.0
    """Angle between the reported orientation and that of the start."""
    gap_ms: float = 0.0
    """Time for which the computer stalled."""
    saturated: bool = False
    fault: str = ""
    """Description of a device's fault."""
    dead_axis: str = ""
    """Description of an axis that does not respond."""
    controller_failure: str = ""
    """Description of the controller's fault."""
    swing_n: float = 0.0
    """Amplitude of an oscillation that continues at the least gain; 0 for none."""
    stiffness_n_m: float | None = None
    """Estimate of the contact stiffness; None if there is none."""
    start_m: Vector | None = None
    """Position of the start, base frame; by default the middle of the workspace."""
    lowest_n: float | None = None
    """Resultant force that a retraction had come down to; by default the present one."""
    retracting_ms: float = 0.0
    """Time of the retraction so far; 0 for the first cycle."""
    from_contact: bool = True
    """Whether that began in contact."""
    back_mm: float = 0.0
    """Distance that the tool has moved back since the force last fell."""


class Asked:
    """The control loop of a configuration, asked about situations."""

    def __init__(self, config: Config) -> None:
        one_stroke = config.model_copy(update={"task": replace(config.task, step=())})
        self._setup = Setup(one_stroke)
        self.config = config = self._setup.config.model_copy(update={"task": config.task})
        self._loop: ControlLoop = self._setup.loop

    def __call__(self, situation: Situation) -> Decision:
        """Return the decision of the loop. Raises ConfigError for a start or a last order outside the workspace."""
        config, loop, seen = self.config, self._loop, situation
        start = seen.start_m or middle(config)
        commanded = self.commanded_mm(seen) * 1e-3
        loop.initial(start)
        depth = commanded if seen.depth_mm is None else seen.depth_mm * 1e-3
        position, before = self._at(start, depth), self._at(start, depth - seen.moved_mm * 1e-3)
        sample = self._sample(seen, position)
        force, resultant = sample.force, sample.resultant
        dt = loop.since(None if seen.cycle_ms is None else _NOW - seen.cycle_ms * 1e-3, _NOW)
        pressing = seen.phase is not Phase.APPROACH and force > config.task.loss_threshold_n
        supervisor = SupervisorState(
            commanded,
            loop.supervisor.initial(self._at(start, commanded)).position,
            _SEQUENCE if seen.still_ms or seen.counter_back else _SEQUENCE - 1,
            seen.still_ms * 1e-3 - dt if seen.still_ms else 0.0,
            (force, depth - seen.unanswered_mm * 1e-3) if pressing else None,
            None,
            (_NOW - self._cycle(seen), before),
            self._retreat(seen, resultant, depth) if seen.phase is Phase.RETRACT else None,
            disagreed=seen.disagreed_ms * 1e-3,
            free=FreeSpace(self._at(start, depth - seen.unchanged_mm * 1e-3), _NOW - seen.pulled_ms * 1e-3),
        )
        leg = next(number for number, leg in enumerate(loop.program.row.legs) if leg.phase is seen.phase)
        stroke = StrokeState(seen.phase, in_contact=pressing)
        program = ProgramState(Course(leg, _NOW), StepState(stroke))
        measurement = Measurement(
            _NOW, force, depth, commanded, pressing, saturated=seen.saturated, dt=dt, against=seen.against_n
        )
        contact = ContactSample(sample, measurement, (0.0, 0.0), (force, seen.against_n, 0.0), ())
        program, intent = self._intend(program, contact, seen)
        advice = Advice(Finding.PERSISTING, 1.0, True, seen.swing_n) if seen.swing_n else None
        proposal = Proposal(
            contact,
            intent,
            Reason(Cause.CONTROLLER, seen.controller_failure) if seen.controller_failure else None,
            advice,
            program,
            OscillationState(),
        )
        lately = depth + seen.strayed_mm * 1e-3
        trail = ((_NOW, lately, lately),) if seen.strayed_mm else ()
        _, decision = loop.judge(LoopState(start, program, supervisor, trail=trail), sample, proposal)
        return decision

    def _sample(self, seen: Situation, position: Vector) -> Sample:
        force = self.force(seen)
        resultant = abs(force) if seen.resultant_n is None else seen.resultant_n
        peak = force if seen.peak_n is None else seen.peak_n
        return Sample(
            _NOW,
            position,
            force,
            resultant=resultant,
            sensor_at=_NOW - seen.age_ms * 1e-3,
            sensor_sequence=_SEQUENCE - seen.counter_back,
            saturated=seen.saturated,
            dead_axis=seen.dead_axis,
            fault=Reason(Cause.ROBOT_STATE, seen.fault) if seen.fault else None,
            force_travel=seen.against_n,
            peak_force=peak,
            peak_resultant=max(resultant, abs(peak)),
            peak_moment=seen.moment_nm,
            tilt=math.radians(seen.tilt_deg),
            gap=seen.gap_ms * 1e-3,
            unchanged=seen.unchanged_ms * 1e-3,
            witness=seen.witness_n,
        )

    def force(self, seen: Situation) -> float:
        """Force along the approach, N."""
        if seen.force_n is not None:
            return seen.force_n
        return self.config.task.force_n if seen.phase is Phase.TRACK else 0.0

    def commanded_mm(self, seen: Situation) -> float:
        """Depth of the last order."""
        if seen.commanded_mm is not None:
            return seen.commanded_mm
        if seen.depth_mm is not None:
            return seen.depth_mm
        task = self.config.task
        return 0.0 if seen.phase is Phase.APPROACH else task.force_n / task.expected_stiffness_n_m * 1e3

    def _at(self, start: Vector, depth: float) -> Vector:
        (x, y, z), (a, b, c) = start, self._loop.program.frame.approach
        return x + a * depth, y + b * depth, z + c * depth

    def _cycle(self, seen: Situation) -> float:
        if seen.cycle_ms is not None:
            return seen.cycle_ms * 1e-3
        robot = self._setup.facts
        return max(robot.cycle_s or robot.line_floor_s or 0.0, self.config.run.period_ms * 1e-3)

    @staticmethod
    def _retreat(seen: Situation, resultant: float, depth: float) -> Retreat | None:
        if not seen.retracting_ms:
            return None
        lowest = resultant if seen.lowest_n is None else seen.lowest_n
        began = _NOW - seen.retracting_ms * 1e-3
        return Retreat(began, seen.from_contact, lowest, depth + seen.back_mm * 1e-3)

    def _intend(
        self, program: ProgramState, contact: ContactSample, seen: Situation
    ) -> tuple[ProgramState, Intent]:
        """Intent of program and controller; the stroke's own where it needs no memory of the controller."""
        measurement = contact.measurement
        if seen.phase is Phase.RETRACT and seen.wanted_mm is None:
            return self._loop.program.step(program, contact)
        speed_mm_s = self.config.task.approach_speed_mm_s if seen.phase is Phase.APPROACH else 0.0
        step = self._loop.program.stroke.way(speed_mm_s, measurement.dt)
        wanted = measurement.commanded + step if seen.wanted_mm is None else seen.wanted_mm * 1e-3
        command = None
        if seen.phase is Phase.TRACK:
            command = Command(wanted, wanted - measurement.commanded, seen.stiffness_n_m)
        target = Target(wanted, seen.across_mm * 1e-3)
        return program, Intent(seen.phase, target, measurement.in_contact, command, leg=program.course.leg)


def middle(config: Config) -> Vector:
    """Middle of the workspace, base frame, m."""
    low, high = config.limits.workspace_min_m, config.limits.workspace_max_m
    x, y, z = ((a + b) / 2 for a, b in zip(low, high, strict=True))
    return x, y, z
