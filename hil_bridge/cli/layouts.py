"""`hil-bridge layouts`: panels for the programs that open recordings."""

from pathlib import Path

import click

from hil_bridge.cli.options import overwrite_option
from hil_bridge.cli.paths import FILE


@click.command(short_help="Write layouts for Foxglove, Lichtblick and PlotJuggler.")
@click.option(
    "--out", type=FILE, default=".", metavar="DIR", help="Where to put the files.  [default: this folder]"
)
@overwrite_option
def layouts(out: Path, overwrite: bool) -> None:
    """Write layouts of panels for the programs that open recordings.

    \b
    hil-bridge.foxglove.json     for Foxglove and Lichtblick: force, depth, stiffness, phase,
                                 events, and the tool on the surface in 3-D
    hil-bridge.plotjuggler.xml   for PlotJuggler: force, depth, stiffness

    Open a recording there, then import the layout. The programs show the wall clock: messages are placed by it.
    The times in them are seconds on the run's clock.
    """
    from hil_bridge.record.export.layouts import write

    for place in write(out, overwrite):
        click.echo(f"layout: {place}")
