"""Tables of docs/explanation/streaming.md: each controller on each robot and surface, the first touch, and arms.

Surfaces are soft, hard and curved. The first touch is on a surface of unknown stiffness. The runs use virtual time;
they take about half an hour on two cores. `--measure egm` makes only the runs of this robot.
"""

import statistics
from collections.abc import Mapping, Sequence
from itertools import pairwise, product
from typing import Any, NamedTuple

from hil_bridge.api import simulate
from hil_bridge.control import CONTROLLERS
from hil_bridge.runs.setup import Setup
from hil_bridge.settings.configuration import read_config
from tools.pages import run_jobs, table

ROBOTS: Mapping[str, str] = {"s3": "jr3", "egm": "netft", "rtde": "netft", "rsi": "netft"}
"""Robots, each with the sensor that is used with it."""
FORCE_N = 10.0
TRACK_S, SETTLED_S = 8.0, 2.0
"""Tracking time, and time at its start that does not count for the error, s."""
CURVED = {"kind": "sinusoidal", "amplitude_mm": 3.0, "period_mm": 150.0, "origin_y_mm": -100.0}
SHAPES: Mapping[str, Mapping[str, Any]] = {"level": {}, "curved": CURVED}
STIFFNESSES_KN_M, TOUCHED_KN_M = (5, 50), (5, 20, 50)
ARMS: Mapping[str, Mapping[str, Any]] = {
    "rigid arm": {"arm": {"compliance": "rigid"}},
    "compliant arm": {},
    "with a spindle": {"tool": {"spindle_rpm": 10_000.0}, "netft": {"filter": 6}},
}
"""Arms and tools in the table of arms, each with the settings of the cell. Without settings, the arm is compliant. The
Net F/T's filter of 18 Hz is for the zero, which is refused while the force changes too much.
"""
ARM_CONTROLLERS = ("pi", "admittance", "predictive")
TOUCHES: Mapping[str, tuple[str, Mapping[str, float]]] = {
    **{robot: (robot, {}) for robot in ROBOTS},
    "rtde, an arm on its targets": ("rtde", {"follow_error_urad": 0.0, "fast_follow_error_urad": 0.0}),
}
"""Robots in the table of touches, each with the settings of its emulator."""
SPEEDS_MM_S = (2.75, 10.0)
"""Maximum speeds of the approach: the default one and a fast one."""
HARDEST_N_M = 5e4
"""Largest stiffness that the task expects, N/m. The surface has this stiffness, or is softer."""
TOUCH_S, TOUCHED_S = 2.5, 1.0
"""Tracking time of a touch, and time at its start that does not count for the error, s."""


def surfaces(stiffnesses_kn_m: Sequence[int]) -> Mapping[str, Mapping[str, Any]]:
    """Return the settings of a flat and a curved surface for each stiffness, by name."""
    return {
        f"{shape}, {stiffness} kN/m": {"stiffness_n_m": stiffness * 1e3, **how}
        for shape, how in SHAPES.items()
        for stiffness in stiffnesses_kn_m
    }


SURFACES, TOUCHED = surfaces(STIFFNESSES_KN_M), surfaces(TOUCHED_KN_M)
LEVEL = {name: surface for name, surface in TOUCHED.items() if "kind" not in surface}


class Case(NamedTuple):
    """Run of a table."""

    robot: str
    """Key of ROBOTS or TOUCHES."""
    controller: str
    surface: Mapping[str, Any]
    expected_n_m: float
    approach_mm_s: float = SPEEDS_MM_S[0]
    track_s: float = TRACK_S
    settled_s: float = SETTLED_S
    arm: str = "compliant arm"
    """Key of ARMS."""


def figures_of(case: Case) -> Mapping[str, Any]:
    """Make one run."""
    robot, errors = TOUCHES[case.robot]
    cell = {"start_position_mm": (900.0, -100.0, 600.0), "surface": case.surface, **ARMS[case.arm]}
    values = {
        "run": {"duration_s": case.track_s, "seed": 1},
        "robot": {"emulated": robot},
        "sensor": {"emulated": ROBOTS[robot]},
        "controller": {"name": case.controller},
        "frame": {"follow_normal": "kind" in case.surface},
        "task": {"expected_stiffness_n_m": case.expected_n_m, "approach_speed_mm_s": case.approach_mm_s},
        "cell": {**cell, robot: errors} if errors else cell,
    }
    run = simulate(Setup(read_config(values)).config)
    track = [cycle for cycle in run.cycles if cycle.phase == "track"]
    if not track:
        raise RuntimeError(f"{case}: {run.text}")
    begin = track[0].sample.sensor_at + case.settled_s
    settled = [cycle.force - FORCE_N for cycle in track if cycle.sample.sensor_at >= begin]
    return {
        "cause": run.text,
        "period_ms": statistics.fmean(1e3 * (b.started_at - a.started_at) for a, b in pairwise(track)),
        "rms_n": statistics.fmean(error**2 for error in settled) ** 0.5 if settled else None,
        "overshoot_percent": max(0.0, max(100.0 * (cycle.force / FORCE_N - 1.0) for cycle in track)),
        "losses": sum(a.in_contact and not b.in_contact for a, b in pairwise(track)),
    }


