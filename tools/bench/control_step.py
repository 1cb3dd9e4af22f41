"""Control step: compensation, controller and supervisor on samples of a simulated run, beside fuzzy libraries.

The libraries evaluate the paper's rule base once; ours is timed with everything else that a cycle decides.
"""

import json
import random
import subprocess
import time
import venv
from collections.abc import Callable
from pathlib import Path
from typing import Any

from hil_bridge.control.laws.fuzzy import infer
from hil_bridge.control.laws.rules import PAPER_RULES
from hil_bridge.experiments.chain import run_cell
from hil_bridge.recording import CycleRecord
from hil_bridge.runs.cycle import control_loop
from hil_bridge.runs.zeroing import wrist
from hil_bridge.settings.configuration import Config
from tools.bench.figures import Figure, Report, Spread, Target
from tools.bench.machine import CACHE
from tools.bench.sampler import costs, sampled

LIBRARIES = ("scikit-fuzzy", "simpful")
NEEDED = (*LIBRARIES, "networkx", "packaging")
"""The last two are imported by the first, which does not say so."""
TRACK_S = 20.0
ROUNDS = 20
TURNS = 10
PAUSE_S = 0.3
"""Between two turns, so that they meet fast and slow moments of the machine."""
CONTROLLERS: dict[str, dict[str, Any]] = {
    "predictive (the default)": {"name": "predictive"},
    "fuzzy-adaptive, the paper's table": {"name": "fuzzy-adaptive"},
    "fuzzy-adaptive, continuous surface": {"name": "fuzzy-adaptive", "parameters": {"surface": "continuous"}},
}
INPUTS = 200
TOLERANCE = 1e-9
"""Levels. Between our answer and a library's."""
MICRO = 1e-3
"""µs in a ns."""
STEP = Target("value", 30.0)
FASTER = Target("ratio", 1 / 30)


class LibrariesMissing(Exception):
    """The libraries cannot be had; the text says why."""


def recorded(controller: dict[str, Any]) -> tuple[Config, tuple[CycleRecord, ...]]:
    """A run of the emulated cell with this controller, and its cycles."""
    config = Config.model_validate({"run": {"duration_s": TRACK_S, "seed": 3}, "controller": controller})
    return config, run_cell(config).cycles


def steps_us(config: Config, cycles: tuple[CycleRecord, ...]) -> list[float]:
    """What each decision of the run takes when it is taken again, µs: compensation of the newest and of the paired
    wrench, their forces along the task's directions, controller, supervisor.
    """
    compensation, loop = wrist(config), control_loop(config)
    approach, travel = config.frame.approach, config.frame.travel
    times = []
    turned, facing = None, None
    for _ in range(ROUNDS):
        state = loop.initial((cycles[0].start[0], cycles[0].start[1], cycles[0].start[2]))
        for record in cycles:
            if record.asked:
                state = loop.finish(state, record.asked)
            sample, quaternion = record.sample, record.quaternion
            assert sample is not None
            began = time.perf_counter_ns()
            if facing is None or turned != quaternion:  # as a run does, only when the tool has turned
                turned, facing = quaternion, compensation.facing(quaternion, quaternion, approach, travel)
            wrench = facing.contact_wrench(sample.wrench)
            facing.force_along(0, wrench)
            facing.force_along(1, wrench)
            facing.force_along(0, facing.contact_force(sample.wrench))
            state, _ = loop.step(state, sample)
            times.append((time.perf_counter_ns() - began) * MICRO)
    return times


def library_times(inputs: list[tuple[float, float]]) -> dict[str, Any]:
    """What the libraries answer and take. Raises LibrariesMissing."""
    place = CACHE / "fuzzy"
    python = place / "bin" / "python"
    try:
        if not python.exists():
            venv.create(place, with_pip=True)
        pip = [str(python), "-m", "pip", "install", "--quiet", "--disable-pip-version-check", *NEEDED]
        subprocess.run(pip, check=True, capture_output=True, text=True, timeout=300)
    except (OSError, subprocess.SubprocessError) as error:
        last = (getattr(error, "stderr", "") or str(error)).strip().splitlines()[-1]
        raise LibrariesMissing(f"{' and '.join(LIBRARIES)} cannot be installed: {last}") from error
    base = {
        "levels": PAPER_RULES.output.levels,
        "terms": {term.name: term.degrees for term in PAPER_RULES.output.terms},
        "rules": [list(rule) for rule in PAPER_RULES.rules],
        "inputs": inputs,
    }
    script = [str(python), str(Path(__file__).with_name("fuzzy_libraries.py"))]
    done = subprocess.run(script, input=json.dumps(base), check=True, stdout=subprocess.PIPE, text=True)
    results: dict[str, Any] = json.loads(done.stdout)
    return results


def measure(say: Callable[[str], None]) -> Report:
    """Whole decisions, then one evaluation of the rules by each."""
    draw = random.Random(1)
    inputs = [(draw.uniform(-6.0, 6.0), draw.uniform(-6.0, 6.0)) for _ in range(INPUTS)]
    left_out: tuple[str, ...] = ()
    fastest: float | None = None
    against = ""
    figures = []
    profiles = {}
    say("fuzzy libraries")
    try:
        results = library_times(inputs)
    except LibrariesMissing as error:
        left_out = (f"{error}.",)
    else:
        ours = [infer(*pair) for pair in inputs]
        medians = {}
        for name, result in results.items():
            worst = max(abs(a - b) for a, b in zip(result["answers"], ours, strict=True))
            if worst > TOLERANCE:
                raise RuntimeError(f"{name} answers {worst:g} levels otherwise: that is another computation")
            medians[f"{name} {result['version']}"] = Spread(result["times_ns"]).p50 * MICRO
        against = min(medians, key=lambda name: medians[name])
        fastest = medians[against]
        times = []
        for _ in range(ROUNDS):
            for pair in inputs:
                began = time.perf_counter_ns()
                infer(*pair)
                times.append((time.perf_counter_ns() - began) * MICRO)
        figures += [
            Figure("one evaluation of the rules, p50", Spread(times).p50, "µs", median, name)
            for name, median in medians.items()
        ]
    say("decisions of a run with each controller")
    runs = {title: recorded(controller) for title, controller in CONTROLLERS.items()}
    spreads: dict[str, list[Spread]] = {title: [] for title in runs}
    for turn in range(TURNS):
        say(f"turn {turn + 1} of {TURNS}")
        for title, run in runs.items():
            spreads[title].append(Spread(steps_us(*run)))
        time.sleep(PAUSE_S)
    for title, run in runs.items():
        with sampled() as counts:
            for _ in range(TURNS):
                steps_us(*run)
        profiles[f"Profile, {title}, by module"] = costs(counts)
        ordered = sorted(spreads[title], key=lambda spread: spread.p50)
        best, usual = ordered[0], ordered[TURNS // 2]
        figures.append(Figure(f"whole step, {title}, p50, best turn", best.p50, "µs", target=STEP))
        figures.append(Figure(f"whole step, {title}, p99, best turn", best.p99, "µs"))
        figures.append(Figure(f"whole step, {title}, p50, median turn", usual.p50, "µs"))
        if fastest is not None:
            name = f"whole step, {title}, p50, median turn, beside one evaluation by the faster library"
            figures.append(Figure(name, usual.p50, "µs", fastest, against, FASTER))
    return Report(tuple(figures), left_out, profiles)
