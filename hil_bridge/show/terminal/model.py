"""Data of the live view: the control path stores, the view takes snapshots at its own rate."""

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
from hil_bridge.record.records import CycleRecord, EventRecord, Vector
from hil_bridge.show.charts.facts import ChartFacts, limit_numbers

REFRESH_SECONDS = 0.2
"""Shortest time between two redraws."""
HISTORY_CYCLES = 240
"""Cycles that the chart can show on the widest terminal."""
LATENCY_CYCLES = 60
"""Number of newest cycles in the latency display."""
EVENTS_KEPT = 60


@dataclass(frozen=True, slots=True)
class Health:
    """Facts about the links that the cycle record does not hold."""

    link_errors: int = 0
    """Errors of the robot link so far, as summed by its facts."""
    frames_lost: int = 0
    """Sensor frames missing in the stream so far."""
    sensor_at: float | None = None
    """Arrival of the newest sensor frame, s on the run's clock."""
    link: Mapping[str, int] = field(default_factory=dict)
    """Counters of the robot link by name."""


@dataclass(frozen=True, slots=True)
class Scene:
    """Constant facts about a run."""

    reference_n: float
    """Initial target force, N."""
    robot: RobotFacts
    """Meaning of the robot link's counters."""
    total_s: float | None = None
    """Planned tracking time, s, if known."""
    steps: tuple[str, ...] = ()
    """Labels of a program's steps, passes counted; empty without a program."""
    tracks: frozenset[int] = frozenset()
    """Numbers of its steps that track, passes counted, from 1."""
    cell: str = ""
    """EMULATED or REAL, with the devices if they differ; empty if unknown."""
    devices: str = ""
    """Kinds of robot and sensor, where `cell` does not name them."""
    real: bool = False
    """Whether a real robot may move."""
    limits: Limits = field(default_factory=Limits)
    record: str = ""
    """Path of the recording; empty if the run is not recorded."""
    approach: Vector | None = None
    """Unit vector of the approach in the robot base frame, if known."""
    keys: bool = False
    """Whether keys of the terminal are read."""

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
    """Most informative line."""

    @property
    def alarm(self) -> bool:
        """Return whether it states why the run stops."""
        return self.kind in ALARMS

    @property
    def caution(self) -> bool:
        """Return whether it reports a disturbance or an operator action."""
        return self.kind in CAUTIONS


@dataclass(frozen=True, slots=True)
class Snapshot:
    """State of a run at one moment."""

    scene: Scene

    phase: str
    elapsed_s: float
    tracked_s: float
    """Tracking time so far."""
    reference_n: float
    newest: CycleRecord | None
    forces_n: tuple[float, ...]
    """Forces of the last cycles, oldest first."""
    latency: Latency | None
    """Latency of the same cycles, from the arrival of the sensor frame to the move's answer."""
    sensor_age_s: float | None
    link_errors: int
    frames_lost: int
    link: Mapping[str, int]
    """Counters of the robot link by name."""
    check: str = ""
    """Last result of the sensor checks before contact, as text."""
    warning: str = ""
    """Warning that the operator should read at once, in addition to the run's own reactions."""
    period_s: float | None = None
    """Time between the starts of the last two cycles."""
    depths_mm: tuple[float, ...] = ()
    """Reported depths of the last cycles, oldest first."""
    cycle_times_ms: tuple[float, ...] = ()
    """Times of the last cycles, oldest first."""
    references_n: tuple[float, ...] = ()
    """Target forces of the last cycles, oldest first."""
    step: int = 0
    """Number of the current step, from 1; 0 before the first and without a program."""
    events: tuple[ViewEvent, ...] = ()
    """Events, oldest first."""

    @property
    def cause(self) -> str:
        """Return why the run stops; empty if it does not."""
        return next((event.text for event in self.events if event.kind == EventKind.STOP), "")

    @property
    def held(self) -> bool:
        """Return whether the operator holds the tool in place on the surface."""
        return self.newest is not None and self.newest.sample.held

    @property
    def lateral_n(self) -> float | None:
        """Return the magnitude of the contact force across the approach, N."""
        if self.newest is None or not math.isfinite(self.newest.force):
            return None
        return math.sqrt(max(0.0, self.resultant_n**2 - self.newest.force**2))

    @property
    def resultant_n(self) -> float:
        """Return the magnitude of the contact force, N; NaN before the first cycle."""
        return math.nan if self.newest is None else math.hypot(*self.newest.sample.wrench[:3])

    @property
    def moment_nm(self) -> float:
        """Return the magnitude of the contact moment about the tool frame's origin, N·m; NaN before the first cycle."""
        return math.nan if self.newest is None else math.hypot(*self.newest.sample.wrench[3:])

    @property
    def wants_force(self) -> bool:
        """Return whether the force is controlled now; in a program, not while the tool is in free space."""
        return not self.step or self.phase == "track"

    @property
    def step_label(self) -> str:
        """Return the label of the current step; empty if there is none."""
        steps = self.scene.steps
        return steps[self.step - 1] if 0 < self.step <= len(steps) else ""

    @property
    def remaining_s(self) -> float | None:
        total_s = self.scene.total_s
        return None if total_s is None else max(0.0, total_s - self.tracked_s)

    @property
    def link_troubles(self) -> dict[str, int]:
        """Return the nonzero error counters of the robot link, the largest first."""
        robot = self.scene.robot
        counts = {
            robot.counter_label(name): count
            for name, count in self.link.items()
            if count and name not in robot.routine
        }
        return dict(sorted(counts.items(), key=lambda item: -item[1]))

    @property
    def cycle_time_s(self) -> float | None:
        """Return the time of the newest cycle: from start to answer, or to the next start of a robot-driven cycle."""
        if self.scene.robot.cycle_s is not None:
            return self.period_s
        if self.newest is None or not math.isfinite(self.newest.answered_at):
            return None
        return self.newest.answered_at - self.newest.started_at


class ViewModel:
    """Newest data of a run. `update` and `enter` only store, so that the control path may call them."""

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
        """Add an event, which may begin a phase, also one without cycles."""
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
        """Add a warning that stays until the end, before earlier ones."""
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
