"""`hil-bridge faults`: everything that can be made to go wrong in the emulated cell."""

import click

from hil_bridge.cli.completion import complete, robots, sensors, surfaces


@click.command(short_help="List what can be made to go wrong in the emulated cell.")
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
@click.option(
    "--surface",
    metavar="KIND",
    shell_complete=complete(surfaces),
    default="",
    help="Kind of the emulated surface: soft-body, or one from a plug-in.",
)
@click.option("--json", "as_json", is_flag=True, help="Print the list as JSON.")
def faults(robot: str, sensor: str, surface: str, as_json: bool) -> None:
    """List every fault of the emulated cell by target, with its parameters, defaults and ranges.

    A configuration injects one with a table [[faults]], a person with `hil-bridge panel URL inject`:

    \b
      [[faults]]
      on = "signal"
      fault = "scale"
      phase = "track"
      after_s = 2.0
      for_s = 3.0
      with = { axis = "fz", factor = 0.1 }
    """
    import json

    from emulators.faults import describe_faults
    from hil_bridge.devices.kinds import EmulatedKinds
    from hil_bridge.devices.panel import faults_text

    table = describe_faults(EmulatedKinds.named(robot, sensor, surface).faults)
    click.echo(json.dumps(table, ensure_ascii=False, indent=2) if as_json else faults_text(table))
