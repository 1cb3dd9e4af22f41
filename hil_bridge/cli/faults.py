"""`hil-bridge list faults`: list every fault that can be injected into the emulated cell."""

import click

from hil_bridge.cli.completion import complete, robots, sensors
from hil_bridge.cli.devices import surface_option
from hil_bridge.console.options import echo_json, json_option


@click.command(short_help="List the faults of an emulated cell.")
@click.option(
    "--robot",
    metavar="KIND",
    shell_complete=complete(robots),
    default="s3",
    show_default=True,
    help="Kind of the emulated robot.",
)
@click.option(
    "--sensor",
    metavar="KIND",
    shell_complete=complete(sensors),
    default="jr3",
    show_default=True,
    help="Kind of the emulated sensor.",
)
@surface_option
@json_option
def faults(robot: str, sensor: str, surface: str | None, as_json: bool) -> None:
    """List every fault of the emulated cell by target, with its parameters, defaults and ranges.

    Inject one with a table [[faults]] of the configuration, or by hand with `hil-bridge panel URL inject`:

    \b
      [[faults]]
      on = "signal"
      fault = "scale"
      phase = "track"
      after_s = 2.0
      for_s = 3.0
      with = { axis = "fz", factor = 0.1 }
    """
    from emulators.faults import describe_faults
    from hil_bridge.devices.kinds import EmulatedKinds
    from hil_bridge.devices.panel import faults_text

    table = describe_faults(EmulatedKinds.named(robot, sensor, surface or "").faults)
    if as_json:
        echo_json(table)
    else:
        click.echo(faults_text(table))
