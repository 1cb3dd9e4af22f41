"""Tables of docs/explanation/safety.md: the conditions from the code, and the times from measured runs.

The runs use virtual time. `--measure egm` makes only the runs of this robot.
"""

import asyncio
import gc
import math
import random
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil_bridge.api import Config, Simulation, load, run_virtual, simulation
from hil_bridge.errors.cause_row import INTERRUPTED, When
from hil_bridge.errors.cause_table import TABLE
from hil_bridge.lab.campaign.watching import Watch
from hil_bridge.record import EventKind, Outcome
from hil_bridge.record.analysis.strokes import TRACK
from hil_bridge.record.analysis.summary import RETRACT
from hil_bridge.runs.ending import TRANSITIONS, RunState, Stimulus, Transition
from hil_bridge.settings.overrides import lay_over
from hil_bridge.site.guard.conditions import cells
from protocol.devices.s3.arap import FunctionCode
from tools.pages import run_jobs, table

SEEDS: Mapping[str, int] = {"s3": 20, "egm": 5, "rtde": 5, "rsi": 5}
"""Number of runs of a case, by robot. It is smaller for a streaming robot, whose runs each take some seconds of
processor time.
"""
STIFFNESSES_N_M = (5e3, 5e4)
TICK_S = 0.001
"""Time resolution of the true force, s."""
TRACK_S = 9.0
"""Tracking time of a run in which nothing happens, s."""
AFTER_S = (0.8, 2.0)
"""Range of the time from the start of TRACK to the fault, s. The seed draws the time."""
FOR_GOOD_S = 3600.0

Fault = Mapping[str, Any]
NEAR: Mapping[str, Any] = {"cell.start_position_mm": (900.0, -100.0, 592.0), "task.retract_mm": 3.0}
"""Settings of a streaming robot: a start near the surface and a short retraction. They save time, because each of
its packets is emulated.
"""
WHITE: Mapping[str, Any] = {
    "cell.ft300.noise_n": 0.1,
    "cell.ft300.noise_nm": 0.003,
    "cell.ft300.wander_n": 0.0,
    "cell.ft300.creep_share": 0.0,
}
"""Settings of the FT 300 with only white noise, as at the time when the figures were measured."""
ROBOTS: Mapping[str, Mapping[str, Any]] = {
    "s3": {},
    "egm": {"robot.emulated": "egm", "sensor.emulated": "ft300", **NEAR, **WHITE},
    "rtde": {"robot.emulated": "rtde", "sensor.emulated": "ft300", **NEAR, **WHITE},
    "rsi": {"robot.emulated": "rsi", "sensor.emulated": "ft300", **NEAR, **WHITE},
}
"""Settings of each robot's runs that differ from the defaults."""
STREAMED = ("egm", "rtde", "rsi")


@dataclass(frozen=True)
class Case:
    """Event in a run that holds 10 N."""

    name: str
    faults: Mapping[str, Fault] = field(default_factory=dict)
    """Fault by robot; empty if the event is an operator who presses Ctrl-C."""
    by_force: bool = False
    """Whether the time counts from the start of the peak above the force limit that stops the run, instead of from the
    start of the fault.
    """

    per_stiffness: Mapping[str, float] = field(default_factory=dict)
    """Parameters that are divided by the stiffness in kN/m, so that the force is the same."""

    @property
    def robots(self) -> Sequence[str]:
        """Robots to which the case applies."""
        return tuple(self.faults) or tuple(ROBOTS)


def _fault(on: str, fault: str, for_s: float | None = None, **parameters: object) -> Fault:
    return {"on": on, "fault": fault, "with": parameters, **({} if for_s is None else {"for_s": for_s})}


def _all(on: str, fault: str, for_s: float | None = None, **parameters: object) -> Mapping[str, Fault]:
    return dict.fromkeys(ROBOTS, _fault(on, fault, for_s, **parameters))


CASES = (
    Case("Ctrl-C"),
    Case("the surface rises by what makes 80 N, in 100 ms", _all("surface", "step"), True, {"mm": 80.0}),
    Case("an inclusion ten times as hard, over 100 ms", _all("surface", "hard"), True),
    Case("the sensor reads 60 N more", _all("signal", "offset", amount=-60.0)),
    Case("the sensor falls silent", _all("sensor-wire", "off", FOR_GOOD_S)),
    Case("the sensor's frames come 500 ms late", _all("sensor-wire", "late", ms=500.0)),
    Case("the sensor repeats one sample", _all("signal", "stuck")),
    Case("the reported position jumps by 20 mm", _all("pose", "offset", z_mm=20.0)),
    Case("the reported orientation turns by 30°", dict.fromkeys(("s3", "rsi"), _fault("pose", "turned"))),
    Case("the computer stands still for 0.8 s", _all("computer", "pause", seconds=0.8)),
    Case(
        "the robot refuses one point", {"s3": _fault("robot", "refuses", code=31, function=FunctionCode.MOVE)}
    ),
    Case("the robot's emergency stop is pressed", _all("robot", "emergency-stop")),
    Case(
        "the robot's link is dead for 8 s",
        {
            **dict.fromkeys(("s3", "egm"), _fault("wire", "off", 8.0)),
            **dict.fromkeys(("rtde", "rsi"), _fault("wire", "mute", 8.0)),
        },
    ),
)
UNCOVERED = (
    Case("the sensor's Fz gives noise only", _all("signal", "dead")),
    Case("the sensor reports a tenth of Fz", _all("signal", "scale", factor=0.1)),
    Case("the sensor's Fz drifts by 2 N/s the wrong way", _all("signal", "drift", per_s=2.0)),
)
"""Faults that pass all checks and stay within the limits."""
ALL_CASES = (*CASES, *UNCOVERED)
CONDITION_HEAD = ("name", "condition", "settings", "part at fault")


