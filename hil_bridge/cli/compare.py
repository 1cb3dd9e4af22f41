"""`hil-bridge compare`: several recordings, or the results of several campaigns, on one page."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import click

from hil_bridge.cli.bag_options import bag_options
from hil_bridge.cli.entry_points import extension
from hil_bridge.console.options import echo_json, json_option, output_option, overwrite_option
from hil_bridge.console.paths import FILE
from hil_bridge.errors import ConfigError

if TYPE_CHECKING:
    from hil_bridge.record import Recording
    from hil_bridge.record.foreign import BagChoices

RESULTS = ".sqlite"


@click.command(short_help="Compare runs or campaigns on one page.")
@click.argument("files", metavar="A B …", nargs=-1, required=True, type=FILE)
@output_option("FILE.html", "The page.", Path("compare.html"))
@click.option(
    "--align",
    type=click.Choice(("touch", "begin")),
    default="touch",
    show_default=True,
    help="Event at 0 s in every recording: the first touch, or the start of the run.",
)
@json_option
@overwrite_option
@bag_options
def compare(
    files: tuple[Path, ...], out: Path, align: str, as_json: bool, overwrite: bool, bag: "BagChoices"
) -> None:
    """Plot forces, motion and times of 2 to 8 recordings over each other, and list the differing settings and figures.
    A ROS 2 bag with a WrenchStamped and a PoseStamped counts as a recording; it needs the extra ros.

    Results of campaigns (.sqlite), oldest first, are summarized by cell of the matrix: runs that passed, and medians of
    figures. The first is tested against the last by Fisher's exact test and the Mann-Whitney test. The exit code
    is 1 when the last is significantly worse.

    The page works offline. With --json no page is written.
    """
    kinds = {path.suffix == RESULTS for path in files}
    if len(kinds) > 1:
        raise ConfigError(f"compare takes either recordings or results of campaigns ({RESULTS}), not both")
    if kinds == {True}:
        extension("compare-results", "results of campaigns")(files, out, as_json, overwrite)
    else:
        from hil_bridge.record.files import check_place
        from hil_bridge.record.ros.bag_reader import read_any
        from hil_bridge.show.report.compare import names_of

        if not as_json:
            check_place(out, overwrite)
        runs = {name: read_any(path, bag) for name, path in zip(names_of(files), files, strict=True)}
        _compare_recordings(runs, (out, align), as_json, overwrite)


def _compare_recordings(
    runs: "Mapping[str, Recording]", page: tuple[Path, str], as_json: bool, overwrite: bool
) -> None:
    from hil_bridge.record.files import write_atomically
    from hil_bridge.show.report.compare import compare_page, compare_values

    out, align = page
    if as_json:
        echo_json(compare_values(runs))
        return
    write_atomically(out, compare_page(runs, align).encode(), overwrite)
    click.echo(out)
