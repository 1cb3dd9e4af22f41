"""All controllers on the same cell: soft and hard surfaces, quiet and noisy, at both rates of the link."""

from collections.abc import Sequence

from hil_bridge.control import CONTROLLERS
from hil_bridge.lab.drawing import Line, Panel, lines_by
from paper_experiments.cell import CYCLE_S, CellJob, CellTrace
from paper_experiments.paper_simulation import Parameters
from paper_experiments.results import (
    Claim,
    Experiment,
    Findings,
    Row,
    digits,
    distinct,
    figure,
    mean_merits,
    round_digits,
    rows_where,
    spread,
    verdict,
)

STIFFNESSES = (500.0, 1500.0, 5000.0, 20_000.0, 50_000.0, 200_000.0)
NOISES = {"quiet": 1.0, "noisy": 100.0}
"""Noise before the sensor's filters, rms counts: as recorded, and such that ± 0.5 N remain."""
SAMPLES = 50
"""Approximate number of samples of a run. Chosen: three times what the slowest controllers need on the sponge."""
STEADY_SAMPLES = 20
"""Samples at the end of a run. Chosen: fixed gains leave twice as many after their rise on the sponge."""
CONDITIONS = tuple((baudrate, noise) for baudrate in CYCLE_S for noise in NOISES)
REFERENCE_N = 20.0
RESOLUTION = 0.125e-3
"""Position resolution, m."""
SCHEDULED = "+estimate"
"""Suffix of a controller's name whose gains follow the stiffness estimate."""


def variants() -> dict[str, tuple[str, Parameters]]:
    """Return every controller with its defaults, and again with the stiffness estimate if it supports that."""
    found: dict[str, tuple[str, Parameters]] = {}
    for name, kind in CONTROLLERS.items():
        found[name] = (name, ())
        if "gain_scheduling" in getattr(kind, "__dataclass_fields__", ()):
            found[name] = (name, (("gain_scheduling", False),))
            found[name + SCHEDULED] = (name, (("gain_scheduling", True),))
    return found


def jobs(seeds: int) -> list[CellJob]:
    """Return the complete grid, for seeds 1, 2, …"""
    return [
        CellJob(
            name,
            parameters,
            seed,
            stiffness,
            REFERENCE_N,
            SAMPLES * CYCLE_S[baudrate],
            baudrate=baudrate,
            noise_counts=NOISES[noise],
            steady_samples=STEADY_SAMPLES,
        )
        for name, parameters in variants().values()
        for baudrate, noise in CONDITIONS
        for stiffness in STIFFNESSES
        for seed in range(1, seeds + 1)
    ]


def evaluate(done: Sequence[CellJob], results: Sequence[CellTrace]) -> Findings:
    """Return a row for each point of the grid, with means and spreads over the seeds."""
    names = {variant: name for name, variant in variants().items()}
    noises = {counts: noise for noise, counts in NOISES.items()}
    groups: dict[tuple[str, int, str, float], list[CellTrace]] = {}
    for job, result in zip(done, results, strict=True):
        key = (names[job.controller, job.parameters], job.baudrate, noises[job.noise_counts], job.stiffness)
        groups.setdefault(key, []).append(result)
    table = tuple(
        {
            "controller": name,
            "baudrate": baudrate,
            "noise": noise,
            "stiffness_n_m": int(stiffness),
            **mean_merits([trace.merit for trace in traces]),
            "period_ms": round_digits(spread(trace.period * 1e3 for trace in traces)[0]),
            "completed": sum(trace.completed for trace in traces),
        }
        for (name, baudrate, noise, stiffness), traces in groups.items()
    )
    return Findings(table)


_SHOWN = {
    "rms_error_n": "RMS force error, rise included, N",
    "steady_peak_to_peak_n": "steady force, peak to peak, N",
}
_STEP = "one resolution step"


def panels(table: Sequence[Row]) -> list[Panel]:
    """Return the errors of all controllers over the stiffness, a panel for each rate and noise."""
    panels = []
    for column, label in _SHOWN.items():
        for baudrate, noise in CONDITIONS:
            rows = rows_where(table, baudrate=baudrate, noise=noise)
            lines = lines_by(rows, "controller", column)
            if column == "steady_peak_to_peak_n":
                steps = [{"stiffness_n_m": k, _STEP: k * RESOLUTION} for k in STIFFNESSES]
                lines.append(Line(_STEP, _STEP, steps))
            x = "stiffness_n_m", "stiffness, N/m"
            panels.append(Panel(f"{baudrate} baud, {noise}", x, label, lines, log=True))
    return panels


