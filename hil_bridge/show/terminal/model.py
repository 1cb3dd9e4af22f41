"""Data of the live view: the control path stores, the view takes a snapshot when it likes."""

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
"""Shortest time between two drawings of the view."""
HISTORY_CYCLES = 240
"""Cycles that the chart can show on the widest terminal."""
LATENCY_CYCLES = 60
"""Newest cycles whose latency is told."""
EVENTS_KEPT = 60


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
class Scene:
    """Facts about a run that stay the same."""

    reference_n: float
    """Force that is wanted at first, N."""
    robot: RobotFacts
    """Which counters of the robot link tell of what."""
    total_s: float | None = None
    """How long the surface is to be tracked, s, where that is known."""
    steps: tuple[str, ...] = ()
    """Labels of a program's steps, passes counted; empty without a program."""
    tracks: frozenset[int] = frozenset()
    """Numbers of its steps that track, passes counted, from 1."""
    cell: str = ""
    """EMULATED or REAL, with the devices where the one is this and the other that; empty where it is not known."""
    devices: str = ""
    """Kinds of robot and sensor, where `cell` does not name them."""
    real: bool = False
    """A real robot may move."""
    limits: Limits = field(default_factory=Limits)
    record: str = ""
    """Where the run is recorded; empty where it is not."""
    approach: Vector | None = None
    """Unit vector of the approach in the robot base frame, where it is known."""
    keys: bool = False
    """Keys of the terminal are heard."""

    @property
    def chart_facts(self) -> ChartFacts:
        """Facts that its charts need."""
        limits = limit_numbers(asdict(self.limits))
        return ChartFacts(self.robot, limits, self.tracks, self.approach, self.robot.line_floor_s)


class Told(NamedTuple):
    """An event, for people."""

    elapsed_s: float
    kind: str
    text: str
    """The line that tells most."""

    @property
    def alarm(self) -> bool:
        """It tells why the run stops."""
        return self.kind in ALARMS

    @property
    def caution(self) -> bool:
        """It tells of a disturbance, or of an operator."""
        return self.kind in CAUTIONS


@dataclass(frozen=True, slots=True)
class Snapshot:
    """One picture of a run."""

    scene: Scene

    phase: str
    elapsed_s: float
    tracked_s: float
    """Time for which the surface has been tracked."""
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
    """Last finding about the sensor before the touch, in words."""
    warning: str = ""
    """Warning that an operator should read at once, beside the run's own reactions."""
    period_s: float | None = None
    """Between the begins of the last two cycles."""
    depths_mm: tuple[float, ...] = ()
    """Reported depths of the last cycles, oldest first."""
    cycle_times_ms: tuple[float, ...] = ()
    """Times of the last cycles, oldest first."""
    references_n: tuple[float, ...] = ()
    """Forces that were wanted in the last cycles, oldest first."""
    step: int = 0
    """Number of the step under way, from 1; 0 before the first and without a program."""
    events: tuple[Told, ...] = ()
    """Events beside the cycles, oldest first."""

    @property
    def cause(self) -> str:
        """Why the run stops; empty where it does not."""
        return next((told.text for told in self.events if told.kind == EventKind.STOP), "")

    @property
    def held(self) -> bool:
        """An operator holds the tool in its place on the surface."""
        return self.newest is not None and self.newest.sample.held

    @property
    def lateral_n(self) -> float | None:
        """Length of the contact force across the approach, N."""
        if self.newest is None or not math.isfinite(self.newest.force):
            return None
        return math.sqrt(max(0.0, self.resultant_n**2 - self.newest.force**2))

    @property
    def resultant_n(self) -> float:
        """Length of the contact force, N; not a number before the first cycle."""
        return math.nan if self.newest is None else math.hypot(*self.newest.sample.wrench[:3])

    @property
    def moment_nm(self) -> float:
        """Length of the contact moment about the tool frame's origin, N·m; not a number before the first cycle."""
        return math.nan if self.newest is None else math.hypot(*self.newest.sample.wrench[3:])

    @property
    def wants_force(self) -> bool:
        """Whether the force is to be controlled now; of a program, not while the tool is in free space."""
        return not self.step or self.phase == "track"

    @property
    def step_label(self) -> str:
        """Label of the step under way; empty if there is none."""
        steps = self.scene.steps
        return steps[self.step - 1] if 0 < self.step <= len(steps) else ""

    @property
    def remaining_s(self) -> float | None:
        total_s = self.scene.total_s
        return None if total_s is None else max(0.0, total_s - self.tracked_s)

    @property
    def link_troubles(self) -> dict[str, int]:
        """Counters of the robot link that are not 0 and would be in an undisturbed run, the largest first."""
        robot = self.scene.robot
        counts = {
            robot.counter_label(name): count
            for name, count in self.link.items()
            if count and name not in robot.routine
        }
        return dict(sorted(counts.items(), key=lambda item: -item[1]))

    @property
    def cycle_time_s(self) -> float | None:
        """Time of the newest cycle from begin to answer; to the next begin for a robot that drives the cycle."""
        if self.scene.robot.cycle_s is not None:
            return self.period_s
        if self.newest is None or not math.isfinite(self.newest.answered_at):
            return None
        return self.newest.answered_at - self.newest.started_at


class ViewModel:
    """The newest of everything. `update` and `enter` only store, so that the control path may call them."""

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
        """More is known of the run."""
        self._scene = scene

    def update(self, record: CycleRecord) -> None:
        """A cycle has ended."""
        self._newest = record
        self._phase = record.phase
        if record.phase == "track":
            self._track_since = self._track_since or record.started_at
            self._track_until = record.answered_at
        self._cycles.append(record)

    def event(self, record: EventRecord) -> None:
        """Something happened beside the cycles; a phase begins, perhaps one without cycles."""
        if record.kind == EventKind.PHASE:
            self._phase = record.text
        elif record.kind == EventKind.STOP and self._stop is None:
            self._stop = record
        else:
            self._events.append(record)

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
        newest, cycles, robot = self._newest, tuple(self._cycles.copy()), self._scene.robot
        told = [*([] if self._stop is None else [self._stop]), *self._events.copy()]
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
                Told(record.at - self._began, record.kind, record.line)
                for record in sorted(told, key=lambda record: record.at)
            ),
        )