def measure(names: Sequence[str], before: Mapping[str, Any]) -> dict[str, Any]:
    """Make the runs with these robots, or with all robots if none is named. Rows of other robots are kept."""
    robots = names or list(ROBOTS)
    kept_rows = {
        (robot, controller, name): Case(robot, controller, surface, surface["stiffness_n_m"])
        for robot, controller, (name, surface) in product(robots, CONTROLLERS, SURFACES.items())
    }
    touched = {
        (robot, speed, name): Case(robot, "predictive", surface, HARDEST_N_M, speed, TOUCH_S, TOUCHED_S)
        for robot, speed, (name, surface) in product(TOUCHES, SPEEDS_MM_S, TOUCHED.items())
        if TOUCHES[robot][0] in robots
    }
    arms = {
        (robot, controller, arm, name): Case(robot, controller, surface, surface["stiffness_n_m"], arm=arm)
        for robot, controller, arm, (name, surface) in product(robots, ARM_CONTROLLERS, ARMS, LEVEL.items())
    }
    rows = iter(run_jobs(figures_of, [*kept_rows.values(), *touched.values(), *arms.values()]))
    again = {
        "controllers": [{"robot": r, "controller": c, "surface": s, **next(rows)} for r, c, s in kept_rows],
        "touch": [{"robot": r, "approach_mm_s": v, "surface": s, **next(rows)} for r, v, s in touched],
        "arms": [{"robot": r, "controller": c, "arm": a, "surface": s, **next(rows)} for r, c, a, s in arms],
    }
    return {
        name: list({_key(row): row for row in (*before.get(name, ()), *fresh)}.values())
        for name, fresh in again.items()
    }


def _key(row: Mapping[str, Any]) -> tuple[Any, ...]:
    return row["robot"], row.get("controller") or row["approach_mm_s"], row.get("arm"), row["surface"]


def _cell(row: Mapping[str, Any]) -> str:
    if row["cause"]:
        return f"stopped: {row['cause']}"
    lost = f", lost {row['losses']} ×" if row["losses"] else ""
    return f"{row['rms_n']:.2f} N, {row['overshoot_percent']:.0f} %{lost}"


def controllers_table(figures: Mapping[str, Sequence[Mapping[str, Any]]]) -> str:
    """Return the table with a row for each robot and controller, and a column for each surface."""
    known = {_key(row): row for row in figures["controllers"]}
    lines = []
    for robot, controller in dict.fromkeys(key[:2] for key in known):
        rows = [known[robot, controller, None, surface] for surface in SURFACES]
        period = f"{rows[0]['period_ms']:.0f} ms"
        lines.append((f"`{robot}`", f"`{controller}`", period, *map(_cell, rows)))
    return table(("robot", "controller", "period", *SURFACES), lines)


def touch_table(figures: Mapping[str, Sequence[Mapping[str, Any]]]) -> str:
    """Return the table with a row for each robot and approach speed, and a column for each surface."""
    known = {_key(row): row for row in figures["touch"]}
    lines = (
        (f"`{robot}`", f"{speed:g} mm/s", *(_cell(known[robot, speed, None, surface]) for surface in TOUCHED))
        for robot, speed in dict.fromkeys(key[:2] for key in known)
    )
    return table(("robot", "approach", *TOUCHED), lines)


def arms_table(figures: Mapping[str, Sequence[Mapping[str, Any]]]) -> str:
    """Return the table with a row for each robot, controller and arm, and a column for each level surface."""
    known = {_key(row): row for row in figures["arms"]}
    lines = (
        (f"`{robot}`", f"`{name}`", arm, *(_cell(known[robot, name, arm, surface]) for surface in LEVEL))
        for robot, name, arm in dict.fromkeys(key[:3] for key in known)
    )
    return table(("robot", "controller", "arm", *LEVEL), lines)


TABLES = {"controllers": controllers_table, "touch": touch_table, "arms": arms_table}
