"""Write two tables of docs/explanation/fidelity.md: runs with the errors of real sensors, and true faults beside them.

With --measure the runs are made first, in virtual time, and their figures go to docs/explanation/sensor-errors.json; it
takes some twenty minutes on two cores.
"""

import gc
import math
import statistics
from collections.abc import Mapping, Sequence
from itertools import product
from typing import Any, NamedTuple

import hil_bridge
from hil_bridge.errors import BridgeError
from hil_bridge.lab.processes import in_order, own_processes
from tools.pages import placed, table

FORCE_N, TRACK_S, SETTLED_S, PERIOD_MS = 10.0, 12.0, 4.0, 20.0
ROBOTS, SENSORS, STIFFNESSES_KN_M = ("rtde", "egm", "rsi"), ("netft", "ft300"), (5, 50)

NONE: Mapping[str, Any] = {"wander_n": 0.0, "creep_share": 0.0, "vibration_n": 0.0, "motion_n": 0.0}
RECORDED: Mapping[str, Any] = {
    "wander_n": 0.05,
    "slope_n_min": (0.05, 0.03, -0.08),
    "creep_share": 0.013,
    "vibration_n": 0.073,
    "motion_n": (0.65, 0.32, 0.21),
}
CB3: Mapping[str, Any] = {**RECORDED, "noise_n": (1.15, 1.10, 0.45), "noise_nm": (0.16, 0.07, 0.04)}
ERRORS: Mapping[str, Mapping[str, Any]] = {"noise alone": NONE, "recorded": RECORDED, "as a CB3": CB3}
"""The largest figures that were recorded on any device, on each sensor; then with the noise of a CB3's own. That one is
run without a zero of the device, which takes a single frame and would be refused.
"""
FAULTS: Mapping[str, Mapping[str, Any]] = {
    "gives noise only on Fz": {"fault": "dead", "with": {"axis": "fz"}},
    "repeats one sample": {"fault": "stuck", "with": {}},
    "tells a tenth of Fz": {"fault": "scale", "with": {"axis": "fz", "factor": 0.1}},
    "drifts by 2 N/s the wrong way": {"fault": "drift", "with": {"axis": "fz", "per_s": 2.0}},
}
FAULT_ROBOTS = ("rtde", "rsi")
"""One with a second witness, one without."""
SEEDS: Mapping[str, Sequence[int]] = {"noise alone": (1,), "recorded": (1, 2), "as a CB3": (1,)}
FAULT_SEED = 1


class Job(NamedTuple):
    """One run."""

    robot: str
    sensor: str
    stiffness_kn_m: int
    errors: str
    seed: int
    fault: str = ""


def jobs() -> list[Job]:
    """All runs."""
    cells = product(ROBOTS, SENSORS, STIFFNESSES_KN_M, ERRORS)
    healthy = [Job(*cell, seed) for cell in cells for seed in SEEDS[cell[-1]]]
    faulty = product(FAULT_ROBOTS, SENSORS[:1], STIFFNESSES_KN_M[:1], ERRORS, (FAULT_SEED,), FAULTS)
    return [*healthy, *(Job(*job) for job in faulty)]


def settings(job: Job) -> Mapping[str, Any]:
    """The settings of a run; all others stand at their defaults."""
    stiffness_n_m = job.stiffness_kn_m * 1e3
    own_noise = {"force_noise_n": (1.0, 1.0, 1.0)} if job.robot == "rtde" and job.errors == "as a CB3" else {}
    fault = {"on": "signal", "phase": "track", "after_s": SETTLED_S, **FAULTS.get(job.fault, {})}
    return {
        "run": {"duration_s": TRACK_S, "seed": job.seed, "period_ms": PERIOD_MS},
        "robot": {"emulated": job.robot},
        "sensor": {"emulated": job.sensor, "tare": job.errors != "as a CB3"},
        "tool": {"mass_kg": 0.5, "centre_of_gravity_mm": (0.0, 0.0, 80.0)},
        "task": {"force_n": FORCE_N, "expected_stiffness_n_m": stiffness_n_m},
        "cell": {
            "surface": {"stiffness_n_m": stiffness_n_m},
            job.sensor: ERRORS[job.errors],
            job.robot: own_noise,
        },
        "faults": [fault] if job.fault else [],
    }


