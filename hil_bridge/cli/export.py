"""`hil-bridge export`: write a recording in the formats of other programs."""

from pathlib import Path

import click

from hil_bridge.console.options import ExtrasCommand, output_option, overwrite_option
from hil_bridge.console.paths import FILE

FORMAT_NAMES = ("candump", "blf", "asc", "dbc", "bytes", "csv", "parquet", "rosbag2", "mf4", "layouts")


def _formats(_context: click.Context, _parameter: click.Parameter, given: str) -> tuple[str, ...]:
    """Split a comma-separated list of format names."""
    names = tuple(name.strip() for name in given.split(",")) if given else ()
    for name in names:
        if name not in FORMAT_NAMES:
            raise click.BadParameter(f"{name!r} is not a format; choose from {','.join(FORMAT_NAMES)}")
    return names


@click.command(
    cls=ExtrasCommand,
    extras={"parquet": "parquet", "rosbag2": "ros", "mf4": "mdf"},
    short_help="Export a recording to CAN logs, tables and others.",
)
@click.argument("recording", type=FILE)
@click.option(
    "--to",
    "formats",
    callback=_formats,
    default="",
    metavar="FORMAT,…",
    help=f"{', '.join(FORMAT_NAMES)}.  [default: all that the recording has data for, "
    "except dbc, parquet, rosbag2, mf4 and layouts]",
)
@output_option("DIR", "Folder for the files.  [default: that of the recording]")
@click.option(
    "--channel", default="can0", metavar="NAME", help="CAN interface in candump's text.  [default: can0]"
)
@click.option(
    "--epoch",
    type=click.FloatRange(0, 2e9),
    metavar="SECONDS",
    help="Time stamp of the start of the run in a ROS 2 bag.  [default: UNIX time of the recording]",
)
@overwrite_option
def export(
    recording: Path,
    formats: tuple[str, ...],
    out: Path | None,
    channel: str,
    epoch: float | None,
    overwrite: bool,
) -> None:
    """Write a recording in the formats of other programs, under its own name.

    \b
    candump  .log          frames of a CAN sensor, for can-utils; UNIX time
    blf      .blf          the same for Vector's tools; UNIX time
    asc      .asc          the same as text; seconds since the first frame
    dbc      .dbc          layout of these frames, for tools that decode them
    bytes    .robot.txt    bytes of the robot's wire, for `hil-bridge monitor`; run's clock
             .sensor.txt   bytes of the sensor's wire, where that is not CAN; run's clock
    csv      .cycle.csv    every control cycle; run's clock
             .sensor.csv   every frame of the sensor, in N and N·m and raw; run's clock
    parquet  .parquet      the same tables; needs an extra
    rosbag2  .rosbag2/     a ROS 2 bag, written without ROS; UNIX time, or from --epoch;
                           needs an extra
    mf4      .mf4          an ASAM measurement file with units, comments, events; run's clock;
                           needs an extra
    layouts  .foxglove.json .plotjuggler.xml .ros2-foxglove.json .ros2-plotjuggler.xml
                           panels to import into Foxglove, Lichtblick and PlotJuggler: force,
                           depth, stiffness, events, frames in 3-D; ros2- for messages of ROS 2

    The last line is the UNIX time at which the run's clock was 0. `canplayer -I run.log vcan0=can0` replays the CAN
    frames. Existing files are kept unless --overwrite is given.
    """
    from hil_bridge.errors import ConfigError
    from hil_bridge.record.export import Choices
    from hil_bridge.record.export import export as write

    if not channel.isascii() or not channel.isprintable() or not channel or " " in channel:
        raise ConfigError(f"--channel {channel!r} is not the name of a CAN interface; give one such as can0")
    choices = Choices(channel, epoch)
    for line in write(recording, formats, recording.parent if out is None else out, overwrite, choices):
        click.echo(line)
