"""Programs in the complete loop in virtual time, with the ground truth sampled independently."""

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from emulators.cell import Cell, TrueState
from hil_bridge.clock import Clock, Timer, run_virtual
from hil_bridge.errors import BridgeError
from hil_bridge.record import CycleRecord, EventRecord, Outcome, Recording, StepRecord
from hil_bridge.runs.cycle import Run
from hil_bridge.runs.replay import replay
from hil_bridge.runs.result import RunResult
from hil_bridge.runs.run_log import RunLog
from hil_bridge.runs.running import running
from hil_bridge.runs.setup import Setup
from hil_bridge.runs.watchers import Listener
from hil_bridge.settings.configuration import Config, read_config
from tests.near_surface import merged

Floats = NDArray[np.float64]
WATCH_S = 0.25
"""Interval between samples of the ground truth, s."""
FORCES = 50
"""True forces in that time."""
STATES = 5
"""Complete states in that time."""


@dataclass
class Trial:
    """A run with its ground truth and its log."""

    config: Config
    meddle: Callable[["Trial", CycleRecord], None] = lambda played, record: None
    cycles: list[CycleRecord] = field(default_factory=list)
    events: list[EventRecord] = field(default_factory=list)
    steps: list[StepRecord] = field(default_factory=list)
    states: list[tuple[float, TrueState]] = field(default_factory=list)
    """Times, s, with the ground truth at each."""
    result: RunResult = field(default_factory=lambda: RunResult(Outcome.STOPPED))
    error: BridgeError | None = None
    """Condition that refused the run before it moved."""
    clock: Clock = field(init=False)
    cell: Cell[Any, Any] = field(init=False)
    run: Run = field(init=False)
    _times: list[Floats] = field(default_factory=list)
    _forces: list[Floats] = field(default_factory=list)
    _sampled_until: float = 0.0

    def cycle(self, record: CycleRecord) -> None:
        self.cycles.append(record)
        self.meddle(self, record)

    # --- queries of tests

    def inject(self, target: str, fault: str, **parameters: object) -> None:
        """Inject a fault from now on."""
        self.cell.inject(target, fault, self.clock.now(), **parameters)

    @cached_property
    def times(self) -> Floats:
        """Times of the true forces (n,), s."""
        return np.concatenate(self._times)

    @cached_property
    def forces(self) -> Floats:
        """True contact forces (n, 3) in the base frame, N."""
        return np.concatenate(self._forces)

    @property
    def largest(self) -> float:
        """The largest true contact force, N."""
        return float(np.linalg.norm(self.forces, axis=1).max())

    @property
    def last(self) -> float:
        """The true contact force at the end, N."""
        return float(np.linalg.norm(self.forces[-1]))

    @property
    def cause(self) -> str:
        """Cause of a run that was refused, stopped or interrupted."""
        return str(self.error) if self.error is not None else self.result.text

    @property
    def stopped(self) -> bool:
        return self.result.outcome is Outcome.STOPPED

    def of(self, number: int) -> list[CycleRecord]:
        """Return the cycles of the step with this number in the recording."""
        return [record for record in self.cycles if record.step == number]

    def texts(self, kind: str) -> list[str]:
        return [event.text for event in self.events if event.kind == kind]

    def phases(self) -> list[str]:
        """Return the phases in order."""
        return self.texts("phase")

    def clamps(self) -> set[str]:
        """Return the reasons for which the guard shortened orders."""
        return {reason for record in self.cycles if record.verdict == "clamp" for reason in record.reasons}

    def rms(self, number: int, after_mm: float = 0.0) -> float:
        """Return the root mean square error of the controlled force over a step, from this distance on, N."""
        errors = [
            record.force - record.force_reference
            for record in self.of(number)
            if record.phase == "track" and self.distance(record) >= after_mm * 1e-3
        ]
        return math.sqrt(sum(error**2 for error in errors) / len(errors))

    def distance(self, record: CycleRecord) -> float:
        """Return the ordered distance along the surface from the start of the record's step, m."""
        return self._distances[record.cycle]

    @cached_property
    def _distances(self) -> dict[int, float]:
        distances, distance, before = {}, 0.0, None
        for record in self.cycles:
            position = record.travel_commanded, record.across_commanded
            distance = (
                distance + math.dist(position, before[1]) if before and before[0] == record.step else 0.0
            )
            before = record.step, position
            distances[record.cycle] = distance
        return distances

    def skews(self, number: int) -> list[tuple[float, float, float]]:
        """Return the time, s, distance in the step, m, and true angle between tool and surface, °."""
        records = self.of(number)
        starts = [record.started_at for record in records]
        result = []
        for at, state in self.states:
            index = int(np.searchsorted(starts, at, side="right")) - 1
            if index < 0 or at > records[-1].answered_at or state.normal is None:
                continue
            result.append((at, self.distance(records[index]), skew_deg(state)))
        return result

    def differs(self) -> list[tuple[int, dict[str, Any]]]:
        """Return the cycles that a replay decides differently."""
        recording = Recording(
            tuple(self.cycles), metadata={"config": json.dumps(self.config.model_dump(mode="json"))}
        )
        again = replay(recording, self.config, forced=False)
        return [(one.record.cycle, one.differences) for one in again if one.differences]

    # --- the run

    async def main(self) -> "Trial":
        self.clock = clock = Clock.running()
        timers: list[Timer] = []

        def watch() -> None:
            self._sample_truth(clock.now())
            timers[:] = [clock.call_at(clock.now() + WATCH_S, watch)]

        listener = Listener(
            {CycleRecord: self.cycle, EventRecord: self.events.append, StepRecord: self.steps.append}
        )
        try:
            async with running(Setup(self.config), RunLog(clock, [listener])) as run:
                assert run.cell is not None
                self.cell, self.run, self._sampled_until = run.cell, run.run, clock.now()
                watch()
                try:
                    self.result = await run()
                finally:
                    timers[0].cancel()
                    self._sample_truth(clock.now())
        except BridgeError as error:
            self.error = error
        return self

    def _sample_truth(self, now: float) -> None:
        """Sample the ground truth since the last call."""
        since, self._sampled_until = self._sampled_until, now
        self._times.append(np.linspace(since, now, FORCES))
        self._forces.append(self.cell.contact_forces(self._times[-1]))
        at = np.linspace(since, now, STATES + 1)[1:].tolist()
        self.states += zip(at, self.cell.true_states(at), strict=True)


def skew_deg(state: TrueState) -> float:
    """Angle between the tool's axis and the inward normal, °."""
    assert state.normal is not None
    w, x, y, z = state.quaternion
    axis = 2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)
    cosine = -sum(a * n for a, n in zip(axis, state.normal, strict=True))
    return math.degrees(math.acos(min(max(cosine, -1.0), 1.0)))


Play = Callable[..., Trial]


@pytest.fixture(scope="session")
def play() -> Play:
    """Run steps on a robot with further settings laid over each other; `meddle` is called after every cycle."""

    def run(
        robot: str,
        steps: Sequence[Mapping[str, Any]],
        *more: Mapping[str, Any],
        meddle: Callable[[Trial, CycleRecord], None] | None = None,
    ) -> Trial:
        values: dict[str, Any] = {"run": {"seed": 3}, "robot": {"emulated": robot}}
        for settings in more:
            values = merged(values, settings)
        if steps:
            values = merged(values, {"task": {"step": list(steps)}})
        trial = Trial(Setup(read_config(values)).config)
        if meddle is not None:
            trial.meddle = meddle
        return run_virtual(trial.main)

    return run
