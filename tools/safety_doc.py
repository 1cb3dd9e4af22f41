"""Write the tables of docs/explanation/safety.md: the conditions from the code, the times from runs that are measured.

The prose between the tables is left as it is. With --measure the runs are made first, in virtual time, and their
figures go to docs/explanation/safety.json; it takes some minutes. With --check nothing is written; the exit code is 1
when the document is not up to date.
"""

import gc
import json
import math
import random
import statistics
import sys
from collections.abc import AsyncIterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from emulators.s3_jr3_cell import PaperCell
from hil_bridge.analysis.strokes import TRACK
from hil_bridge.analysis.summary import RETRACT
from hil_bridge.clock import Clock, Timer, run_virtual
from hil_bridge.control.course.conditions import When
from hil_bridge.device_log import LogTo
from hil_bridge.faults.schedule import FaultSchedule
from hil_bridge.guard.conditions import CONDITIONS, HEAD, cells
from hil_bridge.recording import PHASE_EVENT, STOP_EVENT, CycleRecord, EventRecord
from hil_bridge.runs.compose import open_devices
from hil_bridge.runs.cycle import Run
from hil_bridge.settings.configuration import Config
from protocol.s3.arap import FunctionCode
from tools.pages import parser, placed, table, write

DOCS = Path(__file__).resolve().parent.parent / "docs" / "explanation"
DOCUMENT, FIGURES = DOCS / "safety.md", DOCS / "safety.json"
SEEDS = 20
STIFFNESSES_N_M = (5e3, 5e4)
WATCH_S, TICK_S = 0.05, 0.001
"""How often the truth is asked for, and how finely, s."""
TRACK_S = 9.0
"""Time for which a run would track if nothing happened, s."""
AFTER_S = (0.8, 2.0)
"""When a fault comes after the begin of TRACK, s: between these, drawn by the seed."""


@dataclass(frozen=True)
class Case:
    """Something that happens to a run that holds 10 N."""

    name: str
    faults: tuple[Mapping[str, Any], ...] = ()
    """None without a person that presses Ctrl-C."""
    by_force: bool = False
    """The time counts from the moment at which the true force passes the limit, not from the begin of the fault."""
    per_stiffness: Mapping[str, float] = field(default_factory=dict)
    """Parameters that are so much divided by the stiffness in kN/m, so that the force is the same."""


def _fault(on: str, fault: str, for_s: float | None = None, **parameters: object) -> Mapping[str, Any]:
    return {"on": on, "fault": fault, "with": parameters, **({} if for_s is None else {"for_s": for_s})}


FOR_GOOD_S = 3600.0
CASES = (
    Case("Ctrl-C"),
    Case("the surface rises by what makes 80 N, in 100 ms", (_fault("surface", "step"),), True, {"mm": 80.0}),
    Case("an inclusion ten times as hard, over 100 ms", (_fault("surface", "hard"),), True),
    Case("the sensor reads 60 N more", (_fault("signal", "offset", amount=-60.0),)),
    Case("the sensor falls silent", (_fault("frames", "off", FOR_GOOD_S),)),
    Case("the sensor's frames come 500 ms late", (_fault("frames", "delay", ms=500.0),)),
    Case("the sensor repeats one sample", (_fault("signal", "stuck"),)),
    Case("the reported position jumps by 20 mm", (_fault("pose", "offset", z_mm=20.0),)),
    Case("the reported orientation turns by 30°", (_fault("pose", "turned"),)),
    Case("the computer stands still for 0.8 s", (_fault("computer", "pause", seconds=0.8),)),
    Case("the robot refuses one point", (_fault("robot", "refuse", code=31, function=FunctionCode.MOVE),)),
    Case("the robot's emergency stop is pressed", (_fault("robot", "emergency-stop"),)),
    Case("the robot's link is dead for 8 s", (_fault("link", "off", 8.0),)),
)
UNCOVERED = (
    Case("the sensor's Fz gives noise only", (_fault("signal", "dead"),)),
    Case("the sensor's Fz tells a tenth", (_fault("signal", "scale", factor=0.1),)),
    Case("the sensor's Fz drifts by 2 N/s the wrong way", (_fault("signal", "drift", per_s=2.0),)),
)
"""Faults that pass the checks and stay within the limits."""


@dataclass(frozen=True)
class Times:
    """Result of one run, s and N; None where it did not happen."""

    order_s: float | None
    """Time from the begin to the first order of the retraction."""
    below_s: float | None
    """Time from the begin until the true force is below the limit for good; None where it never was above."""
    largest_n: float
    """Largest true force from the begin on."""
    end_n: float
    """True force at the end."""
    stopped: bool
    """The run was ended for it, before its time was up."""
    cause: str
    left: str


