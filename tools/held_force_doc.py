"""Write a table of docs/reference/rtde.md: our controllers over RTDE, on the surfaces of the maker's controller.

With --measure the runs are made first, in virtual time, and their figures go to docs/reference/held-force.json; it
takes some four minutes.
"""

import math
import statistics
from collections.abc import Mapping, Sequence
from itertools import product
from typing import Any

import hil_bridge
from hil_bridge.control import CONTROLLERS
from hil_bridge.lab.processes import in_order, own_processes
from hil_bridge.record.analysis.latency import latency_of
from tools.pages import placed, table

FORCE_N, RISEN_N = 10.0, 9.0
TRACK_S, HELD_S = 8.0, 2.0
"""Time of tracking, and the end of it that counts for mean and RMS, s."""
STIFFNESSES_KN_M = (5, 50)
SENSORS: Mapping[str, Mapping[str, Any]] = {"as the arm": {"filter": 6, "rate_hz": 125}, "Net F/T": {}}
"""Settings of a Net F/T: the delay of the arm's own force, a filter of 9 ms and a value each 8 ms, and its own."""


def settings(case: tuple[str, str, int]) -> dict[str, Any]:
    """A run that stands 2 mm above a level surface, touches it, and holds the force there."""
    controller, sensor, stiffness_kn_m = case
    stiffness_n_m = stiffness_kn_m * 1e3
    return {
        "run": {"duration_s": TRACK_S, "seed": 1},
        "robot": {"emulated": "rtde"},
        "sensor": {"emulated": "netft"},
        "controller": {"name": controller},
        "task": {"force_n": FORCE_N, "speed_mm_s": 0.0, "expected_stiffness_n_m": stiffness_n_m},
        "cell": {
            "start_position_mm": [900.0, -100.0, 600.0],
            "surface": {"stiffness_n_m": stiffness_n_m},
            "netft": SENSORS[sensor],
        },
    }


def figures_of(case: tuple[str, str, int]) -> Mapping[str, Any]:
    """One run: controller, sensor, stiffness. All forces are true ones."""
    recording = hil_bridge.simulate(settings(case)).recording
    end = max(cycle.started_at for cycle in recording.cycles if cycle.phase == "track")
    forces = [(truth.at, math.hypot(*truth.force)) for truth in recording.truths if truth.at <= end]
    touched = next(at for at, force in forces if force > 0.0)
    risen = next((at for at, force in forces if force >= RISEN_N), None)
    held = [force for at, force in forces if at > end - HELD_S]
    mean, latency = statistics.fmean(held), latency_of(recording)
    return {
        "controller": case[0],
        "sensor": case[1],
        "stiffness_kn_m": case[2],
        "cause": recording.end["cause"] if recording.end["outcome"] == "stopped" else "",
        "mean_n": mean,
        "rms_n": math.sqrt(statistics.fmean((force - mean) ** 2 for force in held)),
        "peak_n": max(force for _, force in forces),
        "rise_ms": None if risen is None else 1e3 * (risen - touched),
        "lag_ms": 1e3 * latency.total.p50_s if latency else None,
    }


def measure(names: Sequence[str], before: object) -> list[Mapping[str, Any]]:
    """All runs, one a core at a time."""
    cases = list(product(CONTROLLERS, SENSORS, STIFFNESSES_KN_M))
    with own_processes() as pool:
        return in_order(pool, figures_of, cases, lambda count: print(".", end="", flush=True), chunk=1)


def _cell(row: Mapping[str, Any]) -> str:
    rise = "none" if row["rise_ms"] is None else f"{row['rise_ms']:.0f} ms"
    if row["cause"]:
        return f"stopped, {row['cause'].replace('-', ' ')}: peak {row['peak_n']:.1f} N"
    return f"{row['mean_n']:.1f} N, {row['rms_n']:.1f} N, {row['peak_n']:.1f} N, {rise}"


def renewed(document: str, rows: Sequence[Mapping[str, Any]]) -> str:
    """The document with the table of these runs."""
    row_of = {(row["controller"], row["sensor"], row["stiffness_kn_m"]): row for row in rows}
    lines = [
        (
            f"`{controller}`",
            sensor,
            *(_cell(row_of[controller, sensor, stiffness]) for stiffness in STIFFNESSES_KN_M),
            f"{row_of[controller, sensor, STIFFNESSES_KN_M[0]]['lag_ms']:.0f} ms",
        )
        for controller, sensor in product(CONTROLLERS, SENSORS)
    ]
    heads = [f"{stiffness} kN/m: mean, RMS, peak, rise to 9 N" for stiffness in STIFFNESSES_KN_M]
    return placed(document, {"held": table(("controller", "sensor", *heads, "lag"), lines)})
