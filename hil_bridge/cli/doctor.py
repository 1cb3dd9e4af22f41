"""`hil-bridge doctor`: is this computer fit for a run."""

import sys
from pathlib import Path

import click

from hil_bridge.console.options import echo_json, json_option
from hil_bridge.console.paths import FILE

EXIT_UNFIT = 3
"""Exit code when something that the configuration names cannot work on this computer."""


@click.command(short_help="Check ports, CAN interfaces, clock and scheduler.")
@click.argument("config_file", metavar="[CONFIG.toml]", required=False, type=FILE)
@click.argument("robot_file", metavar="[RSI.xml]", required=False, type=FILE)
@json_option
def doctor(config_file: Path | None, robot_file: Path | None, as_json: bool) -> None:
    """Tell of ports, CAN interfaces, clock and scheduler what is good, what is not, and what to do: one line each.

    With RSI.xml, the Ethernet configuration of a KUKA controller, it tells where that differs from CONFIG.toml.
    With a configuration it also checks what its URLs name, and ends with exit code 3 when that cannot work. Nothing
    is sent to any device, but four questions to web services that a robot's URL names.
    """
    from hil_bridge.site.doctor import doctor as examine
    from hil_bridge.site.facts import Fact

    facts: list[Fact] = []
    can_work = examine(config_file, say=facts.append if as_json else None, robot_file=robot_file)
    if as_json:
        echo_json({"can_work": can_work, "facts": facts})
    if not can_work:
        sys.exit(EXIT_UNFIT)