class Job(NamedTuple):
    """Run of a case."""

    case: Case
    robot: str
    stiffness: float
    """Stiffness, N/m."""
    seed: int

    @property
    def after_s(self) -> float:
        """Time of the event after the start of TRACK, s."""
        return random.Random(self.seed).uniform(*AFTER_S)

    @property
    def config(self) -> Config:
        """Return the configuration of the run, with its fault."""
        values: dict[str, Any] = {}
        own = {"run.duration_s": TRACK_S, "cell.surface.stiffness_n_m": self.stiffness}
        lay_over(values, {**ROBOTS[self.robot], **own})
        case, faults = self.case, []
        if fault := case.faults.get(self.robot):
            forced = {key: value / (self.stiffness * 1e-3) for key, value in case.per_stiffness.items()}
            given = {**fault["with"], **forced}
            faults.append({**fault, "phase": TRACK, "after_s": self.after_s, "with": given})
        return load(values, faults=faults, seed=self.seed)


@dataclass(frozen=True)
class Times:
    """Result of one run, s and N; None where something did not happen."""

    order_s: float | None
    """Time from the start to the first order of the retraction.

    It is also None if the time counts from a force above the limit and such a force did not stop the run.
    """
    below_s: float | None
    """Time from the start until the true force is below the limit for good; None if it was never above."""
    largest_n: float
    """Largest true force after the start, N."""
    end_n: float
    """True force at the end, N."""
    stopped: bool
    """Whether the event stopped the run before its time was over."""
    cause: str
    left: str


def measured(job: Job) -> Times:
    """Make one run."""
    gc.collect()  # the previous cell and its run reference each other

    async def main() -> tuple[Simulation, Watch, float]:
        began = math.nan
        async with simulation(job.config) as running:
            watch = Watch(running, TICK_S)
            watching = asyncio.create_task(watch.watch())
            try:
                running.start()
                if not job.case.faults:
                    await running.reached(TRACK)
                    began = running.clock.now() + job.after_s
                    await running.clock.sleep_until(began)
                    running.interrupt()
                await running.finished()
            finally:
                watching.cancel()
                watch.sample()
        return running, watch, began

    running, watch, began = run_virtual(main)
    assert running.cell is not None
    if job.case.faults:
        began = running.cell.faults[0].injected_at
    return _times(running, watch, began, job.case.by_force)


def _times(running: Simulation, watch: Watch, began: float, by_force: bool) -> Times:
    result, (times, forces) = running.result, watch.truth()
    times, forces = times[times >= began], forces[times >= began]
    above = times[forces > running.config.limits.force_limit_n]
    back = [event.at for event in result.events if (event.kind, event.text) == (EventKind.PHASE, RETRACT)]
    stops = [event.at for event in result.events if event.kind == EventKind.STOP]
    stopped = any(at < min(back, default=math.inf) + TICK_S for at in stops)
    if by_force:
        began = _last_peak(above[above < min(back, default=math.inf)]) if stopped else math.nan
    below = bool(len(above)) and above[-1] < times[-1]
    return Times(
        back[0] - began if back and not math.isnan(began) else None,
        float(above[-1]) + TICK_S - began if below else None,
        float(forces.max()),
        float(forces[-1]),
        stopped,
        result.text,
        result.left,
    )


def _last_peak(above: NDArray[np.float64]) -> float:
    """Return when the force rose above the limit for the last time, s; `above` are the times at which it is above."""
    begins = above[np.diff(above, prepend=-math.inf) > 1.5 * TICK_S]
    return float(begins[-1]) if len(begins) else math.nan


def places() -> Iterator[tuple[Case, str, float]]:
    """Return every case for each robot to which it applies, on every surface."""
    return (
        (case, robot, stiffness)
        for case in ALL_CASES
        for robot in case.robots
        for stiffness in STIFFNESSES_N_M
    )


