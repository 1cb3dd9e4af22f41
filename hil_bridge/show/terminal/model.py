"""Data of the live view. The control path stores data, and the view takes snapshots at a rate of its own."""

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import NamedTuple

from hil_bridge.control.course.limits import Limits
from hil_bridge.devices.facts import RobotFacts
from hil_bridge.errors.event_kinds import ALARMS, CAUTIONS, EventKind
from hil_bridge.record.analysis.latency import Latency, latency_budget
from hil_bridge.record.analysis.summary import cycle_times
from hil_bridge.record.next_commands import RunPlaces
from hil_bridge.record.records import CycleRecord, EventRecord, Vector
from hil_bridge.show.charts.facts import ChartFacts, limit_numbers

REFRESH_SECONDS = 0.2
"""Shortest time between two redraws, s."""
HISTORY_CYCLES = 240
"""Number of cycles that the chart can show on the widest terminal."""
LATENCY_CYCLES = 60
"""Number of newest cycles that the latency display covers."""
EVENTS_KEPT = 60


@dataclass(frozen=True, slots=True)
class Health:
    """Health of the links, which the cycle record does not contain."""

    link_errors: int = 0
    """Number of errors of the robot link so far, summed over the counters that its facts name."""
    frames_lost: int = 0
    """Number of sensor frames missing in the stream so far."""
    sensor_at: float | None = None
    """Arrival time of the newest sensor frame, s on the run's clock."""
    link: Mapping[str, int] = field(default_factory=dict)
    """Counters of the robot link by name."""
    force: float | None = None
    """Contact force along the approach in the newest sensor frame, N; None before the zero."""


@dataclass(frozen=True, slots=True)
class Scene:
    """Constant facts about a run."""

    reference_n: float
    """Initial target force, N."""
    robot: RobotFacts
    """Facts of the robot that define the meaning of the link's counters."""
    total_s: float | None = None
    """Planned tracking time, s; None if unknown."""
    steps: tuple[str, ...] = ()
    """Labels of all steps of a program, counting every pass; empty without a program."""
    tracks: frozenset[int] = frozenset()
    """Numbers of the program's steps that track, counting every pass, from 1."""
    cell: str = ""
    """Label of the cell: EMULATED or REAL, with the devices if robot and sensor differ; empty if unknown."""
    devices: str = ""
    """Kinds of robot and sensor, if `cell` does not name them."""
    real: bool = False
    """Whether a real robot may move."""
    limits: Limits = field(default_factory=Limits)
    places: RunPlaces = field(default_factory=RunPlaces)
    """Where the run leaves its recording, and how its tool is reached afterwards."""
    approach: Vector | None = None
    """Unit vector of the approach in the robot base frame; None if unknown."""
    keys: bool = False
    """Whether the run reads keys of the terminal."""

    @property
    def chart_facts(self) -> ChartFacts:
        """Return the facts that the charts need."""
        limits = limit_numbers(asdict(self.limits))
        return ChartFacts(self.robot, limits, self.tracks, self.approach, self.robot.line_floor_s)


class ViewEvent(NamedTuple):
    """Event for display."""

    elapsed_s: float
    kind: str
    text: str
    """Most informative line of the event."""

    @property
    def alarm(self) -> bool:
        """Whether the event states why the run stops."""
        return self.kind in ALARMS

    @property
    def caution(self) -> bool:
        """Whether the event reports a disturbance or an operator action."""
        return self.kind in CAUTIONS


