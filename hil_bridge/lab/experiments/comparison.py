"""All controllers on the same cell: soft and hard surfaces, quiet and noisy, at both rates of the link."""

from collections.abc import Sequence

from hil_bridge.control import CONTROLLERS
from hil_bridge.lab.experiments.cell import CYCLE_S, CellJob, CellTrace
from hil_bridge.lab.experiments.drawing import COLOURS, MARKERS, Sheet
from hil_bridge.lab.experiments.paper_simulation import Parameters
from hil_bridge.lab.experiments.results import (
    Claim,
    Experiment,
    Findings,
    Row,
    digits,
    distinct,
    figure,
    markdown,
    round_digits,
    rows_where,
    verdict,
)
from hil_bridge.lab.experiments.statistics import figures, spread

STIFFNESSES = (500.0, 1500.0, 5000.0, 20_000.0, 50_000.0, 200_000.0)
NOISES = {"quiet": 1.0, "noisy": 100.0}
"""Noise before the sensor's filters, counts rms: as recorded, and such that ± 0.5 N is left."""
SAMPLES = 50
"""Samples of a run, about. Chosen: the slowest that reach the force on the sponge do so in a third of them."""
STEADY_SAMPLES = 20
"""Samples at the end of a run. Chosen: fixed gains leave them after their rise on the sponge, with as many to spare."""
CONDITIONS = tuple((baudrate, noise) for baudrate in CYCLE_S for noise in NOISES)
REFERENCE_N = 20.0
RESOLUTION = 0.125e-3
"""m"""
SCHEDULED = "+estimate"
"""Behind a controller's name: its gains follow the stiffness estimate."""


def variants() -> dict[str, tuple[str, Parameters]]:
    """Every controller at its defaults, and once more with the stiffness estimate where that is a choice."""
    found: dict[str, tuple[str, Parameters]] = {}
    for name, kind in CONTROLLERS.items():
        found[name] = (name, ())
        if "gain_scheduling" in getattr(kind, "__dataclass_fields__", ()):
            found[name] = (name, (("gain_scheduling", False),))
            found[name + SCHEDULED] = (name, (("gain_scheduling", True),))
    return found


def jobs(seeds: int) -> list[CellJob]:
    """The whole grid, for seeds 1, 2, …"""
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
    """A row for each point of the grid, means and spreads over the seeds."""
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
            **figures([trace.merit for trace in traces]),
            "period_ms": round_digits(spread(trace.period * 1e3 for trace in traces)[0]),
            "completed": sum(trace.completed for trace in traces),
        }
        for (name, baudrate, noise, stiffness), traces in groups.items()
    )
    return Findings(table, _draw(table))


_PANELS = (
    ("rms_error_n", "RMS force error,\nrise included, N", (1.0, 100.0)),
    ("steady_peak_to_peak_n", "steady force,\npeak to peak, N", (0.01, 300.0)),
)


