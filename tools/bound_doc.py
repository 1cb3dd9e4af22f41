"""Two tables of the true force in docs/explanation/safety.md, from runs that hit a surface.

The one compares it with its bound, at each period. The other has it by stiffness, approach speed and delay. The runs
are made in virtual time; `--measure touch` makes those of one table alone.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import Any

import hil_bridge
from hil_bridge.control.types import SAMPLE_MS, Command, Measurement
from hil_bridge.record.device_facts import devices_of
from hil_bridge.runs.force_bound import force_bound_n
from hil_bridge.settings.configuration import read_config
from tools.pages import run_jobs, table

SENSORS = ("jr3", "jr3-uart", "jr3-board", "netft", "ati-can", "ft300")
PERIODS_MS: Mapping[str, tuple[int, ...]] = {
    "s3": (0,),
    "egm": (4, 8, 12, 20, 50, 180),
    "rtde": (2, 8, 12, 20, 50, 180),
    "rsi": (4, 8, 12, 20, 50, 180),
}
"""Periods of each robot; 0 is the pace of its line."""
CASES = ("5", "50", "pushed")
"""Stiffness in kN/m with the usual controller; then on 50 kN/m one that goes deeper as fast as it may."""
PUSHED_KN_M = 50
PUSHED_M_S = 0.0109
"""Chosen: a hair below `limits.correction_mm_s`, so that nothing else than the force stops the run."""
OWN_MS = 4
"""A period up to this is the robot's own cycle, which a Net F/T keeps pace with by itself."""

TOUCH_KN_M, TOUCH_MM_S, TOUCH_SEEDS = (5, 20, 50), (2, 5, 10), (1, 2, 3)
TOUCH_SHOWN = ((5, 10), (50, 2), (50, 10))
"""Stiffness and speed of the columns of the page."""
TOUCH_MS: Mapping[str, int] = {"s3": 0, "egm": 20, "rtde": 20, "rsi": 20}
"""Period of each robot's runs."""
WAYS: Mapping[str, str] = {"s3": "both", "egm": "both", "rtde": "from", "rsi": "from"}
"""The packets that come late on each robot's wire."""
LATE: Mapping[str, float] = {"nothing": 0.0, "link": 20.0, "forces": 50.0, "forces, much": 150.0}
"""The wire that is late from the connection on, and by how many ms."""


_STILL = {"wander_n": 0.0, "creep_share": 0.0, "vibration_n": 0.0, "motion_n": 0.0}
SETTLED: Mapping[str, Mapping[str, Any]] = {
    name: {name.replace("-", "_"): _STILL} for name in ("netft", "ati-can", "ft300")
}
"""Sensors with white noise alone: the bound is of times, and the other errors would blur them."""


class Push:
    """A controller that does not look at the force."""

    name = "push"

    def __init__(self, sample_ms: float) -> None:
        self.sample_ms = sample_ms

    def initial(self) -> None:
        """Return no memory."""

    def step(self, state: None, measurement: Measurement, reference: float) -> tuple[None, Command]:
        """Deeper, at the fastest speed that is allowed."""
        way = PUSHED_M_S * measurement.dt
        return None, Command(measurement.commanded + way, way)


def settings(robot: str, sensor: str, period_ms: int, stiffness_kn_m: int) -> dict[str, Any]:
    """Return a run that approaches a surface which is expected to have 5 kN/m, and tracks it for 0.6 s."""
    values: dict[str, Any] = {
        "run": {"duration_s": 0.6, "seed": 1},
        "robot": {"emulated": robot},
        "sensor": {"emulated": sensor},
        "cell": {"surface": {"stiffness_n_m": stiffness_kn_m * 1e3}, **SETTLED.get(sensor, {})},
        "task": {"expected_stiffness_n_m": 5e3, "retract_mm": 3.0, "retract_speed_mm_s": 20.0},
    }
    if period_ms:
        values["cell"]["start_position_mm"] = [900.0, -100.0, 592.0]
    if period_ms > OWN_MS or (period_ms and sensor != "netft"):
        values["run"]["period_ms"] = period_ms
        values["controller"] = {"sample_ms": period_ms}
    return values


def measured(job: tuple[str, str, int, str]) -> tuple[float, float]:
    """Largest true force of one run, and its bound, N."""
    robot, sensor, period_ms, case = job
    stiffness_kn_m = PUSHED_KN_M if case == "pushed" else int(case)
    values = settings(robot, sensor, period_ms, stiffness_kn_m)
    push = None
    if case == "pushed":
        values.pop("controller", None)
        values["run"]["period_ms"] = period_ms
        push = Push(period_ms or SAMPLE_MS)
    recording = hil_bridge.simulate(values, controller=push).recording
    longest_s = max(b.started_at - a.started_at for a, b in pairwise(recording.cycles))
    bound = force_bound_n(read_config(values), devices_of(recording), stiffness_kn_m * 1e3, longest_s)
    return round(max(math.hypot(*truth.force) for truth in recording.truths), 1), round(bound, 1)


