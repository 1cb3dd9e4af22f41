"""Write the tables of docs/how-to/policies.md: what a policy that was trained without latency loses.

With --measure both policies are trained and judged first, in virtual time, and their figures go to
docs/how-to/policies.json; it takes some ten minutes on two cores.
"""

import sys
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from importlib import import_module
from itertools import pairwise, product
from pathlib import Path
from statistics import fmean
from types import ModuleType
from typing import Any, TypeAlias

from hil_bridge.api import simulate
from hil_bridge.gym import OBSERVED, PolicyController
from hil_bridge.lab.processes import in_order, own_processes
from hil_bridge.record import Outcome
from hil_bridge.runs.setup import Setup
from hil_bridge.settings.given import config_of
from tools.pages import placed, table

ROOT = Path(__file__).resolve().parent.parent
EXAMPLE = ROOT / "examples" / "policy" / "train.py"
GENERATIONS = 10
FORCE_N, TRACK_S, STIFFNESS_N_M = 10.0, 4.0, 1e4
SEEDS = (101, 102, 103)
"""Seeds of the runs that judge; no episode of the training has one of them."""
ROBOTS: Mapping[str, str] = {"s3": "jr3", "egm": "netft", "rtde": "netft"}
"""Robots, each with the sensor that it runs with."""
LATE = {"fault": "late", "phase": "track"}
CONDITIONS: Mapping[str, Sequence[Mapping[str, Any]]] = {
    "no fault": [],
    "robot's wire 20 ms late": [{**LATE, "on": "wire", "with": {"ms": 20.0}}],
    "force 40 ms late": [{**LATE, "on": "sensor-wire", "with": {"ms": 40.0}}],
}
"""Faults from the first contact on."""
CONTROLLERS: Mapping[str, str] = {
    "none": "trained without latency",
    "drawn": "trained with drawn latency",
    "pi": "`pi`, for comparison",
}
Case: TypeAlias = tuple[str, str, str, int]
"""Robot, condition, controller, seed."""
Row: TypeAlias = Mapping[str, Any]


@cache
def example() -> ModuleType:
    """The script of the how-to."""
    sys.path.append(str(EXAMPLE.parent))  # the processes of a search find it there too
    return import_module(EXAMPLE.stem)


def judge(job: tuple[Case, Sequence[float]]) -> Row:
    """One run with a policy's weights; without any it is that of the controller `pi`."""
    (robot, condition, name, seed), weights = job
    chosen = PolicyController(example().linear(weights)) if weights else None
    near = example().NEAR
    config = config_of(
        {
            **near,
            "run": {"duration_s": TRACK_S},
            "robot": {"emulated": robot},
            "sensor": {"emulated": ROBOTS[robot]},
            "controller": {"name": "pi"},
            "cell": {**near["cell"], "surface": {"stiffness_n_m": STIFFNESS_N_M}},
        },
        CONDITIONS[condition],
        chosen,
        seed,
    )
    run = simulate(Setup(config).config)
    track = [cycle for cycle in run.cycles if cycle.phase == "track"]
    forces = [cycle.force for cycle in track]
    return {
        "robot": robot,
        "condition": condition,
        "controller": name,
        "seed": seed,
        "rms_n": fmean((force - FORCE_N) ** 2 for force in forces) ** 0.5 if forces else None,
        "overshoot_percent": max(0.0, *(100.0 * (force / FORCE_N - 1.0) for force in forces))
        if forces
        else None,
        "stopped": run.outcome is Outcome.STOPPED,
        "cause": "" if run.cause is None else str(run.cause),
        "losses": sum(a.in_contact and not b.in_contact for a, b in pairwise(track)),
    }


def measure(names: Sequence[str], before: object) -> Mapping[str, Any]:
    """Both policies trained, and all runs that judge them."""
    train = example()
    weights: dict[str, list[float]] = {
        name: train.train(name, GENERATIONS, lambda text, name=name: print(f"{name}: {text}", flush=True))
        for name in train.LATENCY
    }
    cases = list(product(ROBOTS, CONDITIONS, CONTROLLERS, SEEDS))
    with own_processes() as pool:
        jobs = [(case, weights.get(case[2], [])) for case in cases]
        rows = in_order(pool, judge, jobs, lambda count: print(".", end="", flush=True), chunk=1)
    return {"weights": weights, "rows": rows}


def _cell(rows: Sequence[Row]) -> str:
    """The mean of the runs with all seeds in a few words."""
    known = [row for row in rows if row["rms_n"] is not None]
    stops = sum(row["stopped"] for row in rows)
    told = f", stopped {stops} of {len(rows)}" if stops else ""
    if not known:
        return f"never touched{told}"
    rms, overshoot = (fmean(row[key] for row in known) for key in ("rms_n", "overshoot_percent"))
    lost = sum(row["losses"] for row in rows)
    away = f", lost {lost} ×" if lost else ""
    return f"{rms:.2f} N, {overshoot:.0f} %{told}{away}"


def _rows(figures: Mapping[str, Any]) -> Iterable[Sequence[str]]:
    for robot, condition in product(ROBOTS, CONDITIONS):
        chosen = [row for row in figures["rows"] if (row["robot"], row["condition"]) == (robot, condition)]
        yield (
            f"`{robot}`",
            condition,
            *(_cell([row for row in chosen if row["controller"] == name]) for name in CONTROLLERS),
        )


def renewed(text: str, figures: Mapping[str, Any]) -> str:
    """The document with the tables of these figures, and that of the observation."""
    weights = [
        (CONTROLLERS[name], *(f"{weight:g}" for weight in one)) for name, one in figures["weights"].items()
    ]
    contents = {
        "policies": table(("robot", "condition", *CONTROLLERS.values()), _rows(figures)),
        "weights": table(("policy", "error, per 10 N", "rate, per 100 N/s", "ahead, per mm"), weights),
        "observation": table(
            ("name", "range", "meaning"),
            [(f"`{one.name}`", f"{one.low:g} … {one.high:g}", one.meaning) for one in OBSERVED],
        ),
    }
    return placed(
        text, {name: content for name, content in contents.items() if f"<!-- {name}: begin" in text}
    )