def held(row: Row) -> bool:
    """Return whether the force is held at a point of the grid.

    That requires 90 % of the force reached, contact kept, and a mean error within the force of one resolution step. The
    steady oscillation must be within two of them. Each limit has a margin of 1 N for noise.
    """
    step = figure(row, "stiffness_n_m") * RESOLUTION
    return (
        row["rise_samples"] is not None
        and row["steady_mean_error_n"] is not None
        and figure(row, "contact_losses") == 0
        and abs(figure(row, "steady_mean_error_n")) <= step + 1.0
        and figure(row, "steady_peak_to_peak_n") <= 2 * step + 1.0
    )


def ranking(table: Sequence[Row]) -> list[Row]:
    """Return a row for each controller, starting with the one that holds most points of the grid."""
    ranked = [_rank(str(name), rows_where(table, controller=name)) for name in distinct(table, "controller")]
    return sorted(ranked, key=lambda row: (-figure(row, "held"), figure(row, "mean RMS error, N")))


def _rank(name: str, rows: Sequence[Row]) -> Row:
    good = [row for row in rows if held(row)]
    walls = [
        k
        for k in distinct(rows, "stiffness_n_m")
        if all(held(row) for row in rows_where(rows, stiffness_n_m=k))
    ]
    errors, _ = spread(figure(row, "rms_error_n") for row in rows)
    sponge = rows_where(rows, stiffness_n_m=5000)
    rise, _ = spread(
        figure(row, "rise_samples") if row["rise_samples"] is not None else None for row in sponge
    )
    overshoot, _ = spread(figure(row, "overshoot_percent") for row in sponge)
    return {
        "controller": name,
        "held": len(good),
        "of": len(rows),
        "held throughout, N/m": ", ".join(digits(k) for k in walls) or "none",
        "mean RMS error, N": round_digits(errors),
        "rise at 5 000 N/m, samples": round_digits(rise),
        "overshoot at 5 000 N/m, %": round_digits(overshoot),
    }


def claims(table: Sequence[Row]) -> tuple[Claim, ...]:
    """Return how much of the grid fixed gains, the paper's adaptation and the best controller hold."""
    ranked = ranking(table)
    of = {str(row["controller"]): row for row in ranked}
    best, fixed, adapted = ranked[0], of["fuzzy"], of["fuzzy-adaptive"]
    gained = figure(adapted, "held") - figure(fixed, "held")
    return (
        Claim(
            "fixed gains are not stable over a large range of stiffness",
            f"they hold {fixed['held']} of {fixed['of']} points ({fixed['held throughout, N/m']} N/m "
            f"throughout): {verdict(figure(fixed, 'held') < figure(fixed, 'of'))}",
        ),
        Claim(
            "the adaptive scheme performs acceptably in various contact conditions",
            f"it holds {adapted['held']} of {adapted['of']}, "
            f"{'more' if gained > 0 else 'no more'} than fixed gains; "
            f"{best['controller']} holds {best['held']}",
        ),
    )


ABOUT = (
    "In the paper, no fixed gain matrix is stable over a large range of stiffness, and the adaptive scheme performs "
    "acceptably in various contact conditions; there is no comparison with other controllers. Here every controller "
    f"holds {REFERENCE_N:g} N on surfaces from {digits(min(STIFFNESSES))} to {digits(max(STIFFNESSES))} N/m, quiet and "
    f"noisy, at 9600 and 19200 baud, for about {SAMPLES} samples. The last {STEADY_SAMPLES} of them are the steady "
    "state. A point counts as held if 90 % was reached, contact was never lost, and the steady force is correct "
    "within one resolution step and oscillates by at most two. On the hardest surface, one resolution step exceeds "
    "the desired force: no controller can correct this, and the paper's remedy is passive compliance. On the softest "
    f"surface, {SAMPLES} samples are too few for controllers that move by a few steps a sample."
)

COMPARISON = Experiment(
    "controllers", "All controllers on the same cell", ABOUT, jobs, evaluate, claims, panels, ranking
)
