"""`hil-bridge list runs`: list the runs in a folder."""

from pathlib import Path

import click

from hil_bridge.console.options import echo_json, echo_lines, json_option
from hil_bridge.console.paths import FILE


@click.command(short_help="List the runs of a folder, the newest last.")
@click.argument("folder", type=FILE, default=Path("runs"))
@click.option(
    "--last",
    type=click.IntRange(min=1),
    default=20,
    show_default=True,
    metavar="N",
    help="Number of runs to list, the newest ones.",
)
@json_option
def runs(folder: Path, last: int, as_json: bool) -> None:
    """List the runs in FOLDER, runs/ by default, by their summaries: outcome, controller, forces, cause.

    Each line begins with the folder of a run, for `hil-bridge report`, `view` and `why`.
    """
    from hil_bridge.record.analysis.listing import list_runs, run_lines

    listed = list_runs(folder, last)
    if as_json:
        echo_json([one.values for one in listed])
        return
    echo_lines(run_lines(listed))
