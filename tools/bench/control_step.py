"""Duration of a control step: compensation, controller and supervisor on samples of a simulated run, and one rule
evaluation.
"""

import random
import time
from collections.abc import Callable
from typing import Any

from hil_bridge.api import simulate
from hil_bridge.control.laws.fuzzy import infer
from hil_bridge.record import CycleRecord
from hil_bridge.runs.setup import Setup
from hil_bridge.runs.zeroing import wrist
from hil_bridge.settings.configuration import Config, read_config
from tools.bench.figures import Figure, Report, Spread, Target

TRACK_S = 20.0
ROUNDS = 20
TURNS = 10
PAUSE_S = 0.3
"""Pause between two turns, s. It makes the turns cover fast and slow phases of the machine."""
CONTROLLERS: dict[str, dict[str, Any]] = {
    "predictive (the default)": {"name": "predictive"},
    "fuzzy-adaptive, the paper's table": {"name": "fuzzy-adaptive"},
    "fuzzy-adaptive, continuous surface": {"name": "fuzzy-adaptive", "parameters": {"surface": "continuous"}},
}
INPUTS = 200
MICRO = 1e-3
"""Factor that converts ns to µs."""
STEP = Target("value", 30.0)


def record_run(controller: dict[str, Any]) -> tuple[Config, tuple[CycleRecord, ...]]:
    """Return the configuration and the cycles of a run of the emulated cell with this controller."""
    config = read_config({"run": {"duration_s": TRACK_S, "seed": 3}, "controller": controller})
    return config, simulate(config).cycles


def steps_us(config: Config, cycles: tuple[CycleRecord, ...]) -> list[float]:
    """Return the times that the decisions of the run take when they are computed again, µs.

    A decision covers the compensation of the newest and of the paired wrench, their forces along the task's
    directions, the controller, and the supervisor.
    """
    compensation, loop = wrist(config), Setup(config).loop
    frame = config.frame
    directions = frame.approach, frame.travel, frame.across
    times = []
    turned, at_orientation = None, None
    for _ in range(ROUNDS):
        state = loop.initial((cycles[0].start[0], cycles[0].start[1], cycles[0].start[2]))
        for record in cycles:
            if record.asked:
                state = loop.finish(state, record.asked)
            sample, quaternion = record.sample, record.sample.quaternion
            began = time.perf_counter_ns()
            if at_orientation is None or turned != quaternion:  # only if the tool has rotated, as in a run
                turned, at_orientation = (
                    quaternion,
                    compensation.at_orientation(quaternion, quaternion, *directions),
                )
            wrench = at_orientation.contact_wrench(sample.wrench)
            for number in range(len(directions)):
                at_orientation.force_along(number, wrench)
            at_orientation.force_along(0, at_orientation.contact_force(sample.wrench))
            state, _ = loop.step(state, sample)
            times.append((time.perf_counter_ns() - began) * MICRO)
    return times


def measure(report_step: Callable[[str], None]) -> Report:
    """Measure one evaluation of the rules, then complete decisions."""
    draw = random.Random(1)
    inputs = [(draw.uniform(-6.0, 6.0), draw.uniform(-6.0, 6.0)) for _ in range(INPUTS)]
    report_step("one evaluation of the rules")
    times = []
    for _ in range(ROUNDS):
        for pair in inputs:
            began = time.perf_counter_ns()
            infer(*pair)
            times.append((time.perf_counter_ns() - began) * MICRO)
    figures = [Figure("one evaluation of the rules, p50", Spread(times).p50, "µs")]
    report_step("decisions of a run with each controller")
    runs = {title: record_run(controller) for title, controller in CONTROLLERS.items()}
    spreads: dict[str, list[Spread]] = {title: [] for title in runs}
    for turn in range(TURNS):
        report_step(f"turn {turn + 1} of {TURNS}")
        for title, run in runs.items():
            spreads[title].append(Spread(steps_us(*run)))
        time.sleep(PAUSE_S)
    for title in runs:
        ordered = sorted(spreads[title], key=lambda spread: spread.p50)
        best, usual = ordered[0], ordered[TURNS // 2]
        figures.append(Figure(f"whole step, {title}, p50, best turn", best.p50, "µs", target=STEP))
        figures.append(Figure(f"whole step, {title}, p99, best turn", best.p99, "µs"))
        figures.append(Figure(f"whole step, {title}, p50, median turn", usual.p50, "µs"))
    return Report(tuple(figures))
