"""`hil-bridge probe`: what is at the other end, and how it wants to be spoken to."""

from pathlib import Path

import click

from hil_bridge.cli.options import overwrite_option
from hil_bridge.cli.paths import FILE


@click.group(no_args_is_help=False)
def probe() -> None:
    """Find the settings under which a device answers."""


@probe.command(short_help="Find the settings of a controller's link.")
@click.argument("url", metavar="URL")
@click.option(
    "-o",
    "--out",
    type=FILE,
    metavar="FILE",
    help="Write a configuration with the settings that work.",
)
@click.option(
    "--patience",
    "patience_s",
    type=click.FloatRange(min=0.05),
    default=0.7,
    show_default=True,
    metavar="S",
    help="Longest wait for an ACK.",
)
@overwrite_option
def robot(url: str, out: Path | None, patience_s: float, overwrite: bool) -> None:
    """Find rate, parity, length style and doubling of DLE on a controller's link, and the profile that this makes.

    Nothing but read status is sent, so that nothing moves or changes. What the URL says of the line is tried first.
    Exit code 3 when nothing works.
    """
    from hil_bridge.devices.kinds import robot_of
    from hil_bridge.errors import ConfigError
    from hil_bridge.site.s3.probe import probe_robot

    kind, wire = robot_of(url)
    if kind.name != "s3":
        raise ConfigError(f"{url!r}: the settings of a link are found for an s3, not for a {kind.name}")
    probe_robot(wire, out, patience_s, overwrite)


@probe.command(short_help="Show a force sensor, and name its axes by pushes.")
@click.argument("url", metavar="URL")
@click.option(
    "--config", "config_file", type=FILE, metavar="FILE", help="Configuration whose [sensor] is compared."
)
@click.option("--no-push", is_flag=True, help="Ask for no pushes by hand.")
@click.option(
    "--duration",
    "duration_s",
    type=click.FloatRange(min=0.0),
    metavar="S",
    help="Show the wrench for so long.  [default: until Ctrl-C]",
)
def sensor(url: str, config_file: Path | None, no_push: bool, duration_s: float | None) -> None:
    """Show what a force sensor tells of itself, its noise, and its wrench, live.

    On a terminal it asks for a push along +X, +Y and +Z of the tool and names the axis that answers and its sign. Where
    that is not as configured, it says what to set in [sensor]. Nothing is zeroed, nothing moves. URL is that of
    `run --sensor`.
    """
    from hil_bridge.settings.configuration import load_config
    from hil_bridge.site.sensor_probe import probe_sensor

    probe_sensor(url, load_config(config_file, {}), not no_push, duration_s)