def measure(robots: Sequence[str], before: Mapping[str, Any]) -> dict[str, Any]:
    """Make all runs of these robots, or of all robots if none is named. The figures of other robots are kept.

    The result has, by case, robot and stiffness, the results of all seeds in order.
    """
    again = [place for place in places() if not robots or place[1] in robots]
    jobs = [Job(*place, seed) for place in again for seed in range(1, SEEDS[place[1]] + 1)]
    figures: dict[str, Any] = {}
    runs = iter(run_jobs(measured, jobs))
    for case, robot, stiffness in places():
        by_stiffness = figures.setdefault(case.name, {}).setdefault(robot, {})
        if (case, robot, stiffness) in again:
            by_stiffness[f"{stiffness:g}"] = columns([next(runs) for _ in range(SEEDS[robot])])
        else:
            by_stiffness[f"{stiffness:g}"] = before[case.name][robot][f"{stiffness:g}"]
    return figures


def columns(runs: Sequence[Times]) -> dict[str, list[Any]]:
    """Return the figures of the runs of one case at one stiffness, rounded for the page."""
    return {
        "order_s": [_rounded(run.order_s) for run in runs],
        "below_s": [_rounded(run.below_s) for run in runs],
        "largest_n": [_rounded(run.largest_n) for run in runs],
        "stopped": [run.stopped for run in runs],
        "retracted": [run.left.startswith("retracted") for run in runs],
    }


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, 3)


def conditions_table() -> str:
    """Return the tables of all conditions: a table by reaction for each phase of a run."""
    parts = []
    for when in When:
        parts.append(f"### {when.value.capitalize()}")
        groups = dict[str, list[Sequence[str]]]()
        for name, text, settings, _, reaction, code, part in (
            cells(row) for row in TABLE if row.when is when
        ):
            leads_to = f"{reaction}, exit code {code}" if code != "" else str(reaction)
            keys = ", ".join(f"`{key}`" for key in settings)
            groups.setdefault(leads_to, []).append((f"`{name}`", str(text), keys, str(part)))
        for leads_to, rows in groups.items():
            parts += [f"*{leads_to[:1].upper()}{leads_to[1:]}:*", table(CONDITION_HEAD, rows)]
    return "\n\n".join(parts)


def ends_table() -> str:
    """Return the table of the outcome of each stimulus in each state of a run."""
    rows = (
        (f"**{state}**", *(_transition(TRANSITIONS[state, stimulus]) for stimulus in Stimulus))
        for state in RunState
    )
    return table(["the run is", *map(str, Stimulus)], rows)


def _transition(transition: Transition) -> str:
    match transition.outcome:
        case Outcome.INTERRUPTED:
            return f"{transition.act}, {INTERRUPTED}"
        case Outcome.STOPPED:
            return f"{transition.act}, code of its cause"
        case _:
            return str(transition.act)


def times_table(figures: Mapping[str, Any]) -> str:
    """Return the table with a row for each case: slowest retraction order and largest true force, for the S3 and
    for streaming robots.
    """
    head = (
        "what happens",
        "S3: order back after, s",
        "streamed: order back after, s",
        "S3: largest true force, N",
        "streamed: largest true force, N",
        "reported as retracted",
    )
    return table(head, (tuple(_times_row(case, figures[case.name])) for case in CASES))


def _times_row(case: Case, by_robot: Mapping[str, Any]) -> Iterator[str]:
    groups = [_runs_of(by_robot, names) for names in (("s3",), STREAMED)]
    yield case.name
    yield from (_largest(runs["order_s"], 2) for runs in groups)
    yield from (_largest(runs["largest_n"], 0) for runs in groups)
    retracted = [one for runs in groups for one in runs["retracted"]]
    yield f"{sum(retracted)} of {len(retracted)}"


def _runs_of(by_robot: Mapping[str, Any], robots: Sequence[str]) -> Mapping[str, list[Any]]:
    """Return the figures of these robots on both surfaces, combined."""
    joined: dict[str, list[Any]] = {"order_s": [], "largest_n": [], "stopped": [], "retracted": []}
    for robot in robots:
        for runs in by_robot.get(robot, {}).values():
            for name, column in joined.items():
                column.extend(runs[name])
    return joined


def _largest(values: Sequence[float | None], digits: int) -> str:
    given = [value for value in values if value is not None]
    return f"{max(given):.{digits}f}" if given else ""


def uncovered_table(figures: Mapping[str, Any]) -> str:
    """Return the table with a row for each undetected fault of a sensor: stopped runs and largest true force, by
    robot.
    """
    rows = []
    for case in UNCOVERED:
        cells = []
        for robot in ROBOTS:
            runs = _runs_of(figures[case.name], (robot,))
            stopped = f"{sum(runs['stopped'])} of {len(runs['stopped'])}"
            cells.append(f"{stopped}, {_largest(runs['largest_n'], 0)} N")
        rows.append((case.name, *cells))
    return table(("what happens", *ROBOTS), rows)


TABLES: Mapping[str, Callable[[Mapping[str, Any]], str]] = {
    "conditions": lambda figures: conditions_table(),
    "ends": lambda figures: ends_table(),
    "times": times_table,
    "uncovered": uncovered_table,
}
JSON_DEPTH = 4
