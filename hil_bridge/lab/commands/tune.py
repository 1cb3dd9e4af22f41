"""`hil-bridge tune`: a controller's parameters for a given cell and criterion."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from hil_bridge.cli.completion import complete, controllers
from hil_bridge.console.options import echo_lines, output_option, overwrite_option
from hil_bridge.console.paths import FILE
from hil_bridge.errors import ConfigError

if TYPE_CHECKING:
    from hil_bridge.lab.tuning.comparing import Comparison
    from hil_bridge.lab.tuning.evaluating import Runs
    from hil_bridge.lab.tuning.searching import Search, SearchPlan
    from hil_bridge.settings.configuration import Config

NO_FEASIBLE_POINT = 4
"""Exit code if no point met the constraints."""


@click.command(short_help="Optimise a controller's parameters for a cell.")
@click.argument("config_file", metavar="[CONFIG.toml]", required=False, type=FILE)
@click.option(
    "--controller",
    metavar="NAME",
    shell_complete=complete(controllers),
    help="Controller.  [default: that of the configuration]",
)
@click.option(
    "--vary",
    multiple=True,
    metavar="NAME[=LOW:HIGH[:log]]",
    help="Parameter to vary, with bounds in its unit. Repeatable.  [default: all that define bounds]",
)
@click.option(
    "--minimise",
    multiple=True,
    metavar="FIGURE[=WEIGHT]",
    help="Figure to minimise. Repeatable.  [default: rms_error_n and overshoot_percent]",
)
@click.option(
    "--force-limit", type=float, metavar="N", help="Limit of the true force.  [default: limits.force_limit_n]"
)
@click.option("--duration", type=float, metavar="S", help="Duration of each run, s of virtual time.")
@click.option(
    "--budget", type=click.IntRange(min=1), default=300, show_default=True, help="Maximum number of runs."
)
@click.option(
    "--seeds", type=click.IntRange(min=2), default=3, show_default=True, help="Number of seeds of each point."
)
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    default=1,
    show_default=True,
    help="First seed, also used by the optimiser.",
)
@click.option(
    "--workers", type=click.IntRange(min=1), metavar="N", help="Number of processes.  [default: one per core]"
)
@output_option("TUNED.toml", "Write the tuned configuration.")
@click.option(
    "--trade", metavar="X:Y", help="Two figures of the trade-off.  [default: rise_s:overshoot_percent]"
)
@click.option("--plot", type=FILE, metavar="FILE.svg", help="Plot the trade-off, as .svg or .png.")
@click.option(
    "--json", "json_file", type=FILE, metavar="FILE.json", help="Write all points with all figures."
)
@click.option(
    "--also",
    multiple=True,
    type=FILE,
    metavar="CELL.toml",
    help="Further cell to tune in at the same time. Repeatable.",
)
@click.option(
    "--validate",
    multiple=True,
    type=FILE,
    metavar="CELL.toml",
    help="Further cell in which to compare with the defaults. Repeatable.",
)
@overwrite_option
def tune(
    config_file: Path | None,
    controller: str | None,
    vary: tuple[str, ...],
    minimise: tuple[str, ...],
    force_limit: float | None,
    duration: float | None,
    budget: int,
    seeds: int,
    seed: int,
    workers: int | None,
    out: Path | None,
    trade: str | None,
    plot: Path | None,
    json_file: Path | None,
    also: tuple[Path, ...],
    validate: tuple[Path, ...],
    overwrite: bool,
) -> None:
    """Optimise the parameters of a controller by many runs in virtual time, and compare them with the defaults.

    \b
    hil-bridge tune cell.toml --controller pi --minimise rise_s --minimise overshoot_percent -o tuned.toml
    hil-bridge run tuned.toml --virtual

    A point is excluded if the guard stops one of its runs, or if the true force of one exceeds the limit. Exit codes:
    0 completed, 2 invalid input, 4 no point met the constraints, 130 interrupted; the best point so far is written.
    """
    import os

    from hil_bridge.console.progress import run_progress
    from hil_bridge.lab.tuning.evaluating import running
    from hil_bridge.lab.tuning.front import check_picture, describe_front, front, picture
    from hil_bridge.lab.tuning.preparing import axes_of, limit_of, load_other_cell, tuned_file, weights_of
    from hil_bridge.lab.tuning.reporting import as_json, describe_parameters, fresh_comparison
    from hil_bridge.lab.tuning.searching import SearchPlan, begin, search
    from hil_bridge.lab.tuning.space import space_of
    from hil_bridge.record.files import check_place, write_atomically
    from hil_bridge.runs.signals import as_ctrl_c

    for place in (out, plot, json_file):
        if place is not None:
            check_place(place, overwrite)
    if plot is not None:
        check_picture(plot)
    axes = axes_of(trade)
    overrides: dict[str, object] = {"controller.name": controller, "run.duration_s": duration}
    values, config = _read(config_file, overrides)
    weights, limit = weights_of(minimise), limit_of(config, force_limit)
    first = tuple(range(seed, seed + seeds))
    plan = SearchPlan(space_of(config, vary), weights, limit, first, budget, seed, 1 + len(also))
    tuned_in = [config, *(load_other_cell(place, config) for place in also)]
    cells = [(place.stem, load_other_cell(place, config)) for place in validate]
    state: Search | None = None
    comparisons: list[Comparison] = []
    try:
        processes = workers or os.cpu_count() or 1
        with (
            as_ctrl_c(),
            run_progress(_runs(plan, len(cells))) as advance,
            running(processes, lambda: advance(1, 0)) as runs,
        ):
            state = begin(tuned_in, plan, runs)
            search(state, runs)
            comparisons = _validate(state, cells, runs)
    finally:  # results so far are written even after Ctrl-C
        if state is not None:
            echo_lines(describe_parameters(state))
            best = state.best
            if best is not None and out is not None:
                text = tuned_file(values, config, state, config_file)
                write_atomically(out, text.encode(), overwrite)
                click.echo(out)
            if plot is not None:
                write_atomically(
                    plot,
                    picture(state.tried, state.defaults, _find_best(state), axes, plot.suffix[1:]),
                    overwrite,
                )
                click.echo(plot)
            if json_file is not None:
                write_atomically(json_file, as_json(state, comparisons).encode(), overwrite)
                click.echo(json_file)
    echo_lines(["", *describe_front(front(state.tried, *axes), plan.space, *axes)])
    fresh = fresh_comparison(state)
    _print_comparisons([*([fresh] if fresh else []), *comparisons], plan, bool(cells))
    if state.best is None:
        click.get_current_context().exit(NO_FEASIBLE_POINT)


def _find_best(state: "Search") -> Any:
    """Return the best point with its figures from the search, not from the fresh seeds, so that it matches the
    other points of the plot.
    """
    best = state.best
    return None if best is None else next(one for one in state.tried if one.point == best.point)


def _read(place: Path | None, overrides: dict[str, object]) -> tuple[dict[str, Any], "Config"]:
    """Return the values of the file with the overrides applied, and the resulting configuration, which includes its
    pace.
    """
    from hil_bridge.runs.setup import Setup
    from hil_bridge.settings.configuration import load_config, read_values
    from hil_bridge.settings.overrides import lay_over

    values = read_values(place) if place is not None else {}
    lay_over(values, overrides)
    config = Setup(load_config(place, overrides)).config
    if config.robot.url or config.sensor.url:
        raise ConfigError(
            "robot.url and sensor.url: a search runs on the emulated cell only; leave them empty"
        )
    return values, config


def _runs(plan: "SearchPlan", cells: int) -> int:
    """Return the maximum number of runs of the search and of the validation."""
    return plan.budget + cells * 2 * len(plan.fresh)


def _validate(state: "Search", cells: Sequence[tuple[str, "Config"]], runs: "Runs") -> "list[Comparison]":
    from hil_bridge.lab.tuning.preparing import compare_with_defaults

    if state.best is None:
        return []
    return [compare_with_defaults(name, config, state, runs) for name, config in cells]


def _print_comparisons(comparisons: "Sequence[Comparison]", plan: "SearchPlan", validated: bool) -> None:
    from hil_bridge.lab.tuning.comparing import describe_comparison, sentence

    figures = [*plan.weights, "rise_s", "overshoot_percent", "rms_error_n"]
    for one in comparisons:
        echo_lines(["", *describe_comparison(one, [*dict.fromkeys(figures), "force_true_max_n"])])
    if validated and len(comparisons) > 1:
        echo_lines(["", f"In cells not used for tuning, {sentence(comparisons[1:])}."])
