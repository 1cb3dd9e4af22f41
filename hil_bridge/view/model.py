"""Data of the live view: the control path stores, the view takes a snapshot when it likes."""

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field

from hil_bridge.analysis.latency import Latency, latency_budget
from hil_bridge.facts import RobotFacts
from hil_bridge.recording.records import CycleRecord

REFRESH_SECONDS = 0.2
"""Shortest time between two drawings of the view."""
HISTORY_CYCLES = 60


@dataclass(frozen=True, slots=True)
class Health:
    """Facts about the wires that the cycle record does not hold."""

    link_errors: int = 0
    """Troubles of the robot link so far, as its facts add them up."""
    frames_lost: int = 0
    """Sensor frames missing in the stream so far."""
    sensor_at: float | None = None
    """Arrival of the newest sensor frame, s on the run's clock."""
    link: Mapping[str, int] = field(default_factory=dict)
    """Counters of the robot link by name."""


@dataclass(frozen=True, slots=True)
class Snapshot:
    """One picture of a run."""

    phase: str
    elapsed_s: float
    tracked_s: float
    """Time for which the surface has been tracked."""
    total_s: float | None
    """How long it is to be tracked, where that is known."""
    reference_n: float
    line_floor_s: float | None
    """Time of one cycle's characters on the line."""
    newest: CycleRecord | None
    forces_n: tuple[float, ...]
    """Forces of the last cycles, oldest first."""
    latency: Latency | None
    """Latency of the same cycles, from the arrival of the sensor frame to the move's answer."""
    sensor_age_s: float | None
    link_errors: int
    frames_lost: int
    robot: RobotFacts
    """Which counters of the robot link tell of what."""
    link: Mapping[str, int]
    """Counters of the robot link by name."""
    check: str = ""
    """Last finding about the sensor before the touch, in words."""
    warning: str = ""
    """Warning that a person should read at once, beside the run's own reactions."""
    period_s: float | None = None
    """Between the begins of the last two cycles."""
    references_n: tuple[float, ...] = ()
    """Forces that were wanted in the last cycles, oldest first."""
    steps: tuple[str, ...] = ()
    """Labels of a program's steps, passes counted; empty without a program."""
    step: int = 0
    """Number of the step under way, from 1; 0 before the first and without a program."""

    @property
    def wants_force(self) -> bool:
        """Whether the force is to be controlled now; of a program, not while the tool is in free space."""
        return not self.step or self.phase == "track"

    @property
    def step_label(self) -> str:
        """Label of the step under way; empty where there is none."""
        return self.steps[self.step - 1] if 0 < self.step <= len(self.steps) else ""

    @property
    def remaining_s(self) -> float | None:
        return None if self.total_s is None else max(0.0, self.total_s - self.tracked_s)

    @property
    def link_troubles(self) -> dict[str, int]:
        """Counters of the robot link that are not 0 and would be in an undisturbed run, the largest first."""
        routine = self.robot.routine
        counts = {name: count for name, count in self.link.items() if count and name not in routine}
        return dict(sorted(counts.items(), key=lambda item: -item[1]))

    @property
    def cycle_time_s(self) -> float | None:
        """Time of the newest cycle from begin to answer; to the next begin for a robot that drives the cycle."""
        if self.robot.cycle_s is not None:
            return self.period_s
        if self.newest is None or not math.isfinite(self.newest.answered_at):
            return None
        return self.newest.answered_at - self.newest.started_at


class ViewModel:
    """The newest of everything. `update` and `enter` only store, so that the control path may call them."""

    def __init__(
        self, total_s: float | None, reference_n: float, robot: RobotFacts, steps: tuple[str, ...] = ()
    ) -> None:
        """`steps` are the labels of a program's steps."""
        self._total_s = total_s
        self._steps = steps
        self._reference_n = reference_n
        self._robot = robot
        self._began: float | None = None
        self._track_since: float | None = None
        self._track_until: float | None = None
        self._phase = "connect"
        self._warning = ""
        self._check = ""
        self._newest: CycleRecord | None = None
        self._cycles: deque[CycleRecord] = deque(maxlen=HISTORY_CYCLES)

    def update(self, record: CycleRecord) -> None:
        """A cycle has ended."""
        self._newest = record
        self._phase = record.phase
        if record.phase == "track":
            self._track_since = self._track_since or record.started_at
            self._track_until = record.answered_at
        self._cycles.append(record)

    def enter(self, phase: str) -> None:
        """A phase begins; some phases have no cycles."""
        self._phase = phase

    def check(self, text: str) -> None:
        """Show what was found of the sensor, the newest at a time."""
        self._check = text

    def warn(self, text: str) -> None:
        """Show a text until the end, before those that were shown earlier."""
        self._warning = f"{text}; {self._warning}" if self._warning else text

    def snapshot(self, now: float, health: Health) -> Snapshot:
        """The state at `now` (s on the run's clock). The first call begins the elapsed time."""
        if self._began is None:
            self._began = now
        newest, cycles = self._newest, tuple(self._cycles.copy())
        return Snapshot(
            phase=self._phase,
            elapsed_s=now - self._began,
            tracked_s=(self._track_until or 0.0) - (self._track_since or 0.0),
            total_s=self._total_s,
            reference_n=newest.force_reference if newest else self._reference_n,
            line_floor_s=self._robot.line_floor_s,
            newest=newest,
            forces_n=tuple(cycle.force for cycle in cycles),
            latency=latency_budget(cycles, self._robot.hops) if cycles and self._robot.hops else None,
            sensor_age_s=None if health.sensor_at is None else max(0.0, now - health.sensor_at),
            link_errors=health.link_errors,
            frames_lost=health.frames_lost,
            robot=self._robot,
            link=health.link,
            warning=self._warning,
            check=self._check,
            references_n=tuple(cycle.force_reference for cycle in cycles),
            steps=self._steps,
            step=newest.step if newest else 0,
            period_s=cycles[-1].started_at - cycles[-2].started_at if len(cycles) > 1 else None,
        )
