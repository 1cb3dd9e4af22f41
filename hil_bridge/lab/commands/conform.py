"""`hil-bridge conform`: a client of a robot or a sensor in any language, judged against the emulated device."""

from pathlib import Path

import click

from hil_bridge.cli.completion import complete, robots, sensors
from hil_bridge.console.options import overwrite_option, tell
from hil_bridge.console.paths import FILE

FAILED = 4
"""Exit code when a scenario failed."""


def _kinds() -> list[str]:
    """Return the kinds of robots and sensors."""
    return [*robots(), *sensors()]


def _complete_scenarios(context: click.Context, parameter: click.Parameter, begun: str) -> list[str]:
    """Complete the names of the scenarios that the kind of device in the command line has."""

    def names() -> list[str]:
        from hil_bridge.lab.conform.trying import cell_of, make_trial, rules_of

        kind = context.args[0]  # the option lacks its value, so click has not assigned the arguments
        return [*make_trial(cell_of(kind, None), rules_of(kind)(), ()).scenarios]

    return complete(names)(context, parameter, begun)


@click.command(short_help="Test a client of a robot or a sensor.", options_metavar="[OPTIONS]")
@click.argument("kind", shell_complete=complete(_kinds))
@click.argument("command", nargs=-1, metavar="-- COMMAND…")
@click.option(
    "--config", "config_file", type=FILE, metavar="CONFIG.toml", help="Settings of the emulated cell."
)
@click.option(
    "--listen",
    metavar="URL",
    help="Where the device listens, as rtde+tcp-listen://127.0.0.2.  [default: free ports, or the device's own]",
)
@click.option(
    "--only",
    multiple=True,
    metavar="SCENARIO",
    shell_complete=_complete_scenarios,
    help="Play this scenario alone. Repeatable.",
)
@click.option("--set", "settings", multiple=True, metavar="NAME=VALUE", help="A rule, as react_s=0.2.")
@click.option("--comes-back", is_flag=True, help="The client declares that it comes back behind a cut wire.")
@click.option("--ends", is_flag=True, help="A robot's client declares that it ends by itself.")
@click.option(
    "--takes-zero",
    is_flag=True,
    help="A sensor's client declares that it takes the load at its start as zero.",
)
@click.option("--junit", type=FILE, metavar="FILE.xml", help="Write the verdicts as JUnit XML.")
@click.option("--json", "json_file", type=FILE, metavar="FILE.json", help="Write verdicts and evidence.")
@click.option("--rules", "show_rules", is_flag=True, help="Show the rules and their defaults, play nothing.")
@overwrite_option
def conform(
    kind: str,
    command: tuple[str, ...],
    config_file: Path | None,
    listen: str | None,
    only: tuple[str, ...],
    settings: tuple[str, ...],
    comes_back: bool,
    ends: bool,
    takes_zero: bool,
    junit: Path | None,
    json_file: Path | None,
    show_rules: bool,
    overwrite: bool,
) -> None:
    """Judge a client of a robot or a force sensor: hil-bridge conform rtde -- ./my_client {host} {port}

    Each scenario has a fresh emulated device of KIND, in real time on this computer, and a fresh process of the client.
    The verdict goes by what a robot saw, not by what the client says. A sensor's client writes one line with six
    numbers for each reading: fx fy fz in N, mx my mz in N·m, in the sensor's frame.

    \b
    The client finds the device by its arguments or its environment:
      {url} {host} {port}       HIL_BRIDGE_URL HIL_BRIDGE_HOST HIL_BRIDGE_PORT
      rtde: {dashboard} {script}  HIL_BRIDGE_DASHBOARD HIL_BRIDGE_SCRIPT
      netft: {http_port}          HIL_BRIDGE_HTTP_PORT
      s3, ft300: {device}         HIL_BRIDGE_DEVICE, a pseudo-terminal

    Exit codes: 0 none failed, 2 wrong input, 3 the emulator or its port, 4 a scenario failed, 130 interrupted.
    """
    from hil_bridge.lab.conform.reports import as_json, as_junit, lateness, not_modelled, table, totals
    from hil_bridge.lab.conform.rules import describe_rules, read_rules
    from hil_bridge.lab.conform.trial import choose_scenarios
    from hil_bridge.lab.conform.trying import cell_of, make_trial, play_all, rules_of
    from hil_bridge.lab.conform.verdict import Outcome
    from hil_bridge.record.files import check_place, write_whole
    from hil_bridge.runs.signals import as_ctrl_c

    rules = read_rules(rules_of(kind), settings, comes_back=comes_back, ends=ends, takes_zero=takes_zero)
    if show_rules:
        tell(describe_rules(rules))
        return
    if not command:
        raise click.UsageError("name the client's command behind --")
    for place in (junit, json_file):
        if place is not None:
            check_place(place, overwrite)
    trial = make_trial(cell_of(kind, config_file), rules, command, listen)
    names = choose_scenarios(trial, only)
    with as_ctrl_c():
        played = play_all(trial, names, lambda text: click.echo(text, err=True))
    if junit is not None:
        write_whole(junit, as_junit(kind, played), overwrite)
    if json_file is not None:
        write_whole(json_file, as_json((trial.thing, kind), command, rules, played).encode(), overwrite)
    tell([*table(played), totals(played), *lateness(played), *not_modelled(played)])
    if any(one.verdict.outcome is Outcome.FAILED for one in played):
        click.get_current_context().exit(FAILED)
