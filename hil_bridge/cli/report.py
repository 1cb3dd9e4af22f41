"""`hil-bridge report`: write a page with charts for a recording."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from hil_bridge.cli.bag_options import bag_options
from hil_bridge.console.options import ExtrasCommand, output_option, overwrite_option
from hil_bridge.console.paths import FILE

if TYPE_CHECKING:
    from hil_bridge.record.foreign import BagChoices


@click.command(
    cls=ExtrasCommand,
    extras={"pictures": "figures", "bags of ROS 2": "ros"},
    short_help="Make a page with charts from a recording.",
)
@click.argument("recording", type=FILE)
@output_option("DIR", "Folder for the page.  [default: that of the recording]")
@click.option("--png", is_flag=True, help="Also write a picture, report.png.")
@click.option("--pdf", is_flag=True, help="Also write the picture as report.pdf.")
@overwrite_option
@bag_options
def report(
    recording: Path, out: Path | None, png: bool, pdf: bool, overwrite: bool, bag: "BagChoices"
) -> None:
    """Make report.html from a recording: one file with zoomable charts, which works offline.

    RECORDING may be a ROS 2 bag with a WrenchStamped and a PoseStamped: its folder, or an MCAP file. That needs the
    extra ros, and the pictures need matplotlib.
    """
    from hil_bridge.record.analysis.summary import summarise
    from hil_bridge.record.ros.bag_reader import read_any
    from hil_bridge.show.report import write_report

    record = read_any(recording, bag)
    pictures = [kind for kind, chosen in (("png", png), ("pdf", pdf)) if chosen]
    page = write_report(record, summarise(record), out or recording.parent, overwrite, pictures)
    click.echo(page)
