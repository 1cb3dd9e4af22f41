"""Write the table of the bound of the true force into docs/explanation/safety.md, from runs that hit a surface.

With --measure the runs are made first, in virtual time, and their figures go to docs/explanation/bound.json; it takes
a quarter of an hour. With --check nothing is written; the exit code is 1 when the document is not up to date.
"""

import json
import math
import sys
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from itertools import pairwise
from pathlib import Path
from typing import Any

import hil_bridge
from hil_bridge.control.types import SAMPLE_MS, Command, Measurement
from hil_bridge.guard.force_bound import force_bound_n
from hil_bridge.recording.device_facts import devices_of
from hil_bridge.settings.configuration import read_config
from tools.pages import parser, placed, table, write

DOCS = Path(__file__).resolve().parent.parent / "docs" / "explanation"
DOCUMENT, FIGURES = DOCS / "safety.md", DOCS / "bound.json"
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


class Push:
    """A controller that does not look at the force."""

    name = "push"

    def __init__(self, sample_ms: float) -> None:
        self.sample_ms = sample_ms

    def initial(self) -> None:
        """It keeps nothing."""

    def step(self, state: None, measurement: Measurement, reference: float) -> tuple[None, Command]:
        """Deeper, at the fastest speed that is allowed."""
        way = PUSHED_M_S * measurement.dt
        return None, Command(measurement.commanded + way, way)


def settings(robot: str, sensor: str, period_ms: int, stiffness_kn_m: int) -> dict[str, Any]:
    """A run that approaches a surface which is expected to have 5 kN/m, and tracks it for 0.6 s."""
    values: dict[str, Any] = {
        "run": {"duration_s": 0.6, "seed": 1},
        "robot": {"emulated": robot},
        "sensor": {"emulated": sensor},
        "cell": {"surface": {"stiffness_n_m": stiffness_kn_m * 1e3}},
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


def measure() -> dict[str, Any]:
    """All runs: by robot, period and case the force and the bound with each sensor."""
    jobs = [
        (robot, sensor, period, case)
        for robot, periods in PERIODS_MS.items()
        for period in periods
        for case in CASES
        for sensor in SENSORS
    ]
    figures: dict[str, Any] = {}
    with ProcessPoolExecutor() as pool:
        for (robot, sensor, period, case), pair in zip(jobs, pool.map(measured, jobs), strict=True):
            cell = figures.setdefault(robot, {}).setdefault(str(period), {}).setdefault(case, {})
            cell[sensor] = pair
    return figures


def bound_table(figures: Mapping[str, Any]) -> str:
    """A row for each robot and period: of the six sensors the one that came nearest to its bound."""
    rows = []
    for robot, periods in figures.items():
        for period, by_case in periods.items():
            row = [robot, "its line's" if period == "0" else period]
            for case in CASES:
                force, bound, sensor = _nearest(by_case[case])
                row += [f"{force:.0f} of {bound:.0f} ({sensor})"]
            rows.append(row)
    return table(("robot", "period, ms", "at 5 kN/m, N", "at 50 kN/m, N", "pushed at 50 kN/m, N"), rows)


def _nearest(cells: Mapping[str, Sequence[float]]) -> tuple[float, float, str]:
    """Force, bound and sensor of the run that came nearest to its bound."""
    sensor = max(cells, key=lambda name: cells[name][0] / cells[name][1])
    force, bound = cells[sensor]
    return force, bound, sensor


def renewed(text: str, figures: Mapping[str, Any]) -> str:
    """The document with the table as the figures have it. Raises ValueError where it has no place."""
    return placed(text, {"bound": bound_table(figures)})


def as_json(figures: Mapping[str, Any]) -> str:
    """A line for each robot and period."""
    robots = []
    for robot, periods in figures.items():
        lines = [
            f"  {json.dumps(period)}: {{"
            + ", ".join(f"{json.dumps(case)}: {json.dumps(cells)}" for case, cells in by_case.items())
            + "}"
            for period, by_case in periods.items()
        ]
        robots.append(f" {json.dumps(robot)}: {{\n" + ",\n".join(lines) + "\n }")
    return "{\n" + ",\n".join(robots) + "\n}\n"


def main() -> int:
    """Measure if asked to, then write the document, or check it."""
    options = parser(__doc__)
    options.add_argument("--measure", action="store_true", help="make the runs first")
    chosen = options.parse_args()
    if chosen.measure:
        FIGURES.write_text(as_json(measure()), encoding="utf-8")
    figures = json.loads(FIGURES.read_text(encoding="utf-8"))
    return write(DOCUMENT, lambda text: renewed(text, figures), chosen.check)


if __name__ == "__main__":
    sys.exit(main())
