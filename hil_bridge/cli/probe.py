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
    """Find rate, parity, length style and doubling of DLE on a controller's link.

    Nothing but read status is sent, so that nothing moves or changes. What the URL says of the line is tried first.
    Exit code 3 when nothing works.
    """
    from hil_bridge.site.probe import probe_robot

    probe_robot(url, out, patience_s, overwrite)
