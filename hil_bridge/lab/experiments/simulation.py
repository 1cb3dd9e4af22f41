"""Figs. 3 and 5: the paper's simulation on walls of five stiffnesses, without and with adaptation."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from hil_bridge.lab.experiments.drawing import COLOURS, Sheet, label
from hil_bridge.lab.experiments.paper_simulation import RESOLUTION, PaperJob, PaperRun, Parameters
from hil_bridge.lab.experiments.results import (
    Claim,
    Experiment,
    Findings,
    Row,
    digits,
    figure,
    only_row,
    rows_where,
    verdict,
)
from hil_bridge.lab.experiments.statistics import figures

STIFFNESSES = (1e3, 5e3, 2e4, 5e4, 1e5)
"""N/m. Source: project specification of the force control, section 4; the paper prints none."""
REFERENCE_N = 50.0
"""Source: likewise."""
SHOWN_SAMPLES = 60

FIXED, ADAPTED, AWARE = "fuzzy", "fuzzy-adaptive", "resolution-aware"
UNLIMITED: Parameters = (("feedforward_limit_mm", None),)
"""The paper limits no feedforward, and on a simulated wall none is needed."""
PARAMETERS: dict[str, Parameters] = {FIXED: (), ADAPTED: (), AWARE: UNLIMITED}

SETTLED_STEPS = 0.05
"""Resolution steps per second below which a mean over seeds counts as rest."""


def jobs(controllers: Sequence[str], seeds: int) -> list[PaperJob]:
    """Every controller on every wall, for noise seeds 0, 1, …"""
    return [
        PaperJob(name, PARAMETERS[name], stiffness, REFERENCE_N, seed)
        for name in controllers
        for stiffness in STIFFNESSES
        for seed in range(seeds)
    ]


def tabulate(done: Sequence[PaperJob], results: Sequence[PaperRun]) -> tuple[Row, ...]:
    """A row for each controller and wall: figures over the seeds."""
    groups: dict[tuple[str, float], list[PaperRun]] = {}
    for job, result in zip(done, results, strict=True):
        groups.setdefault((job.controller, job.stiffness), []).append(result)
    return tuple(
        {"controller": controller, "stiffness_n_m": int(stiffness), **figures([run.merit for run in runs])}
        for (controller, stiffness), runs in groups.items()
    )


def evaluate(done: Sequence[PaperJob], results: Sequence[PaperRun]) -> Findings:
    """Table, and the force over the first samples of the first seed."""
    table = tabulate(done, results)
    names = list(dict.fromkeys(job.controller for job in done))
    series: list[Row] = []
    with Sheet(4.6 * max(len(names), 2), 4.3, 1, len(names), sharey=True) as sheet:
        for ax, name in zip(sheet.axes, names, strict=True):
            ax.axhline(REFERENCE_N, color="black", lw=1.0, ls="--")
            for colour, stiffness in zip(COLOURS, STIFFNESSES, strict=False):
                (run,) = (
                    result
                    for job, result in zip(done, results, strict=True)
                    if (job.controller, job.stiffness, job.seed) == (name, stiffness, 0)
                )
                force = np.array(run.force[:SHOWN_SAMPLES])
                ax.plot(force, color=colour, lw=1.2, marker=".", ms=4, label=label(stiffness))
                series += [
                    {"controller": name, "stiffness_n_m": int(stiffness), "sample": k, "force_n": round(f, 4)}
                    for k, f in enumerate(force.tolist())
                ]
            ax.set_title(name)
            ax.set_xlabel("sample")
        sheet.axes[0].set_ylabel("contact force, N")
        handles, labels = sheet.axes[0].get_legend_handles_labels()
        sheet.figure.legend(
            handles, labels, title="stiffness of the wall, N/m", loc="outside lower center", ncols=5
        )
        picture = sheet.png()
    return Findings(table, picture, tuple(series), REFERENCE_N)


def _cycling(rows: Sequence[Row]) -> list[int]:
    """Walls on which the command still moves in steady state."""
    return [int(figure(row, "stiffness_n_m")) for row in rows if figure(row, "steps_per_s") > SETTLED_STEPS]


def _walls(stiffnesses: Sequence[Any]) -> str:
    if not stiffnesses:
        return "no wall"
    return ", ".join(digits(value) for value in stiffnesses) + " N/m"


def _steps(row: Row) -> float:
    """Steady peak-to-peak in resolution steps of the position."""
    return figure(row, "steady_peak_to_peak_n") / (figure(row, "stiffness_n_m") * RESOLUTION)


def describe_fixed(table: Sequence[Row]) -> tuple[str, tuple[Claim, ...]]:
    """Text and claims for Fig. 3."""
    soft, sponge, hard, hardest = (only_row(table, stiffness_n_m=k) for k in (1000, 5000, 50_000, 100_000))
    cycling = _cycling(rows_where(table, controller=FIXED))
    creeps = figure(soft, "overshoot_percent") < 2.0 and figure(soft, "rise_samples") > 50
    cycles = 50_000 in cycling and _steps(hard) > 1.5
    text = (
        f"The paper says that with a fixed gain matrix the response is overdamped on a soft wall and ends "
        f"in a limit cycle on a hard one. The first is {verdict(creeps)}, the second {verdict(cycles)}. On "
        f"{digits(soft['stiffness_n_m'])} N/m the force takes {digits(soft['rise_samples'])} samples to 90 % "
        f"of the {REFERENCE_N:g} N, on {digits(sponge['stiffness_n_m'])} N/m "
        f"{digits(sponge['rise_samples'])}, and on {digits(hardest['stiffness_n_m'])} N/m "
        f"{digits(hardest['rise_samples'])}; overshoot is {digits(soft['overshoot_percent'])} % on the "
        f"softest and {digits(hard['overshoot_percent'])} % on {digits(hard['stiffness_n_m'])} N/m. There the "
        f"force swings by {digits(hard['steady_peak_to_peak_n'])} N for ever, {_steps(hard):.1f} resolution "
        f"steps; on the hardest by {digits(hardest['steady_peak_to_peak_n'])} N, {_steps(hardest):.1f} "
        f"steps. In steady state the command still moves on {_walls(cycling)}; on the softest because it "
        f"has not arrived yet. The paper prints neither the desired force nor the stiffnesses, so its "
        f"curves cannot be laid over these."
    )
    claims = (
        Claim(
            "overdamped on a soft wall",
            f"rise {digits(soft['rise_samples'])} samples, overshoot {digits(soft['overshoot_percent'])} % at "
            f"{digits(soft['stiffness_n_m'])} N/m: {verdict(creeps)}",
        ),
        Claim(
            "limit cycle on a hard wall",
            f"{digits(hard['steady_peak_to_peak_n'])} N peak to peak at {digits(hard['stiffness_n_m'])} N/m: "
            + verdict(cycles),
        ),
    )
    return text, claims


def describe_adapted(table: Sequence[Row]) -> tuple[str, tuple[Claim, ...]]:
    """Text and claims for Fig. 5."""
    fixed, adapted, aware = (rows_where(table, controller=name) for name in (FIXED, ADAPTED, AWARE))
    before, after = (only_row(rows, stiffness_n_m=5000) for rows in (fixed, adapted))
    faster = figure(before, "rise_samples") / figure(after, "rise_samples")
    hard = only_row(adapted, stiffness_n_m=100_000)
    hard_fixed = only_row(fixed, stiffness_n_m=100_000)
    small = [row for row in adapted if figure(row, "stiffness_n_m") <= 20_000]
    overshoot = max(figure(row, "overshoot_percent") for row in small)
    calm = [row for row in aware if figure(row, "stiffness_n_m") >= 5_000]
    bound = all(
        abs(figure(row, "steady_mean_error_n")) <= figure(row, "stiffness_n_m") * RESOLUTION / 2
        for row in calm
    )
    aware_cycling, cycling = (
        _cycling([row for row in rows if figure(row, "stiffness_n_m") >= 5_000]) for rows in (aware, adapted)
    )
    aware_overshoot = max(
        figure(row, "overshoot_percent") for row in aware if figure(row, "stiffness_n_m") <= 50_000
    )
    gone = "does" if not cycling else "does not"
    text = (
        f"The paper says that adaptation makes the response faster with a small overshoot and that the "
        f"limit cycle disappears. Faster: at {digits(after['stiffness_n_m'])} N/m the rise falls from "
        f"{digits(before['rise_samples'])} to {digits(after['rise_samples'])} samples, {faster:.1f} times. "
        f"Small overshoot: at most {digits(overshoot)} % up to 20 000 N/m, but "
        f"{digits(hard['overshoot_percent'])} % at {digits(hard['stiffness_n_m'])} N/m. The limit cycle "
        f"{gone} disappear at {REFERENCE_N:g} N: the command keeps moving on {_walls(cycling)}, and at "
        f"{digits(hard['stiffness_n_m'])} N/m the force swings by {digits(hard['steady_peak_to_peak_n'])} N, "
        f"with fixed gains by {digits(hard_fixed['steady_peak_to_peak_n'])} N. The reason is that the fuzzy "
        f"correction goes on beside the feedforward: quartered and rounded to whole steps it still "
        f"outweighs an error that no reachable position can better, for one step is worth "
        f"{digits(figure(hard, 'stiffness_n_m') * RESOLUTION)} N there. The resolution-aware controller "
        f"commands the feedforward alone and rests inside half a step: from 5 000 N/m on its command moves "
        f"on {_walls(aware_cycling)}, its mean error is {'within' if bound else 'not always within'} half a "
        f"step's force, and its overshoot is at most {digits(aware_overshoot)} % up to 50 000 N/m."
    )
    claims = (
        Claim(
            "adaptation speeds up the response",
            f"{faster:.1f} times faster at 5 000 N/m: {verdict(faster > 2)}",
        ),
        Claim(
            "small overshoot",
            f"at most {digits(overshoot)} % up to 20 000 N/m, {digits(hard['overshoot_percent'])} % at "
            f"100 000 N/m: {verdict(overshoot < 15)} up to 20 000 N/m, "
            f"{verdict(figure(hard, 'overshoot_percent') < 15)} on the hardest wall",
        ),
        Claim(
            "the limit cycle disappears",
            (
                verdict(True)
                if not cycling
                else f"not reproduced, it stays on {_walls(cycling)}; with the resolution-aware controller on "
                f"{_walls(aware_cycling)}"
            ),
        ),
    )
    return text, claims


_SHOWN = (
    "controller",
    "stiffness_n_m",
    "rise_samples",
    "overshoot_percent",
    "steady_mean_error_n",
    "steady_peak_to_peak_n",
    "steps_per_s",
)

FIG3 = Experiment(
    "fig3",
    "Fig. 3: simulation with fixed gains",
    lambda seeds: jobs((FIXED,), seeds),
    evaluate,
    describe_fixed,
    _SHOWN,
)
FIG5 = Experiment(
    "fig5",
    "Fig. 5: simulation with adaptation",
    lambda seeds: jobs((FIXED, ADAPTED, AWARE), seeds),
    evaluate,
    describe_adapted,
    _SHOWN,
)
