"""`hil-bridge identify cell`: parameters of a cell identified from a recording, as values and as a configuration."""

from pathlib import Path

import click

from hil_bridge.console.options import echo_json, echo_lines, json_option, output_option, overwrite_option
from hil_bridge.console.paths import FILE
from hil_bridge.errors import ConfigError
from hil_bridge.lab.commands.fidelity import between_option, columns_option, requiring_scipy


@click.command("cell", short_help="Identify latency, noise and contact from a recording.")
@click.argument("recording", type=FILE)
@columns_option
@click.option(
    "--config",
    "config_file",
    type=FILE,
    metavar="CELL.toml",
    help="Device kinds and settings of the cell, for a table.",
)
@between_option
@json_option
@output_option("PROFILE.toml", "Write a configuration that emulates such a cell.")
@overwrite_option
def identify_cell(
    recording: Path,
    columns: Path | None,
    config_file: Path | None,
    between: tuple[float, float] | None,
    as_json: bool,
    out: Path | None,
    overwrite: bool,
) -> None:
    """Identify latency, noise, filter, contact, friction and line errors of a cell from a recording.

    \b
    hil-bridge identify cell site.mcap -o profile.toml
    hil-bridge run profile.toml --virtual

    Each value has a 95 % interval, or the reason why it cannot be identified. RECORDING is a recording of a run, or a
    text table with --columns. No device is opened, and nothing moves.
    """
    with requiring_scipy():
        from hil_bridge.lab.identification.identifying import identify_run, identify_table
        from hil_bridge.lab.identification.profile import profile_text
        from hil_bridge.lab.identification.text import describe
    from hil_bridge.record import read
    from hil_bridge.record.files import check_place, write_atomically

    if out is not None:
        check_place(out, overwrite)
    if columns is not None:
        identified, notes = identify_table(recording, columns, config_file, between)
        for note in notes:
            click.echo(note, err=True)
    elif config_file is not None or between is not None:
        raise ConfigError(
            "--config and --between require a table with --columns; a recording has its own settings"
        )
    else:
        identified = identify_run(read(recording))
    if as_json:
        echo_json({"recording": recording.name, "values": list(identified.values)})
    else:
        echo_lines(describe(identified.values))
    if out is not None:
        write_atomically(out, profile_text(identified, recording.name).encode(), overwrite)
        click.echo(f"wrote {out}", err=as_json)