def touched(job: tuple[str, str, int, int, int]) -> tuple[float, str]:
    """Largest true force of one touch, N, and the outcome of its run."""
    robot, late, stiffness_kn_m, speed_mm_s, seed = job
    values = settings(robot, "netft" if TOUCH_MS[robot] else "jr3", TOUCH_MS[robot], stiffness_kn_m)
    values["task"]["approach_speed_mm_s"] = speed_mm_s
    on, way = ("wire", WAYS[robot]) if late == "link" else ("sensor-wire", "both")
    given = {"ms": LATE[late], "way": way}
    struck = {"on": on, "fault": "late", "phase": "connect", "for_s": 600.0, "with": given}
    faults = [struck] if LATE[late] else []
    recording = hil_bridge.simulate(values, faults=faults, seed=seed).recording
    largest = max((math.hypot(*truth.force) for truth in recording.truths), default=0.0)
    return round(largest, 1), recording.end["outcome"]


def measure_touches() -> dict[str, Any]:
    """By robot and what is late: a row of stiffnesses and speeds, each with the largest force and its outcome."""
    cells = [(robot, late, k, v) for robot in WAYS for late in LATE for k in TOUCH_KN_M for v in TOUCH_MM_S]
    figures: dict[str, Any] = {}
    runs = iter(run_jobs(touched, [(*cell, seed) for cell in cells for seed in TOUCH_SEEDS]))
    for robot, late, _, _ in cells:
        row = figures.setdefault(robot, {}).setdefault(late, [])
        row.append(max(next(runs) for _ in TOUCH_SEEDS))
    return figures


def measure_bound() -> dict[str, Any]:
    """All runs: by robot, period and case the force and the bound with each sensor."""
    jobs = [
        (robot, sensor, period, case)
        for robot, periods in PERIODS_MS.items()
        for period in periods
        for case in CASES
        for sensor in SENSORS
    ]
    figures: dict[str, Any] = {}
    for (robot, sensor, period, case), pair in zip(jobs, run_jobs(measured, jobs), strict=True):
        cell = figures.setdefault(robot, {}).setdefault(str(period), {}).setdefault(case, {})
        cell[sensor] = pair
    return figures


def bound_table(figures: Mapping[str, Any]) -> str:
    """Return a row for each robot: of all periods and sensors the run that came nearest to its bound."""
    rows = []
    for robot, periods in figures["bound"].items():
        row = [robot]
        for case in CASES:
            runs = [
                (*pair, sensor, period)
                for period, by_case in periods.items()
                for sensor, pair in by_case[case].items()
            ]
            force, bound, sensor, period = max(runs, key=lambda run: run[0] / run[1])
            row.append(f"{force:.0f} of {bound:.0f} ({sensor}{f', {period} ms' if int(period) else ''})")
        rows.append(row)
    return table(("robot", "at 5 kN/m, N", "at 50 kN/m, N", "pushed at 50 kN/m, N"), rows)


def touch_table(figures: Mapping[str, Any]) -> str:
    """Return a row for each robot and what is late, a column for some stiffnesses and speeds."""
    pairs = [(k, v) for k in TOUCH_KN_M for v in TOUCH_MM_S]
    shown = [pairs.index(pair) for pair in TOUCH_SHOWN]
    head = ("robot", "late", *(f"{k} kN/m, {v} mm/s" for k, v in TOUCH_SHOWN))
    rows = [
        [robot, f"{late.partition(',')[0]}{f', {LATE[late]:g} ms' if LATE[late] else ''}"]
        + [f"{row[at][0]:.0f}{' stopped' if row[at][1] == 'stopped' else ''}" for at in shown]
        for robot, by_late in figures["touch"].items()
        for late, row in by_late.items()
    ]
    return table(head, rows)


TABLES = {"bound": bound_table, "touch": touch_table}
MEASURES: Mapping[str, Callable[[], dict[str, Any]]] = {"bound": measure_bound, "touch": measure_touches}
"""The runs of each table."""
JSON_DEPTH = 3


def measure(names: Sequence[str], before: Mapping[str, Any]) -> dict[str, Any]:
    """Make the runs of these tables, of both where none is named."""
    return {**before, **{name: MEASURES[name]() for name in names or MEASURES}}
