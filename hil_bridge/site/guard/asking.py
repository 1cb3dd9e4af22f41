"""Query for the decision of a configuration's control loop about a single observation."""

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
"""Time of the observation, s; an arbitrary value."""
_SEQUENCE = 1_000_000
"""Frame counter of the observation; an arbitrary value."""


@dataclass(frozen=True, slots=True)
class Situation:
    """Observation with its history. A value of None means the value in an undisturbed run of this configuration."""

    phase: Phase = Phase.TRACK
    force_n: float | None = None
    """Force along the approach, N. Default: the target force in TRACK, otherwise 0."""
    peak_n: float | None = None
    """Force along the approach of the frame farthest from 0 since the last decision, N. Default: `force_n`."""
    resultant_n: float | None = None
    """Magnitude of the force, N. Default: the magnitude of the force along the approach."""
    moment_nm: float = 0.0
    """Largest magnitude of the moment since the last decision, N·m."""
    age_ms: float = 0.0
    """Age of the newest frame, ms."""
    unchanged_ms: float = 0.0
    """Time for which all frames have had identical counts, ms."""
    still_ms: float = 0.0
    """Duration of the cycles without a new frame, including the present cycle, ms."""
    counter_back: int = 0
    """Number by which the frame counter has decreased."""
    depth_mm: float | None = None
    """Reported depth below the start, mm. Default: the commanded depth."""
    commanded_mm: float | None = None
    """Depth of the last order below the start, mm. Default: the reported depth.

    If the reported depth is not given either, it is the depth at which the expected stiffness produces the target
    force; in APPROACH, it is the start.
    """
    wanted_mm: float | None = None
    """Depth that the task requests next, mm. Default: one step of the task; in TRACK, the depth of the last order."""
    across_mm: float = 0.0
    """Distance across the approach that the task requests next, mm."""
    unanswered_mm: float = 0.0
    """Increase in depth since the force last changed, mm."""
    moved_mm: float = 0.0
    """Distance by which the reported position has moved since the last cycle, mm."""
    cycle_ms: float | None = None
    """Time since the last cycle, ms. Default: the shortest line time of a cycle; for orders, the controller's
    sample time.
    """
    against_n: float = 0.0
    """Contact force against the direction of travel, N."""
    witness_n: float | None = None
    """Force along the approach as measured by the robot, N; None if the robot does not report a force."""
    disagreed_ms: float = 60_000.0
    """Time for which the robot's force and the sensor have disagreed, ms. Default: longer than allowed."""
    pulled_ms: float = 60_000.0
    """Duration of a pulling force in free space, ms. Default: longer than allowed."""
    unchanged_mm: float = 0.0
    """Distance that the tool has moved through free space since the counts last changed, mm."""
    strayed_mm: float = 0.0
    """Distance between the reported depth and all recent orders, mm."""
    tilt_deg: float = 0.0
    """Angle between the reported orientation and the orientation at the start, °."""
    gap_ms: float = 0.0
    """Time for which the computer has stalled, ms."""
    saturated: bool = False
    fault: str = ""
    """Description of a device's fault."""
    dead_axis: str = ""
    """Description of an axis that does not respond."""
    controller_failure: str = ""
    """Description of the controller's fault."""
    swing_n: float = 0.0
    """Amplitude of an oscillation that persists at the smallest gain, N; 0 for no oscillation."""
    stiffness_n_m: float | None = None
    """Estimated contact stiffness, N/m; None if there is no estimate."""
    start_m: Vector | None = None
    """Position of the start, base frame, m. Default: the middle of the workspace."""
    lowest_n: float | None = None
    """Smallest resultant force so far in a retraction, N. Default: the present resultant force."""
    retracting_ms: float = 0.0
    """Duration of the retraction so far, ms; 0 for the first cycle."""
    from_contact: bool = True
    """Whether the retraction began in contact."""
    back_mm: float = 0.0
    """Distance that the tool has moved back since the force last decreased, mm."""


