"""Tables of docs/explanation/fidelity.md: runs with the errors of real sensors, and with faults in addition to the
errors.

The runs use virtual time; they take about twenty minutes on two cores.
"""

import gc
import math
import statistics
from collections.abc import Mapping, Sequence
from itertools import product
from typing import Any, NamedTuple

import hil_bridge
from hil_bridge.errors import BridgeError
from tools.pages import run_jobs, table, where

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
"""Settings of the errors, by kind: white noise alone, the largest values recorded on any device, and these values
with the noise of a CB3's own sensor. The last kind is run without zeroing the device: zeroing uses a single frame
and would be refused.
"""
FAULTS: Mapping[str, Mapping[str, Any]] = {
    "gives noise only on Fz": {"fault": "dead", "with": {"axis": "fz"}},
    "repeats one sample": {"fault": "stuck", "with": {}},
    "reports a tenth of Fz": {"fault": "scale", "with": {"axis": "fz", "factor": 0.1}},
    "drifts by 2 N/s the wrong way": {"fault": "drift", "with": {"axis": "fz", "per_s": 2.0}},
}
FAULT_ROBOTS = ("rtde", "rsi")
"""Two robots: one with a second witness, and one without."""
SEEDS: Mapping[str, Sequence[int]] = {"noise alone": (1,), "recorded": (1, 2), "as a CB3": (1,)}
FAULT_SEED = 1


class Job(NamedTuple):
    """Run with one kind of errors."""

    robot: str
    sensor: str
    stiffness_kn_m: int
    errors: str
    seed: int
    fault: str = ""


def jobs() -> list[Job]:
    """Yield all runs."""
    cells = product(ROBOTS, SENSORS, STIFFNESSES_KN_M, ERRORS)
    healthy = [
        Job(robot, sensor, stiffness, errors, seed)
        for robot, sensor, stiffness, errors in cells
        for seed in SEEDS[errors]
    ]
    faulty = product(FAULT_ROBOTS, SENSORS[:1], STIFFNESSES_KN_M[:1], ERRORS, (FAULT_SEED,), FAULTS)
    return [*healthy, *(Job(*job) for job in faulty)]


def settings(job: Job) -> Mapping[str, Any]:
    """Return the settings of a run that differ from their defaults."""
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
    """Make one run. Return its outcome, the true forces, and its duration in the cell's time."""
    try:
        recording = hil_bridge.simulate(settings(job)).recording
    except BridgeError as error:
        refused = {"cause": str(error).splitlines()[0], "rms_n": None, "peak_n": 0.0, "took_s": 0.0}
        return {**job._asdict(), **refused}
    finally:
        gc.collect()  # a cell and its run reference each other
    times = [cycle.started_at for cycle in recording.cycles] or [0.0]
    track = [cycle.started_at for cycle in recording.cycles if cycle.phase == "track"] or [math.inf]
    forces = [(truth.at, math.hypot(*truth.force)) for truth in recording.truths]
    errors = [force - FORCE_N for at, force in forces if track[0] + SETTLED_S < at <= track[-1]]
    return {
        **job._asdict(),
        "cause": recording.end["cause"] if recording.end["outcome"] == "stopped" else "",
        "rms_n": round(statistics.fmean(error**2 for error in errors) ** 0.5, 4) if errors else None,
        "peak_n": round(max((force for _, force in forces), default=0.0), 4),
        "took_s": round(times[-1] - times[0], 4),
    }


def measure(names: Sequence[str], before: object) -> list[Mapping[str, Any]]:
    """Make all runs."""
    return run_jobs(figures_of, jobs())


def errors_table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return the table of the largest RMS error of each robot with each kind of errors, and the number of stopped
    runs.
    """
    healthy = where(rows, fault="")
    lines = [
        (f"`{robot}`", *(_largest(where(healthy, robot=robot, errors=errors)) for errors in ERRORS))
        for robot in ROBOTS
    ]
    totals = (_total(where(healthy, errors=errors)) for errors in ERRORS)
    return table(("robot", *ERRORS), [*lines, ("all", *totals)])


def _largest(rows: Sequence[Mapping[str, Any]]) -> str:
    rms = [row["rms_n"] for row in rows if row["rms_n"] is not None]
    return f"{max(rms):.2f} N" if rms else "none"


def _total(rows: Sequence[Mapping[str, Any]]) -> str:
    stops, minutes = sum(bool(row["cause"]) for row in rows), sum(row["took_s"] for row in rows) / 60.0
    return f"{stops} stops in {minutes:.0f} min and {len(rows)} runs"


def faults_table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return the table with a row for each fault, and a column for each robot and kind of errors."""
    columns = list(product(FAULT_ROBOTS, ERRORS))
    lines = [
        (fault, *(_faulty(where(rows, fault=fault, robot=robot, errors=errors)) for robot, errors in columns))
        for fault in FAULTS
    ]
    return table(("the sensor", *(f"`{robot}`, {errors}" for robot, errors in columns)), lines)


def _faulty(rows: Sequence[Mapping[str, Any]]) -> str:
    causes = sorted({row["cause"].replace("-", " ") or "not stopped" for row in rows})
    return f"{max(row['peak_n'] for row in rows):.0f} N, {', '.join(causes)}"


TABLES = {"sensor-errors": errors_table, "sensor-faults": faults_table}
