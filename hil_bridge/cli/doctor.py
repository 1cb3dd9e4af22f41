"""`hil-bridge doctor`: check whether this computer is fit for a run."""

import sys
from pathlib import Path

import click

from hil_bridge.console.options import echo_json, json_option
from hil_bridge.console.paths import FILE

EXIT_UNFIT = 3
"""Exit code if something that the configuration names cannot work on this computer."""


@click.command(short_help="Check ports, CAN interfaces, clock and scheduler.")
@click.argument("config_file", metavar="[CONFIG.toml]", required=False, type=FILE)
@click.argument("robot_file", metavar="[RSI.xml]", required=False, type=FILE)
@json_option
def doctor(config_file: Path | None, robot_file: Path | None, as_json: bool) -> None:
    """Check ports, CAN interfaces, clock and scheduler; print one line for each, with what to do about a problem.

    With RSI.xml, the Ethernet configuration of a KUKA controller, it lists the differences from CONFIG.toml.
    With a configuration it also checks the ports that its URLs name; the exit code is 3 when one cannot work. Nothing
    is sent to any device, except requests for the state of a robot that has a second channel, such as web services.
    """
    from hil_bridge.site.doctor import doctor as examine
    from hil_bridge.site.facts import Fact

    facts: list[Fact] = []
    can_work = examine(config_file, say=facts.append if as_json else None, robot_file=robot_file)
    if as_json:
        echo_json({"can_work": can_work, "facts": facts})
    if not can_work:
        sys.exit(EXIT_UNFIT)