@dataclass(frozen=True, slots=True)
class Snapshot:
    """State of a run at a given time."""

    scene: Scene

    phase: str
    elapsed_s: float
    tracked_s: float
    """Tracking time so far, s."""
    reference_n: float
    newest: CycleRecord | None
    forces_n: tuple[float, ...]
    """Forces of the last cycles, N, oldest first."""
    latency: Latency | None
    """Latency of the cycles in `forces_n`, from the arrival of the sensor frame to the robot's response to the move."""
    sensor_age_s: float | None
    link_errors: int
    frames_lost: int
    link: Mapping[str, int]
    """Counters of the robot link by name."""
    check: str = ""
    """Text of the last result of the sensor checks before contact."""
    warning: str = ""
    """Warning that needs the operator's immediate attention, in addition to the reactions of the run itself."""
    period_s: float | None = None
    """Time between the starts of the last two cycles, s."""
    depths_mm: tuple[float, ...] = ()
    """Reported depths of the last cycles, mm, oldest first."""
    cycle_times_ms: tuple[float, ...] = ()
    """Durations of the last cycles, ms, oldest first."""
    references_n: tuple[float, ...] = ()
    """Target forces of the last cycles, N, oldest first."""
    step: int = 0
    """Number of the current step, from 1; 0 before the first step and without a program."""
    events: tuple[ViewEvent, ...] = ()
    """Events, oldest first."""

    @property
    def cause(self) -> str:
        """Reason why the run stops; empty if it does not stop."""
        return next((event.text for event in self.events if event.kind == EventKind.STOP), "")

    @property
    def held(self) -> bool:
        """Whether the operator holds the tool at its position on the surface."""
        return self.newest is not None and self.newest.sample.held

    @property
    def lateral_n(self) -> float | None:
        """Magnitude of the contact force perpendicular to the approach, N."""
        if self.newest is None or not math.isfinite(self.newest.force):
            return None
        return math.sqrt(max(0.0, self.resultant_n**2 - self.newest.force**2))

    @property
    def resultant_n(self) -> float:
        """Magnitude of the contact force, N; NaN before the first cycle."""
        return math.nan if self.newest is None else math.hypot(*self.newest.sample.wrench[:3])

    @property
    def moment_nm(self) -> float:
        """Magnitude of the contact moment about the tool frame's origin, N·m; NaN before the first cycle."""
        return math.nan if self.newest is None else math.hypot(*self.newest.sample.wrench[3:])

    @property
    def is_force_controlled(self) -> bool:
        """Whether the force is controlled now. In a program, this excludes the time in free space."""
        return not self.step or self.phase == "track"

    @property
    def step_label(self) -> str:
        """Label of the current step; empty without a current step."""
        steps = self.scene.steps
        return steps[self.step - 1] if 0 < self.step <= len(steps) else ""

    @property
    def remaining_s(self) -> float | None:
        total_s = self.scene.total_s
        return None if total_s is None else max(0.0, total_s - self.tracked_s)

    @property
    def link_troubles(self) -> dict[str, int]:
        """Nonzero error counters of the robot link, the largest first."""
        robot = self.scene.robot
        counts = {
            robot.counter_label(name): count
            for name, count in self.link.items()
            if count and name not in robot.routine
        }
        return dict(sorted(counts.items(), key=lambda item: -item[1]))

    @property
    def cycle_time_s(self) -> float | None:
        """Duration of the newest cycle, s.

        It lasts from its start to the response, or to the start of the next cycle if the robot drives the cycle.
        """
        if self.scene.robot.cycle_s is not None:
            return self.period_s
        if self.newest is None or not math.isfinite(self.newest.answered_at):
            return None
        return self.newest.answered_at - self.newest.started_at


class ViewModel:
    """Newest data of a run. `update` and `event` only store their arguments, so that the control path may call them."""

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self._began: float | None = None
        self._track_since: float | None = None
        self._track_until: float | None = None
        self._phase = "connect"
        self._warning = ""
        self._check = ""
        self._newest: CycleRecord | None = None
        self._cycles: deque[CycleRecord] = deque(maxlen=HISTORY_CYCLES)
        self._events: deque[EventRecord] = deque(maxlen=EVENTS_KEPT)
        self._stop: EventRecord | None = None

    def renew(self, scene: Scene) -> None:
        """Replace the facts of the run."""
        self._scene = scene

    def update(self, record: CycleRecord) -> None:
        """Add a completed cycle."""
        self._newest = record
        self._phase = record.phase
        if record.phase == "track":
            self._track_since = self._track_since or record.started_at
            self._track_until = record.answered_at
        self._cycles.append(record)

    def event(self, record: EventRecord) -> None:
        """Add an event. It may begin a phase, including a phase without cycles."""
        if record.kind == EventKind.PHASE:
            self._phase = record.text
        elif record.kind == EventKind.STOP and self._stop is None:
            self._stop = record
        else:
            self._events.append(record)

    def check(self, text: str) -> None:
        """Store the newest result of the sensor checks."""
        self._check = text

    def warn(self, text: str) -> None:
        """Add a warning before all earlier warnings. It stays until the end."""
        self._warning = f"{text}; {self._warning}" if self._warning else text

    def snapshot(self, now: float, health: Health) -> Snapshot:
        """Return the state at `now`, s on the run's clock. The first call starts the elapsed time."""
        if self._began is None:
            self._began = now
        newest, cycles, robot = self._newest, tuple(self._cycles.copy()), self._scene.robot
        records = [*([] if self._stop is None else [self._stop]), *self._events.copy()]
        young = cycles[-LATENCY_CYCLES:]
        return Snapshot(
            scene=self._scene,
            phase=self._phase,
            elapsed_s=now - self._began,
            tracked_s=(self._track_until or 0.0) - (self._track_since or 0.0),
            reference_n=newest.force_reference if newest else self._scene.reference_n,
            newest=newest,
            forces_n=tuple(cycle.force for cycle in cycles),
            latency=latency_budget(young, robot.hops) if young and robot.hops else None,
            sensor_age_s=None if health.sensor_at is None else max(0.0, now - health.sensor_at),
            link_errors=health.link_errors,
            frames_lost=health.frames_lost,
            link=health.link,
            warning=self._warning,
            check=self._check,
            depths_mm=tuple(cycle.depth * 1e3 for cycle in cycles),
            cycle_times_ms=tuple(1e3 * seconds for seconds in cycle_times(cycles, robot.cycle_s is not None)),
            references_n=tuple(cycle.force_reference for cycle in cycles),
            step=newest.step if newest else 0,
            period_s=cycles[-1].started_at - cycles[-2].started_at if len(cycles) > 1 else None,
            events=tuple(
                ViewEvent(record.at - self._began, record.kind, record.line)
                for record in sorted(records, key=lambda record: record.at)
            ),
        )