def _draw(table: Sequence[Row]) -> bytes:
    names = distinct(table, "controller")
    scheduled = {
        name for name, (_, parameters) in variants().items() if ("gain_scheduling", True) in parameters
    }
    with Sheet(14.0, 7.6, 2, len(CONDITIONS), sharex=True, sharey="row") as sheet:
        for at, ax in enumerate(sheet.axes):
            column, title, limits = _PANELS[at // len(CONDITIONS)]
            baudrate, noise = CONDITIONS[at % len(CONDITIONS)]
            for index, name in enumerate(names):
                rows = rows_where(table, controller=name, baudrate=baudrate, noise=noise)
                known = [row for row in rows if row[column] is not None]
                ax.errorbar(
                    [figure(row, "stiffness_n_m") for row in known],
                    values := [max(figure(row, column), limits[0]) for row in known],
                    [
                        # A bar down to zero would fill a logarithmic axis.
                        [
                            min(figure(row, f"{column}_sd"), value / 2)
                            for row, value in zip(known, values, strict=True)
                        ],
                        [figure(row, f"{column}_sd") for row in known],
                    ],
                    color=COLOURS[index % len(COLOURS)],
                    marker=MARKERS[index % len(MARKERS)],
                    ms=5,
                    lw=1.2,
                    ls="--" if name in scheduled else "-",
                    capsize=2,
                    label=name,
                )
            if column == "steady_peak_to_peak_n":
                ax.plot(
                    STIFFNESSES,
                    [k * RESOLUTION for k in STIFFNESSES],
                    color="#808080",
                    lw=1.0,
                    ls=":",
                    label="one resolution step",
                )
                ax.set_xlabel("stiffness, N/m")
            else:
                ax.set_title(f"{baudrate} baud, {noise}")
            ax.set_xscale("log")
            ax.set_yscale("log")
            ax.set_ylim(limits)
            if at % len(CONDITIONS) == 0:
                ax.set_ylabel(title)
        handles, labels = sheet.axes[-1].get_legend_handles_labels()
        sheet.figure.legend(handles, labels, loc="outside lower center", ncols=5)
        return sheet.png()


def held(row: Row) -> bool:
    """Whether a point of the grid counts as held: 90 % reached, contact kept, and mean error within a resolution step's
    force. The steady swing must lie within two of them. Each limit has 1 N more for noise.
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
    """A row for each controller, the one first that holds most points of the grid."""
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


def describe(table: Sequence[Row]) -> tuple[str, tuple[Claim, ...]]:
    """Which controller holds how much of the grid."""
    ranked = ranking(table)
    best = ranked[0]
    of = {str(row["controller"]): row for row in ranked}
    fixed, adapted = of["fuzzy"], of["fuzzy-adaptive"]
    hardest = max(distinct(table, "stiffness_n_m"))
    on_hardest = sum(held(row) for row in rows_where(table, stiffness_n_m=hardest))
    seeds = figure(table[0], "seeds")
    gained = figure(adapted, "held") - figure(fixed, "held")
    text = (
        f"The paper says that no fixed gain matrix is stable over a large range of stiffness and that the "
        f"adaptive scheme performs acceptably in various contact conditions; it compares with no other "
        f"controller. Here every controller holds {REFERENCE_N:g} N on "
        f"{len(distinct(table, 'stiffness_n_m'))} surfaces from "
        f"{digits(min(distinct(table, 'stiffness_n_m')))} to {digits(hardest)} N/m, quiet and noisy, at 9600 and "
        f"19200 baud, {seeds:g} seeds each, about {SAMPLES} samples a run, the "
        f"last {STEADY_SAMPLES} of which are its steady state. A point counts as held when "
        f"90 % was reached, contact was never lost, and the steady force is right within a resolution step "
        f"and swings by no more than two. The fixed gains hold {fixed['held']} of {fixed['of']} points, the "
        f"paper's adaptation {adapted['held']}, and {best['controller']} {best['held']}. On "
        f"{digits(hardest)} N/m one resolution step is worth {digits(hardest * RESOLUTION)} N, more than the "
        f"desired force, and {on_hardest} of {len(rows_where(table, stiffness_n_m=hardest))} points are held "
        f"there: what position steps cannot reach, no controller can, and passive compliance is the paper's "
        f"remedy. On the softest surface a run of {SAMPLES} samples is too short for controllers that move by a "
        f"few steps a sample.\n\n" + markdown(ranked, list(ranked[0]))
    )
    claims = (
        Claim(
            "fixed gains are not stable over a large range of stiffness",
            f"they hold {fixed['held']} of {fixed['of']} points ({fixed['held throughout, N/m']} N/m "
            f"throughout): " + verdict(figure(fixed, "held") < figure(fixed, "of")),
        ),
        Claim(
            "the adaptive scheme performs acceptably in various contact conditions",
            f"it holds {adapted['held']} of {adapted['of']}, "
            f"{'more' if gained > 0 else 'no more'} than fixed gains; "
            f"{best['controller']} holds {best['held']}",
        ),
    )
    return text, claims


COMPARISON = Experiment("controllers", "All controllers on the same cell", jobs, evaluate, describe)