def figures_of(job: Job) -> Mapping[str, Any]:
    """One run: how it ended, the true forces, and its length in the cell's time."""
    try:
        recording = hil_bridge.simulate(settings(job)).recording
    except BridgeError as error:
        return {
            **job._asdict(),
            "cause": str(error).splitlines()[0],
            "rms_n": None,
            "peak_n": 0.0,
            "took_s": 0.0,
        }
    finally:
        gc.collect()  # a cell and its run refer to each other
    begin = next((cycle.started_at for cycle in recording.cycles if cycle.phase == "track"), math.inf)
    end = max((cycle.started_at for cycle in recording.cycles if cycle.phase == "track"), default=-math.inf)
    forces = [(truth.at, math.hypot(*truth.force)) for truth in recording.truths]
    held = [force for at, force in forces if begin + SETTLED_S < at <= end]
    stopped = recording.end["outcome"] == "stopped"
    return {
        **job._asdict(),
        "cause": recording.end["cause"] if stopped else "",
        "rms_n": round(math.sqrt(statistics.fmean((force - FORCE_N) ** 2 for force in held)), 4)
        if held
        else None,
        "peak_n": round(max((force for _, force in forces), default=0.0), 4),
        "took_s": round(_seconds(recording), 4),
    }


def _seconds(recording: Any) -> float:
    """Length of a run in the cell's time, s; 0 for one that was refused."""
    times = [cycle.started_at for cycle in recording.cycles]
    return max(times) - min(times) if times else 0.0


def measure(names: Sequence[str], before: object) -> list[Mapping[str, Any]]:
    """All runs, one a core at a time."""
    with own_processes() as pool:
        return in_order(pool, figures_of, jobs(), lambda count: print(".", end="", flush=True), chunk=1)


def _healthy(rows: Sequence[Mapping[str, Any]]) -> str:
    """A cell of the first table: runs of one robot, sensor and stiffness."""
    stops = [row["cause"] for row in rows if row["cause"]]
    rms = [row["rms_n"] for row in rows if row["rms_n"] is not None]
    mean = f"{statistics.fmean(rms):.2f} N" if rms else "none"
    return mean if not stops else f"{mean}; {len(stops)} × {', '.join(sorted(set(stops)))}"


def _faulty(rows: Sequence[Mapping[str, Any]]) -> str:
    """A cell of the second table: runs of one robot and fault."""
    causes = sorted({row["cause"].replace("-", " ") or "not stopped" for row in rows})
    return f"{max(row['peak_n'] for row in rows):.0f} N, {', '.join(causes)}"


def renewed(document: str, rows: Sequence[Mapping[str, Any]]) -> str:
    """The document with the tables of these runs."""
    healthy = [row for row in rows if not row["fault"]]
    lines = [
        (
            f"`{robot}`",
            f"`{sensor}`",
            f"{stiffness} kN/m",
            *(
                _healthy(
                    [
                        row
                        for row in healthy
                        if (row["robot"], row["sensor"], row["stiffness_kn_m"], row["errors"])
                        == (robot, sensor, stiffness, errors)
                    ]
                )
                for errors in ERRORS
            ),
        )
        for robot, sensor, stiffness in product(ROBOTS, SENSORS, STIFFNESSES_KN_M)
    ]
    totals = []
    for errors in ERRORS:
        of_errors = [row for row in healthy if row["errors"] == errors]
        hours = sum(row["took_s"] for row in of_errors) / 3600.0
        stops = sum(bool(row["cause"]) for row in of_errors)
        totals.append(f"{stops} stops in {60.0 * hours:.0f} min and {len(of_errors)} runs")
    lines.append(("all", "", "", *totals))
    faults = [
        (
            name,
            *(
                _faulty(
                    [
                        row
                        for row in rows
                        if (row["fault"], row["robot"], row["errors"]) == (name, robot, errors)
                    ]
                )
                for robot, errors in product(FAULT_ROBOTS, ERRORS)
            ),
        )
        for name in FAULTS
    ]
    heads = [f"`{robot}`, {errors}" for robot, errors in product(FAULT_ROBOTS, ERRORS)]
    return placed(
        document,
        {
            "sensor-errors": table(("robot", "sensor", "surface", *ERRORS), lines),
            "sensor-faults": table(("the sensor", *heads), faults),
        },
    )
