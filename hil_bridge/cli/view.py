"""`hil-bridge view`: display a recording, a ROS 2 bag or the results of a campaign on a page in the browser."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from hil_bridge.cli.bag_options import bag_options
from hil_bridge.cli.entry_points import extension
from hil_bridge.console.paths import FILE
from hil_bridge.errors import ConfigError
from hil_bridge.errors.text_files import refuse_known_file

if TYPE_CHECKING:
    from hil_bridge.record.foreign import BagChoices
    from hil_bridge.show.web.recorded import Report

RECORDING, RESULTS = ".mcap", ".sqlite"


@click.command(short_help="Show a recording or a campaign in the browser.")
@click.argument("file", type=FILE, metavar="FILE")
@click.option(
    "--port", type=click.IntRange(0, 65535), default=0, metavar="N", help="Port.  [default: one that is free]"
)
@click.option(
    "--save",
    type=FILE,
    metavar="FILE.html",
    help="Write the page of a recording into this file instead, which opens anywhere without a network.",
)
@click.option("--overwrite", is_flag=True, help="Replace that file.")
@bag_options
def view(file: Path, port: int, save: Path | None, overwrite: bool, bag: "BagChoices") -> None:
    """Serve a page for FILE on this machine alone, until Ctrl-C: a recording (.mcap) with a slider for its time, or the
    results of a campaign (.sqlite), which may still be running.

    FILE may be a ROS 2 bag with a WrenchStamped and a PoseStamped: its folder, or an MCAP file. Its page is that of
    `hil-bridge report`, without a slider: a bag has no phases, targets or limits. That needs the extra ros.

    --save writes one file with the cell in three dimensions and the charts of a recording, to send to others.

    To watch a live run, use `hil-bridge run --web`. Needs the extra web, except with --save.
    """
    if save is not None:
        _save(file, save, overwrite)
        return
    from hil_bridge.record.ros.bag_file import is_bag
    from hil_bridge.show.web.feed import check_extra

    check_extra("hil-bridge view")
    from hil_bridge.show.web.serving import show

    if file.suffix == RESULTS:
        extension("view-results", "results of campaigns")(file, port)
    elif is_bag(file):
        show(_report_of(file, bag), "table.html", port, click.echo)
    elif file.suffix == RECORDING:
        from hil_bridge.record import read
        from hil_bridge.show.web.recorded import run_source_of

        show(run_source_of(read(file), str(file)), "page.html", port, click.echo)
    else:
        refuse_known_file(file)
        raise ConfigError(
            f"{file} is neither a recording ({RECORDING}), nor results of a campaign ({RESULTS}), nor a ROS 2 bag"
        )


def _save(file: Path, page: Path, overwrite: bool) -> None:
    """Write the page of a recording. Raises ConfigError."""
    from hil_bridge.record import read
    from hil_bridge.record.analysis.summary import summarise
    from hil_bridge.record.files import check_place, write_atomically
    from hil_bridge.show.report import cell_page

    if file.suffix != RECORDING:
        raise ConfigError(f"--save needs the recording of a run ({RECORDING}), got {file}")
    check_place(page, overwrite)
    recording = read(file)
    write_atomically(page, cell_page(recording, summarise(recording)).encode(), overwrite)
    click.echo(page)


def _report_of(file: Path, bag: "BagChoices") -> "Report":
    """Return the report of a bag. Raises ConfigError if the bag cannot be read."""
    from hil_bridge.record.analysis.summary import summarise
    from hil_bridge.record.ros.bag_reader import read_bag
    from hil_bridge.show.report.bag_page import bag_body
    from hil_bridge.show.web.recorded import Report

    recording = read_bag(file, bag)
    assert recording.foreign is not None
    title, body = bag_body(recording, recording.foreign, summarise(recording))
    return Report(title, str(file), body)
