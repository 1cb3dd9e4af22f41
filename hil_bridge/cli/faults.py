"""`hil-bridge faults`: everything that can be made to go wrong in the emulated cell."""

import click


@click.command(short_help="List what can be made to go wrong in the emulated cell.")
@click.option("--json", "as_json", is_flag=True, help="Print the list as JSON.")
def faults(as_json: bool) -> None:
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

    from emulators.cell_faults import CELL_FAULTS
    from emulators.s3.panel import fault_table
    from hil_bridge.robots.s3.panel import faults_text

    table = fault_table(CELL_FAULTS)
    click.echo(json.dumps(table, ensure_ascii=False, indent=2) if as_json else faults_text(table))
