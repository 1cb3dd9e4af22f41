"""`hil-bridge identify fidelity`: deviation of an emulated device from a measured one."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from hil_bridge.cli.bag_options import bag_options
from hil_bridge.console.options import echo_json, echo_lines, json_option, overwrite_option
from hil_bridge.console.paths import FILE
from hil_bridge.errors import ConfigError
from hil_bridge.errors.extras import install_command

if TYPE_CHECKING:
    from hil_bridge.record.foreign import BagChoices


columns_option = click.option(
    "--columns",
    type=FILE,
    metavar="MAPPING.toml",
    help="Quantity and unit of each column of a table.",
)
between_option = click.option(
    "--between",
    type=float,
    nargs=2,
    metavar="BEGIN END",
    help="Interval of the data, s from its first sample.  [default: all]",
)


@contextmanager
def requiring_scipy() -> Iterator[None]:
    """Convert a failed import of SciPy in the context to a ConfigError with the command that installs SciPy."""
    try:
        yield
    except ImportError as error:
        if not str(error.name).startswith("scipy"):
            raise
        raise ConfigError(f"this needs the package scipy; {install_command('fidelity')}") from error


@click.command(short_help="Compare an emulated device with a measured one.")
@click.argument("recording", type=FILE)
@click.option(
    "--as", "kind", required=True, metavar="KIND", help="Kind of the emulated robot or sensor, or contact."
)
@columns_option
@click.option(
    "--config",
    "config_file",
    type=FILE,
    metavar="CELL.toml",
    help="Settings of the emulated device, over those of a recorded run.",
)
@between_option
@click.option("--seed", type=int, help="Seed of every random draw in the device.")
@json_option
@click.option(
    "--page", type=FILE, metavar="FILE.html", help="Write a page that plots measured and emulated data."
)
@overwrite_option
@bag_options
def fidelity(
    recording: Path,
    kind: str,
    columns: Path | None,
    config_file: Path | None,
    between: tuple[float, float] | None,
    seed: int | None,
    as_json: bool,
    page: Path | None,
    overwrite: bool,
    bag: "BagChoices",
) -> None:
    """Replay the inputs of a recording to an emulated device, and compare its output with the measured data.

    \b
    hil-bridge identify fidelity run.mcap --as rsi
    hil-bridge identify fidelity log.csv --columns log.toml --config cell.toml --as rtde --page log.html

    RECORDING is a recording of a run, a text table with --columns, or a ROS 2 bag. The device runs in virtual time,
    over the bytes of its protocol; no real device is opened.
    """
    with requiring_scipy():
        from hil_bridge.lab.fidelity.subjects import compare_with, read
        from hil_bridge.lab.fidelity.text import describe
    from hil_bridge.record.files import check_place, write_atomically

    if page is not None:
        check_place(page, overwrite)
    measured = read(recording, columns, kind, bag)
    for note in measured.table.notes:
        click.echo(note, err=True)
    if between is not None:
        measured = measured._replace(table=measured.table.between(*between))
    compared = compare_with(kind, measured, config_file, seed)
    if page is not None:
        from hil_bridge.lab.fidelity.page import fidelity_page

        write_atomically(page, fidelity_page(recording.name, compared).encode(), overwrite)
    if as_json:
        echo_json(compared.comparison)
    else:
        echo_lines(describe(compared.comparison))
    if page is not None:
        click.echo(page, err=as_json)
