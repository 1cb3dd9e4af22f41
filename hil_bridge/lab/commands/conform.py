"""`hil-bridge conform`: conformance tests of a robot or sensor client in any language, against the emulated device."""

from pathlib import Path

import click

from hil_bridge.cli.completion import complete, robots, sensors
from hil_bridge.console.options import echo_lines, overwrite_option
from hil_bridge.console.paths import FILE

FAILED = 4
"""Exit code if a scenario failed."""


def _kinds() -> list[str]:
    """Return the kinds of robots and sensors."""
    return [*robots(), *sensors()]


def _complete_scenarios(context: click.Context, parameter: click.Parameter, begun: str) -> list[str]:
    """Return the scenario names of the device kind in the command line, for shell completion."""

    def names() -> list[str]:
        from hil_bridge.lab.conform.real_time import cell_of, make_trial, rules_of

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
    help="Address on which the device listens, such as rtde+tcp-listen://127.0.0.2.  "
    "[default: free ports, or the device's own]",
)
@click.option(
    "--only",
    multiple=True,
    metavar="SCENARIO",
    shell_complete=_complete_scenarios,
    help="Run this scenario only. Repeatable.",
)
@click.option("--set", "settings", multiple=True, metavar="NAME=VALUE", help="A rule, such as react_s=0.2.")
@click.option("--comes-back", is_flag=True, help="The client reconnects after a lost connection.")
@click.option("--ends", is_flag=True, help="The robot client ends by itself.")
@click.option(
    "--takes-zero",
    is_flag=True,
    help="The sensor client takes the load at its start as zero.",
)
@click.option("--junit", type=FILE, metavar="FILE.xml", help="Write the verdicts as JUnit XML.")
@click.option("--json", "json_file", type=FILE, metavar="FILE.json", help="Write verdicts and evidence.")
@click.option("--page", type=FILE, metavar="FILE.html", help="Write a page with a time line of each failure.")
@click.option("--rules", "show_rules", is_flag=True, help="Print the rules and their defaults, and exit.")
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
    page: Path | None,
    show_rules: bool,
    overwrite: bool,
) -> None:
    """Test a client of a robot or a force sensor: hil-bridge conform rtde -- ./my_client {host} {port}

    Each scenario has a fresh emulated device of KIND, in real time on this computer, and a fresh client process. A
    robot client is judged by what the robot received, not by what the client reports. A sensor client writes one line
    of six numbers for each reading: fx fy fz in N, mx my mz in N·m, in the sensor's frame.

    \b
    The client gets the address of the device from its arguments or its environment:
      {url} {host} {port}       HIL_BRIDGE_URL HIL_BRIDGE_HOST HIL_BRIDGE_PORT
      rtde: {dashboard} {script}  HIL_BRIDGE_DASHBOARD HIL_BRIDGE_SCRIPT
      netft: {http_port}          HIL_BRIDGE_HTTP_PORT
      s3, ft300: {device}         HIL_BRIDGE_DEVICE, a pseudo-terminal

    Exit codes: 0 no scenario failed, 2 invalid input, 3 the emulator or its port failed, 4 a scenario failed,
    130 interrupted.
    """
    from hil_bridge.lab.conform.real_time import cell_of, make_trial, play_all, rules_of
    from hil_bridge.lab.conform.reports import as_json, as_junit, lateness, not_modelled, table, totals
    from hil_bridge.lab.conform.rules import describe_rules, read_rules
    from hil_bridge.lab.conform.trial import choose_scenarios
    from hil_bridge.lab.conform.verdict import Outcome
    from hil_bridge.record.files import check_place, write_atomically
    from hil_bridge.runs.signals import as_ctrl_c

    rules = read_rules(rules_of(kind), settings, comes_back=comes_back, ends=ends, takes_zero=takes_zero)
    if show_rules:
        echo_lines(describe_rules(rules))
        return
    if not command:
        raise click.UsageError("the client's command is missing; give it after --")
    for place in (junit, json_file, page):
        if place is not None:
            check_place(place, overwrite)
    trial = make_trial(cell_of(kind, config_file), rules, command, listen)
    names = choose_scenarios(trial, only)
    with as_ctrl_c():
        results = play_all(trial, names, lambda text: click.echo(text, err=True))
    if junit is not None:
        write_atomically(junit, as_junit(kind, results), overwrite)
    if json_file is not None:
        write_atomically(json_file, as_json((trial.thing, kind), command, rules, results).encode(), overwrite)
    if page is not None:
        from hil_bridge.clock.clock import wall_time
        from hil_bridge.lab.conform.page import conform_page

        options = (("--config", config_file), ("--listen", listen))
        client = [str(word) for option in options if option[1] for word in option]
        text = conform_page(trial, results, [*client, "--", *command], wall_time())
        write_atomically(page, text.encode(), overwrite)
    echo_lines([*table(results), totals(results), *lateness(results), *not_modelled(results)])
    if any(one.verdict.outcome is Outcome.FAILED for one in results):
        click.get_current_context().exit(FAILED)