class LoopQuery:
    """Control loop of a configuration, which can be queried about situations."""

    def __init__(self, config: Config) -> None:
        one_stroke = config.model_copy(update={"task": replace(config.task, step=())})
        self._setup = Setup(one_stroke)
        self.config = config = self._setup.config.model_copy(update={"task": config.task})
        self._loop: ControlLoop = self._setup.loop

    def __call__(self, situation: Situation) -> Decision:
        """Return the decision of the loop. Raises ConfigError if the start or the last order is outside the
        workspace.
        """
        config, loop, observed = self.config, self._loop, situation
        start = observed.start_m or middle(config)
        commanded = self.commanded_mm(observed) * 1e-3
        loop.initial(start)
        depth = commanded if observed.depth_mm is None else observed.depth_mm * 1e-3
        position, before = self._at(start, depth), self._at(start, depth - observed.moved_mm * 1e-3)
        sample = self._sample(observed, position)
        force, resultant = sample.force, sample.resultant
        dt = loop.since(None if observed.cycle_ms is None else _NOW - observed.cycle_ms * 1e-3, _NOW)
        pressing = observed.phase is not Phase.APPROACH and force > config.task.loss_threshold_n
        supervisor = SupervisorState(
            commanded,
            loop.supervisor.initial(self._at(start, commanded)).position,
            _SEQUENCE if observed.still_ms or observed.counter_back else _SEQUENCE - 1,
            observed.still_ms * 1e-3 - dt if observed.still_ms else 0.0,
            (force, depth - observed.unanswered_mm * 1e-3) if pressing else None,
            None,
            (_NOW - self._cycle(observed), before),
            self._retreat(observed, resultant, depth) if observed.phase is Phase.RETRACT else None,
            disagreed=observed.disagreed_ms * 1e-3,
            free=FreeSpace(
                self._at(start, depth - observed.unchanged_mm * 1e-3), _NOW - observed.pulled_ms * 1e-3
            ),
        )
        leg = next(number for number, leg in enumerate(loop.program.row.legs) if leg.phase is observed.phase)
        stroke = StrokeState(observed.phase, in_contact=pressing)
        program = ProgramState(Course(leg, _NOW), StepState(stroke))
        measurement = Measurement(
            _NOW,
            force,
            depth,
            commanded,
            pressing,
            saturated=observed.saturated,
            dt=dt,
            against=observed.against_n,
        )
        contact = ContactSample(sample, measurement, (0.0, 0.0), (force, observed.against_n, 0.0), ())
        program, intent = self._intend(program, contact, observed)
        advice = Advice(Finding.PERSISTING, 1.0, True, observed.swing_n) if observed.swing_n else None
        proposal = Proposal(
            contact,
            intent,
            Reason(Cause.CONTROLLER, observed.controller_failure) if observed.controller_failure else None,
            advice,
            program,
            OscillationState(),
        )
        lately = depth + observed.strayed_mm * 1e-3
        trail = ((_NOW, lately, lately),) if observed.strayed_mm else ()
        _, decision = loop.judge(LoopState(start, program, supervisor, trail=trail), sample, proposal)
        return decision

    def _sample(self, situation: Situation, position: Vector) -> Sample:
        force = self.force(situation)
        resultant = abs(force) if situation.resultant_n is None else situation.resultant_n
        peak = force if situation.peak_n is None else situation.peak_n
        return Sample(
            _NOW,
            position,
            force,
            resultant=resultant,
            sensor_at=_NOW - situation.age_ms * 1e-3,
            sensor_sequence=_SEQUENCE - situation.counter_back,
            saturated=situation.saturated,
            dead_axis=situation.dead_axis,
            fault=Reason(Cause.ROBOT_STATE, situation.fault) if situation.fault else None,
            force_travel=situation.against_n,
            peak_force=peak,
            peak_resultant=max(resultant, abs(peak)),
            peak_moment=situation.moment_nm,
            tilt=math.radians(situation.tilt_deg),
            gap=situation.gap_ms * 1e-3,
            unchanged=situation.unchanged_ms * 1e-3,
            witness=situation.witness_n,
        )

    def force(self, situation: Situation) -> float:
        """Return the force along the approach, N."""
        if situation.force_n is not None:
            return situation.force_n
        return self.config.task.force_n if situation.phase is Phase.TRACK else 0.0

    def commanded_mm(self, situation: Situation) -> float:
        """Return the depth of the last order, mm."""
        if situation.commanded_mm is not None:
            return situation.commanded_mm
        if situation.depth_mm is not None:
            return situation.depth_mm
        task = self.config.task
        return 0.0 if situation.phase is Phase.APPROACH else task.force_n / task.expected_stiffness_n_m * 1e3

    def _at(self, start: Vector, depth: float) -> Vector:
        (x, y, z), (a, b, c) = start, self._loop.program.frame.approach
        return x + a * depth, y + b * depth, z + c * depth

    def _cycle(self, situation: Situation) -> float:
        if situation.cycle_ms is not None:
            return situation.cycle_ms * 1e-3
        robot = self._setup.facts
        return max(robot.cycle_s or robot.line_floor_s or 0.0, self.config.run.period_ms * 1e-3)

    @staticmethod
    def _retreat(situation: Situation, resultant: float, depth: float) -> Retreat | None:
        if not situation.retracting_ms:
            return None
        lowest = resultant if situation.lowest_n is None else situation.lowest_n
        began = _NOW - situation.retracting_ms * 1e-3
        return Retreat(began, situation.from_contact, lowest, depth + situation.back_mm * 1e-3)

    def _intend(
        self, program: ProgramState, contact: ContactSample, situation: Situation
    ) -> tuple[ProgramState, Intent]:
        """Return the intent of program and controller. It is computed from the stroke if it does not depend on the
        controller's memory.
        """
        measurement = contact.measurement
        if situation.phase is Phase.RETRACT and situation.wanted_mm is None:
            return self._loop.program.step(program, contact)
        speed_mm_s = self.config.task.approach_speed_mm_s if situation.phase is Phase.APPROACH else 0.0
        step = self._loop.program.stroke.way(speed_mm_s, measurement.dt)
        depth = measurement.commanded + step if situation.wanted_mm is None else situation.wanted_mm * 1e-3
        command = None
        if situation.phase is Phase.TRACK:
            command = Command(depth, depth - measurement.commanded, situation.stiffness_n_m)
        target = Target(depth, situation.across_mm * 1e-3)
        return program, Intent(
            situation.phase, target, measurement.in_contact, command, leg=program.course.leg
        )


def middle(config: Config) -> Vector:
    """Return the middle of the workspace, base frame, m."""
    low, high = config.limits.workspace_min_m, config.limits.workspace_max_m
    x, y, z = ((a + b) / 2 for a, b in zip(low, high, strict=True))
    return x, y, z
