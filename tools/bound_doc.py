"""Two tables of the true force in docs/explanation/safety.md, from runs that hit a surface.

One table compares the force with its bound for each period. The other lists the force by stiffness, approach speed
and delay. The runs use virtual time. `--measure touch` makes only the runs of one table.
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
"""Periods of each robot, ms; 0 selects the pace of its line."""
CASES = ("5", "50", "pushed")
"""Stiffness in kN/m with the default controller, and 50 kN/m with a controller that moves deeper at maximum speed."""
PUSHED_KN_M = 50
PUSHED_M_S = 0.0109
"""Speed of the pushing controller, m/s. Chosen: just below `limits.correction_mm_s`, so that only the force stops
the run.
"""
OWN_MS = 4
"""Largest period that counts as the robot's own cycle, ms. A Net F/T is fast enough for it."""

TOUCH_KN_M, TOUCH_MM_S, TOUCH_SEEDS = (5, 20, 50), (2, 5, 10), (1, 2, 3)
TOUCH_SHOWN = ((5, 10), (50, 2), (50, 10))
"""Stiffness, kN/m, and speed, mm/s, of each column on the page."""
TOUCH_MS: Mapping[str, int] = {"s3": 0, "egm": 20, "rtde": 20, "rsi": 20}
"""Period of each robot's runs, ms."""
WAYS: Mapping[str, str] = {"s3": "both", "egm": "both", "rtde": "from", "rsi": "from"}
"""Direction of the delayed packets on each robot's wire."""
LATE: Mapping[str, float] = {"nothing": 0.0, "link": 20.0, "forces": 50.0, "forces, much": 150.0}
"""Wire that is delayed from the connection on, and the delay, ms."""


_STILL = {"wander_n": 0.0, "creep_share": 0.0, "vibration_n": 0.0, "motion_n": 0.0}
SETTLED: Mapping[str, Mapping[str, Any]] = {
    name: {name.replace("-", "_"): _STILL} for name in ("netft", "ati-can", "ft300")
}
"""Settings of sensors with only white noise. The bound concerns times, and other errors would blur the comparison."""


class Push:
    """Controller that ignores the force."""

    name = "push"

    def __init__(self, sample_ms: float) -> None:
        self.sample_ms = sample_ms

    def initial(self) -> None:
        """Return None: the controller has no state."""

    def step(self, state: None, measurement: Measurement, reference: float) -> tuple[None, Command]:
        """Move deeper at the maximum allowed speed."""
        way = PUSHED_M_S * measurement.dt
        return None, Command(measurement.commanded + way, way)


def settings(robot: str, sensor: str, period_ms: int, stiffness_kn_m: int) -> dict[str, Any]:
    """Return the settings of a run that approaches a surface expected to have 5 kN/m, and tracks it for 0.6 s."""
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
    """Return the largest true force of one run, and its bound, N."""
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


def force_of_touch(job: tuple[str, str, int, int, int]) -> tuple[float, str]:
    """Return the largest true force of one touch, N, and the outcome of its run."""
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
    """Return the largest forces and the outcomes, by robot and delay, in rows over stiffnesses and speeds."""
    cells = [(robot, late, k, v) for robot in WAYS for late in LATE for k in TOUCH_KN_M for v in TOUCH_MM_S]
    figures: dict[str, Any] = {}
    runs = iter(run_jobs(force_of_touch, [(*cell, seed) for cell in cells for seed in TOUCH_SEEDS]))
    for robot, late, _, _ in cells:
        row = figures.setdefault(robot, {}).setdefault(late, [])
        row.append(max(next(runs) for _ in TOUCH_SEEDS))
    return figures


def measure_bound() -> dict[str, Any]:
    """Return the force and the bound with each sensor, by robot, period and case."""
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
    """Return the table with a row for each robot. The row shows the run closest to its bound, of all periods and
    sensors.
    """
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
    """Return the table with a row for each robot and delay, and a column for each selected stiffness and speed."""
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
"""Functions that make the runs of each table."""
JSON_DEPTH = 3


def measure(names: Sequence[str], before: Mapping[str, Any]) -> dict[str, Any]:
    """Make the runs of these tables. Without names, make the runs of both tables."""
    return {**before, **{name: MEASURES[name]() for name in names or MEASURES}}