class _Robot:
    """A robot link whose orders to move are noted."""

    def __init__(self, inner: Any, clock: Clock, orders: list[float]) -> None:
        self._inner, self._clock, self._orders = inner, clock, orders

    def __getattr__(self, name: str) -> Any:
        return getattr(self._inner, name)

    @asynccontextmanager
    async def motion(self, velocity: float) -> AsyncIterator[Any]:
        async with self._inner.motion(velocity) as motion:
            order = motion.to

            async def noted(*place: Any, **how: Any) -> Any:
                self._orders.append(self._clock.now())
                return await order(*place, **how)

            motion.to = noted
            yield motion


class _Watched:
    """One run of a case, and the truth beside. Also the run's log."""

    def __init__(self, case: Case, stiffness: float, seed: int) -> None:
        self.case = case
        after_s = random.Random(seed).uniform(*AFTER_S)
        faults = []
        for fault in case.faults:
            given = {key: value / (stiffness * 1e-3) for key, value in case.per_stiffness.items()}
            faults.append({**fault, "phase": TRACK, "after_s": after_s, "with": {**fault["with"], **given}})
        self.config = Config.model_validate(
            {
                "run": {"duration_s": TRACK_S, "seed": seed},
                "cell": {"surface": {"stiffness_n_m": stiffness}},
                "faults": faults,
            }
        )
        self.after_s = after_s
        self.orders: list[float] = []
        self.stops: list[float] = []
        self.stopped = False
        self.phases: dict[str, float] = {}
        self.forces: list[tuple[float, float]] = []
        self.pressed_at = math.nan
        self.schedule: FaultSchedule | None = None
        self.clock: Clock
        self.cell: PaperCell
        self.run: Run

    def cycle(self, record: CycleRecord) -> None:
        assert self.schedule is not None
        self.schedule.cycle(record)

    def event(self, record: EventRecord) -> None:
        if record.kind == STOP_EVENT:
            self.stops.append(record.at)
        if record.kind == PHASE_EVENT:
            self.phases.setdefault(record.text, record.at)
            if record.text == TRACK and not self.case.faults:
                self.clock.call_at(record.at + self.after_s, self._press)
        if self.schedule is not None:
            self.schedule.event(record)

    def notice(self, kind: str, text: str) -> None:
        self.event(EventRecord(self.clock.now(), kind, text))

    def _press(self) -> None:
        self.pressed_at = self.clock.now()
        self.run.interrupt()

    async def main(self) -> Times:
        """Run to the end."""
        self.clock = clock = Clock.running()
        timers: list[Timer] = []
        asked = clock.now()

        def watch() -> None:
            nonlocal asked
            now = clock.now()
            times = [asked + k * TICK_S for k in range(1, int((now - asked) / TICK_S + 1e-6) + 1)]
            asked = times[-1] if times else asked
            states = self.cell.true_states(times) if times else []
            for at, state in zip(times, states, strict=True):
                self.forces.append((at, math.hypot(*state.contact_force)))
            timers[:] = [clock.call_at(now + WATCH_S, watch)]

        async with open_devices(self.config, clock, LogTo(notice=self.notice)) as devices:
            assert devices.cell is not None
            self.cell = devices.cell
            watch()
            robot = _Robot(devices.robot, clock, self.orders)
            self.run = Run(self.config, clock, robot, devices.sensor, self)
            self.schedule = FaultSchedule(
                self.config.faults, self.cell, clock, self.notice, self.run.stand_still
            )
            try:
                result = await self.run()
                self.stopped = any(at < self.phases[RETRACT] + TICK_S for at in self.stops)
            finally:
                watch()
                timers[0].cancel()
                self.schedule.close()
        return self._times(result.cause, result.left)

    def _times(self, cause: str, left: str) -> Times:
        began = self.cell.faults[0].injected_at if self.case.faults else self.pressed_at
        limit = self.config.limits.force_limit_n
        after = [(at, force) for at, force in self.forces if at >= began]
        above = [at for at, force in after if force > limit]
        if self.case.by_force:
            began = above[0] if above else math.nan
        back = [at for at in self.orders if at >= self.phases.get(RETRACT, math.inf)]
        last_is_below = bool(above) and above[-1] < after[-1][0]
        return Times(
            back[0] - began if back else None,
            above[-1] + TICK_S - began if last_is_below else None,
            max(force for _, force in after),
            after[-1][1],
            self.stopped,
            cause,
            left,
        )


ALL_CASES = (*CASES, *UNCOVERED)


def measured(number: int, stiffness: float, seed: int) -> Times:
    """One run of a case, by its place among all."""
    return run_virtual(_Watched(ALL_CASES[number], stiffness, seed).main)


