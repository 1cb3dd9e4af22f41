"""Write the table of docs/explanation/streaming.md: each controller on each robot, on soft, hard, curved surfaces.

With --measure the runs are made first, in virtual time, and their figures go to docs/explanation/streaming.json; it
takes some ten minutes. With --check nothing is written; the exit code is 1 when the document is not up to date.
"""

import json
import math
import statistics
import sys
from collections.abc import Mapping, Sequence
from itertools import pairwise, product
from pathlib import Path
from typing import Any

from hil_bridge.control import CONTROLLERS
from hil_bridge.lab.experiments.emulated_run import run_emulated
from hil_bridge.lab.processes import in_order, own_processes
from hil_bridge.runs.setup import Setup
from hil_bridge.settings.configuration import read_config
from tools.pages import parser, placed, table, write

DOCS = Path(__file__).resolve().parent.parent / "docs" / "explanation"
DOCUMENT, FIGURES = DOCS / "streaming.md", DOCS / "streaming.json"
ROBOTS: Mapping[str, str] = {"s3": "jr3", "egm": "netft", "rtde": "netft", "rsi": "netft"}
"""Robots, each with the sensor that it runs with."""
FORCE_N = 10.0
TRACK_S, SETTLED_S = 8.0, 2.0
"""Time of tracking, and the begin of it that does not count for the error, s."""
CURVED = {"kind": "sinusoidal", "amplitude_mm": 3.0, "period_mm": 150.0, "origin_y_mm": -100.0}
SURFACES: Mapping[str, Mapping[str, Any]] = {
    "level, 5 kN/m": {"stiffness_n_m": 5e3},
    "level, 50 kN/m": {"stiffness_n_m": 5e4},
    "curved, 5 kN/m": {"stiffness_n_m": 5e3, **CURVED},
    "curved, 50 kN/m": {"stiffness_n_m": 5e4, **CURVED},
}


def figures_of(case: tuple[str, str, str]) -> Mapping[str, Any]:
    """One run: robot, controller, surface."""
    robot, controller, name = case
    surface = SURFACES[name]
    config = Setup(
        read_config(
            {
                "run": {"duration_s": TRACK_S, "seed": 1},
                "robot": {"emulated": robot},
                "sensor": {"emulated": ROBOTS[robot]},
                "controller": {"name": controller},
                "frame": {"follow_normal": "kind" in surface},
                "task": {"expected_stiffness_n_m": surface["stiffness_n_m"]},
                "cell": {"start_position_mm": (900.0, -100.0, 600.0), "surface": surface},
            }
        )
    ).config
    run = run_emulated(config)
    track = [cycle for cycle in run.cycles if cycle.phase == "track"]
    settled = [cycle.force for cycle in track if cycle.sensor_at >= track[0].sensor_at + SETTLED_S]
    return {
        "robot": robot,
        "controller": controller,
        "surface": name,
        "cause": run.result.text,
        "period_ms": statistics.fmean(1e3 * (b.started_at - a.started_at) for a, b in pairwise(track)),
        "rms_n": math.sqrt(statistics.fmean((force - FORCE_N) ** 2 for force in settled))
        if settled
        else None,
        "overshoot_percent": max(0.0, max(100.0 * (cycle.force / FORCE_N - 1.0) for cycle in track)),
        "losses": sum(a.in_contact and not b.in_contact for a, b in pairwise(track)),
    }


def measured() -> list[Mapping[str, Any]]:
    """All runs, one a core at a time."""
    cases = list(product(ROBOTS, CONTROLLERS, SURFACES))
    with own_processes() as pool:
        return in_order(pool, figures_of, cases, lambda count: print(".", end="", flush=True), chunk=1)


def _cell(row: Mapping[str, Any]) -> str:
    if row["cause"]:
        return f"stopped: {row['cause']}"
    lost = f", lost {row['losses']} ×" if row["losses"] else ""
    return f"{row['rms_n']:.2f} N, {row['overshoot_percent']:.0f} %{lost}"


def renewed(text: str, rows: Sequence[Mapping[str, Any]]) -> str:
    """The document with the table of these runs."""
    found = {(row["robot"], row["controller"], row["surface"]): row for row in rows}
    lines = [
        (
            f"`{robot}`",
            f"`{controller}`",
            f"{found[robot, controller, next(iter(SURFACES))]['period_ms']:.0f} ms",
            *(_cell(found[robot, controller, surface]) for surface in SURFACES),
        )
        for robot, controller in product(ROBOTS, CONTROLLERS)
        if (robot, controller, next(iter(SURFACES))) in found
    ]
    return placed(text, {"controllers": table(("robot", "controller", "period", *SURFACES), lines)})


def main() -> int:
    """Measure if wanted, then write or check."""
    options = parser(__doc__ or "")
    options.add_argument("--measure", action="store_true", help="make the runs first")
    chosen = options.parse_args()
    if chosen.measure:
        FIGURES.write_text(json.dumps(measured(), indent=1) + "\n", encoding="utf-8")
    rows = json.loads(FIGURES.read_text(encoding="utf-8"))
    return write(DOCUMENT, lambda text: renewed(text, rows), chosen.check)


if __name__ == "__main__":
    sys.exit(main())
