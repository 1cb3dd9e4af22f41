"""`hil-bridge doctor`: is this computer fit for a run."""

import sys
from pathlib import Path

import click

from hil_bridge.cli.paths import FILE

EXIT_UNFIT = 3
"""Exit code when something that the configuration names cannot work on this computer."""


@click.command(short_help="Check ports, CAN interfaces, clock, scheduler.")
@click.argument("config_file", metavar="[CONFIG.toml]", required=False, type=FILE)
def doctor(config_file: Path | None) -> None:
    """Tell of ports, CAN interfaces, clock and scheduler what is good, what is not, and what to do: one line each.

    With a configuration it also checks what its URLs name, and ends with exit code 3 when that cannot work. Nothing
    is sent to any device, but four questions to web services that a robot's URL names.
    """
    from hil_bridge.site.doctor import doctor as examine

    if not examine(config_file):
        sys.exit(EXIT_UNFIT)
