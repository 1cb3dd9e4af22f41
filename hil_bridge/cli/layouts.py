"""`hil-bridge layouts`: panels for the programs that open recordings."""

from pathlib import Path

import click

from hil_bridge.console.options import output_option, overwrite_option


@click.command(short_help="Write layouts for Foxglove, Lichtblick and PlotJuggler.")
@output_option("DIR", "Where to put the files.", Path("."))
@overwrite_option
def layouts(out: Path, overwrite: bool) -> None:
    """Write layouts of panels for the programs that open recordings.

    \b
    hil-bridge.foxglove.json          for Foxglove and Lichtblick: force, depth, stiffness, phase,
                                      events, and the tool on the surface in 3-D
    hil-bridge.plotjuggler.xml        for PlotJuggler: force, depth, stiffness
    hil-bridge.ros2-foxglove.json     for messages of ROS 2: contact force, moment, height,
                                      events, and the frames in 3-D
    hil-bridge.ros2-plotjuggler.xml   the same for PlotJuggler: contact force, moment, height

    Open a recording there, its bag of ROS 2 or a run that goes on, then import the layout. The programs show the wall
    clock: messages are placed by it. The times in them are seconds on the run's clock.
    """
    from hil_bridge.record.export.layouts import write

    for place in write(out, overwrite):
        click.echo(f"layout: {place}")
