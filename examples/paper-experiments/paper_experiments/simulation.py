"""Figs. 3 and 5: the paper's simulation on walls of five stiffnesses, without and with adaptation."""

from collections.abc import Sequence

from hil_bridge.lab.drawing import Panel, lines_by
from paper_experiments.paper_simulation import RESOLUTION, PaperJob, PaperRun, Parameters
from paper_experiments.results import (
    Claim,
    Experiment,
    Findings,
    Row,
    columns_of,
    digits,
    distinct,
    figure,
    mean_merits,
    only_row,
    rows_where,
    verdict,
)

STIFFNESSES = (1e3, 5e3, 2e4, 5e4, 1e5)
"""Stiffnesses of the walls, N/m. Source: project specification of the force control, section 4; not in the paper."""
REFERENCE_N = 50.0
"""Target force, N. Source: as above."""
SHOWN_SAMPLES = 60

UNLIMITED: Parameters = (("feedforward_limit_mm", None),)
"""Parameters without a feedforward limit: the paper has none, and on a simulated wall none is needed."""
PARAMETERS: dict[str, Parameters] = {"fuzzy": (), "fuzzy-adaptive": (), "resolution-aware": UNLIMITED}

SETTLED_STEPS = 0.05
"""Resolution steps per second below which a mean over seeds counts as stationary."""
ABOUT = (
    "In the paper, a fixed gain matrix gives an overdamped response on a soft wall and a limit cycle on a hard one "
    "(Fig. 3). Adaptation gives a faster response with a small overshoot and no limit cycle (Fig. 5). The paper "
    "prints neither the desired force nor the stiffnesses, so the curves cannot be compared directly. Where the limit "
    "cycle remains, the fuzzy correction adds to the feedforward: even quartered and rounded to whole steps, it is "
    "larger than an error that no reachable position can reduce. The resolution-aware controller commands the "
    "feedforward alone, and stops within half a step."
)


def jobs(seeds: int) -> list[PaperJob]:
    """Return every controller on every wall, for noise seeds 0, 1, …"""
    return [
        PaperJob(name, parameters, stiffness, REFERENCE_N, seed)
        for name, parameters in PARAMETERS.items()
        for stiffness in STIFFNESSES
        for seed in range(seeds)
    ]


def evaluate(done: Sequence[PaperJob], results: Sequence[PaperRun]) -> Findings:
    """Return a row for each controller and wall, and the force over the first samples of the first seed."""
    groups: dict[tuple[str, float], list[PaperRun]] = {}
    for job, result in zip(done, results, strict=True):
        groups.setdefault((job.controller, job.stiffness), []).append(result)
    table: list[Row] = []
    curves: list[Row] = []
    for (controller, stiffness), runs in groups.items():
        names: Row = {"controller": controller, "stiffness_n_m": int(stiffness)}
        table.append({**names, **mean_merits([run.merit for run in runs])})
        forces = runs[0].force[:SHOWN_SAMPLES]
        curves += [{**names, "sample": k, "force_n": round(force, 4)} for k, force in enumerate(forces)]
    return Findings(tuple(table), tuple(curves))


def panels(curves: Sequence[Row]) -> list[Panel]:
    """Return a panel for each controller, with a line for each wall."""
    return [
        Panel(
            name,
            ("sample", "sample"),
            "contact force, N",
            lines_by(rows_where(curves, controller=name), "stiffness_n_m", "force_n", "wall of {} N/m"),
            REFERENCE_N,
        )
        for name in distinct(curves, "controller")
    ]


def _cycling(rows: Sequence[Row]) -> str:
    """Return the walls on which the command still moves in steady state, as text."""
    walls = [row["stiffness_n_m"] for row in rows if figure(row, "steps_per_s") > SETTLED_STEPS]
    return ", ".join(map(digits, walls)) + " N/m" if walls else "no wall"


def claims(table: Sequence[Row]) -> tuple[Claim, ...]:
    """Return the claims for both figures."""
    fixed, adapted, aware = (rows_where(table, controller=name) for name in PARAMETERS)
    return *_claims_of_fixed(fixed), *_claims_of_adapted(fixed, adapted, aware)


def _claims_of_fixed(fixed: Sequence[Row]) -> tuple[Claim, ...]:
    soft, hard = (only_row(fixed, stiffness_n_m=k) for k in (1000, 50_000))
    creeps = figure(soft, "overshoot_percent") < 2.0 and figure(soft, "rise_samples") > 50
    steps = figure(hard, "steady_peak_to_peak_n") / (figure(hard, "stiffness_n_m") * RESOLUTION)
    cycles = figure(hard, "steps_per_s") > SETTLED_STEPS and steps > 1.5
    return (
        Claim(
            "overdamped on a soft wall",
            f"rise {digits(soft['rise_samples'])} samples, overshoot {digits(soft['overshoot_percent'])} % at "
            f"{digits(soft['stiffness_n_m'])} N/m: {verdict(creeps)}",
        ),
        Claim(
            "limit cycle on a hard wall",
            f"{digits(hard['steady_peak_to_peak_n'])} N peak to peak, {steps:.1f} resolution steps, at "
            f"{digits(hard['stiffness_n_m'])} N/m: {verdict(cycles)}",
        ),
    )


def _claims_of_adapted(
    fixed: Sequence[Row], adapted: Sequence[Row], aware: Sequence[Row]
) -> tuple[Claim, ...]:
    before, after = (figure(only_row(rows, stiffness_n_m=5000), "rise_samples") for rows in (fixed, adapted))
    hard = figure(only_row(adapted, stiffness_n_m=100_000), "overshoot_percent")
    overshoot = max(
        figure(row, "overshoot_percent") for row in adapted if figure(row, "stiffness_n_m") <= 20_000
    )
    cycling, aware_cycling = (
        _cycling([row for row in rows if figure(row, "stiffness_n_m") >= 5000]) for rows in (adapted, aware)
    )
    stays = (
        f"not reproduced, it stays on {cycling}; with the resolution-aware controller on {aware_cycling}"
        if cycling != _cycling([])
        else verdict(True)
    )
    return (
        Claim(
            "adaptation speeds up the response",
            f"{before / after:.1f} times faster at 5 000 N/m: {verdict(before > 2 * after)}",
        ),
        Claim(
            "small overshoot",
            f"at most {digits(overshoot)} % up to 20 000 N/m, {digits(hard)} % at 100 000 N/m: "
            f"{verdict(overshoot < 15)} up to 20 000 N/m, {verdict(hard < 15)} on the hardest wall",
        ),
        Claim("the limit cycle disappears", stays),
    )


SIMULATION = Experiment(
    "fig3-5",
    "Figs. 3 and 5: simulation with fixed gains and with adaptation",
    ABOUT,
    jobs,
    evaluate,
    claims,
    panels,
    columns_of(
        "controller",
        "stiffness_n_m",
        "rise_samples",
        "overshoot_percent",
        "steady_mean_error_n",
        "steady_peak_to_peak_n",
        "steps_per_s",
    ),
)