def _one(job: tuple[int, float, int]) -> Times:
    times = measured(*job)
    gc.collect()  # a cell and its run refer to each other
    return times


def measure() -> dict[str, Any]:
    """All runs of all cases: by case and stiffness what each seed showed, seed by seed."""
    jobs = [(n, k, s) for n in range(len(ALL_CASES)) for k in STIFFNESSES_N_M for s in range(1, SEEDS + 1)]
    with ProcessPoolExecutor() as pool:
        found = list(pool.map(_one, jobs, chunksize=4))
    result: dict[str, Any] = {}
    for start in range(0, len(jobs), SEEDS):
        number, stiffness, _ = jobs[start]
        result.setdefault(ALL_CASES[number].name, {})[f"{stiffness:g}"] = columns(
            found[start : start + SEEDS]
        )
    return result


def columns(runs: Sequence[Times]) -> dict[str, list[Any]]:
    """Figures of the runs of one case at one stiffness for the page, rounded as the page tells them."""
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
    """Every condition, a table for each time at which it is looked."""
    parts = []
    for when in When:
        rows = [cells(row) for row in CONDITIONS if row.when is when]
        head = [name for name in HEAD if name != "looked at"]
        named = (
            (f"`{name}`", text, ", ".join(f"`{key}`" for key in settings), reaction, code)
            for name, text, settings, _, reaction, code in rows
        )
        parts += [f"### {when.value.capitalize()}", table(head, named)]
    return "\n\n".join(parts)


def times_table(figures: Mapping[str, Any]) -> str:
    """Median and largest of each case and stiffness."""
    rows = []
    for case in CASES:
        for stiffness, runs in figures[case.name].items():
            ordered, number = _there(runs["order_s"]), len(runs["order_s"])
            rows.append(
                (
                    case.name,
                    f"{float(stiffness) * 1e-3:g}",
                    f"{len(ordered)} of {number}",
                    _span(ordered),
                    _span(_there(runs["below_s"])),
                    f"{max(runs['largest_n']):.0f}",
                    f"{sum(runs['retracted'])} of {number}",
                )
            )
    head = (
        "what happens",
        "kN/m",
        "ordered back",
        "to that order, s",
        "to below the limit, s",
        "largest true force, N",
        "told as retracted",
    )
    return table(head, rows)


def uncovered_table(figures: Mapping[str, Any]) -> str:
    """Results of runs whose sensor went wrong unseen."""
    rows = []
    for case in UNCOVERED:
        for stiffness, runs in figures[case.name].items():
            orders = [at for at, stopped in zip(runs["order_s"], runs["stopped"], strict=True) if stopped]
            rows.append(
                (
                    case.name,
                    f"{float(stiffness) * 1e-3:g}",
                    f"{len(orders)} of {len(runs['order_s'])}",
                    _span(_there(orders)) if orders else "",
                    f"{max(runs['largest_n']):.0f}",
                )
            )
    head = ("what happens", "kN/m", "stopped", "to the order back, s", "largest true force, N")
    return table(head, rows)


def _there(values: Sequence[float | None]) -> list[float]:
    return [value for value in values if value is not None]


def _span(values: Sequence[float]) -> str:
    if not values:
        return "never above"
    return f"{statistics.median(values):.2f}, at most {max(values):.2f}"


def renewed(text: str, figures: Mapping[str, Any]) -> str:
    """The document with every table as code and figures have it now. Raises ValueError for one without its place."""
    tables = {
        "conditions": conditions_table(),
        "times": times_table(figures),
        "uncovered": uncovered_table(figures),
    }
    return placed(text, tables)


def _as_json(figures: Mapping[str, Any]) -> str:
    """A line for each column, so that a difference can be read."""
    cases = []
    for name, by_stiffness in figures.items():
        parts = []
        for stiffness, runs in by_stiffness.items():
            lines = (f"   {json.dumps(key)}: {json.dumps(values)}" for key, values in runs.items())
            parts.append(f"  {json.dumps(stiffness)}: {{\n" + ",\n".join(lines) + "\n  }")
        cases.append(f" {json.dumps(name, ensure_ascii=False)}: {{\n" + ",\n".join(parts) + "\n }")
    return "{\n" + ",\n".join(cases) + "\n}\n"


def main() -> int:
    """Measure if wanted, then write the document, or check it."""
    options = parser(__doc__)
    options.add_argument("--measure", action="store_true", help="make the runs first")
    wanted = options.parse_args()
    if wanted.measure:
        FIGURES.write_text(_as_json(measure()), encoding="utf-8")
    figures = json.loads(FIGURES.read_text(encoding="utf-8"))
    return write(DOCUMENT, lambda text: renewed(text, figures), wanted.check)


if __name__ == "__main__":
    sys.exit(main())
