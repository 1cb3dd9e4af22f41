"""Write the tables of docs/explanation/streaming.md: each controller on each robot, on soft, hard, curved surfaces, and
the first touch of a surface of unknown stiffness.

With --measure the runs are made first, in virtual time, and their figures go to docs/explanation/streaming.json; it
takes some fifteen minutes.
"""

import math
import statistics
from collections.abc import Mapping, Sequence
from itertools import pairwise, product
from typing import Any, NamedTuple

from emulators.devices.rtde.profile import RtdeProfile
from hil_bridge.api import simulate
from hil_bridge.control import CONTROLLERS
from hil_bridge.lab.processes import in_order, own_processes
from hil_bridge.runs.setup import Setup
from hil_bridge.settings.configuration import read_config
from tools.arm_error import left_over
from tools.pages import placed, table

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
STIFFNESSES = (5e3, 2e4, 5e4)
TOUCHED: Mapping[str, Mapping[str, Any]] = {
    f"{shape}, {stiffness / 1e3:g} kN/m": {"stiffness_n_m": stiffness, **how}
    for shape, how in (("level", {}), ("curved", CURVED))
    for stiffness in STIFFNESSES
}


TOUCHES: Mapping[str, tuple[str, Mapping[str, float]]] = {
    **{robot: (robot, {}) for robot in ROBOTS},
    "rtde, an arm on its targets": ("rtde", {"follow_error_urad": 0.0, "fast_follow_error_urad": 0.0}),
}
"""Robots of the table of touches, each with settings of its emulator."""
SPEEDS_MM_S = (2.75, 10.0)
"""Largest speeds of the approach: the default one and a quick one."""
HARDEST_N_M = 5e4
"""Stiffness that the task expects at most; the surface has it, or is softer."""
TOUCH_S, TOUCHED_S = 2.5, 1.0
"""Time of tracking, and the begin of it that does not count for the error, s."""


ORDER_S = 0.036
"""Time of an order of a Universal Robot: the lag of its servo and one cycle, s."""
BOUNDS = ("held for the next order", "forecast at best")


class Case(NamedTuple):
    """One run."""

    robot: str
    """Of ROBOTS or TOUCHES."""
    controller: str
    surface: Mapping[str, Any]
    expected_n_m: float
    approach_mm_s: float = SPEEDS_MM_S[0]
    track_s: float = TRACK_S
    settled_s: float = SETTLED_S


def figures_of(case: Case) -> Mapping[str, Any]:
    """One run."""
    robot, errors = TOUCHES[case.robot]
    config = Setup(
        read_config(
            {
                "run": {"duration_s": case.track_s, "seed": 1},
                "robot": {"emulated": robot},
                "sensor": {"emulated": ROBOTS[robot]},
                "controller": {"name": case.controller},
                "frame": {"follow_normal": "kind" in case.surface},
                "task": {
                    "expected_stiffness_n_m": case.expected_n_m,
                    "approach_speed_mm_s": case.approach_mm_s,
                },
                "cell": {
                    "start_position_mm": (900.0, -100.0, 600.0),
                    "surface": case.surface,
                    **({robot: errors} if errors else {}),
                },
            }
        )
    ).config
    run = simulate(config)
    track = [cycle for cycle in run.cycles if cycle.phase == "track"]
    settled = [
        cycle.force for cycle in track if cycle.sample.sensor_at >= track[0].sensor_at + case.settled_s
    ]
    return {
        "cause": run.text,
        "period_ms": statistics.fmean(1e3 * (b.started_at - a.started_at) for a, b in pairwise(track)),
        "rms_n": math.sqrt(statistics.fmean((force - FORCE_N) ** 2 for force in settled))
        if settled
        else None,
        "overshoot_percent": max(0.0, max(100.0 * (cycle.force / FORCE_N - 1.0) for cycle in track)),
        "losses": sum(a.in_contact and not b.in_contact for a, b in pairwise(track)),
    }


def measured(robots: Sequence[str]) -> dict[str, list[Mapping[str, Any]]]:
    """The runs of each table with these robots, one a core at a time."""
    held = {
        (robot, controller, name): Case(robot, controller, surface, surface["stiffness_n_m"])
        for robot, controller, (name, surface) in product(robots, CONTROLLERS, SURFACES.items())
    }
    touched = {
        (robot, speed, name): Case(robot, "predictive", surface, HARDEST_N_M, speed, TOUCH_S, TOUCHED_S)
        for robot, speed, (name, surface) in product(TOUCHES, SPEEDS_MM_S, TOUCHED.items())
        if TOUCHES[robot][0] in robots
    }
    cases = [*held.values(), *touched.values()]
    with own_processes() as pool:
        found = in_order(pool, figures_of, cases, lambda count: print(".", end="", flush=True), chunk=1)
    rows = iter(found)
    bound = [left._asdict() for left in left_over(RtdeProfile(), ORDER_S)] if "rtde" in robots else []
    return {
        "controllers": [{"robot": r, "controller": c, "surface": s, **next(rows)} for r, c, s in held],
        "touch": [{"robot": r, "approach_mm_s": v, "surface": s, **next(rows)} for r, v, s in touched],
        "bound": [
            {"robot": f"rtde, {how}", "surface": "", **left} for how, left in zip(BOUNDS, bound, strict=False)
        ],
    }


def _key(row: Mapping[str, Any]) -> tuple[Any, ...]:
    return row["robot"], row.get("controller"), row.get("approach_mm_s"), row["surface"]


def _cell(row: Mapping[str, Any]) -> str:
    if row["cause"]:
        return f"stopped: {row['cause']}"
    lost = f", lost {row['losses']} ×" if row["losses"] else ""
    return f"{row['rms_n']:.2f} N, {row['overshoot_percent']:.0f} %{lost}"


def _touch_lines(rows: Sequence[Mapping[str, Any]]) -> list[tuple[str, ...]]:
    found = {(row["robot"], row["approach_mm_s"], row["surface"]): row for row in rows}
    return [
        (f"`{robot}`", f"{speed:g} mm/s", *(_cell(found[robot, speed, surface]) for surface in TOUCHED))
        for robot, speed in dict.fromkeys((row["robot"], row["approach_mm_s"]) for row in rows)
    ]


def _bound_lines(rows: Sequence[Mapping[str, Any]]) -> list[tuple[str, ...]]:
    return [
        (
            how,
            *(f"{k * row['rms']:.2f} N, {100 * k * row['peak'] / FORCE_N:.0f} %" for k in STIFFNESSES),
        )
        for how, row in zip(BOUNDS, rows, strict=True)
    ]


def renewed(text: str, figures: Mapping[str, Sequence[Mapping[str, Any]]]) -> str:
    """The document with the tables of these runs."""
    found = {(row["robot"], row["controller"], row["surface"]): row for row in figures["controllers"]}
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
    tables = {
        "controllers": table(("robot", "controller", "period", *SURFACES), lines),
        "touch": table(("robot", "approach", *TOUCHED), _touch_lines(figures["touch"])),
        "bound": table(
            ("error of the arm", *(f"{k / 1e3:g} kN/m" for k in STIFFNESSES)), _bound_lines(figures["bound"])
        ),
    }
    return placed(text, tables)


def measure(names: Sequence[str], before: Mapping[str, Any]) -> dict[str, Any]:
    """Make the runs with these robots, with all where none is named; rows of others are kept."""
    figures = dict(before)
    for name, rows in measured(names or list(ROBOTS)).items():
        figures[name] = list({_key(row): row for row in (*figures.get(name, ()), *rows)}.values())
    return figures
