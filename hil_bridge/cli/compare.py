"""`hil-bridge compare`: several recordings on one page."""

from pathlib import Path

import click

from hil_bridge.cli.options import overwrite_option
from hil_bridge.cli.paths import FILE


@click.command(short_help="Lay runs over each other on one page.")
@click.argument("recordings", metavar="A B …", nargs=-1, required=True, type=FILE)
@click.option(
    "--out", type=FILE, metavar="FILE.html", default=Path("compare.html"), show_default=True, help="The page."
)
@click.option(
    "--align",
    type=click.Choice(("touch", "begin")),
    default="touch",
    show_default=True,
    help="What all runs have at 0 s: the first touch, or the start of the run.",
)
@overwrite_option
def compare(recordings: tuple[Path, ...], out: Path, align: str, overwrite: bool) -> None:
    """Draw forces, motion and times of 2 to 8 recordings over each other, and tell which settings and figures differ.

    The page needs no network. Each run can be switched off and on.
    """
    from hil_bridge.record import read
    from hil_bridge.record.files import check_place, write_whole
    from hil_bridge.show.report.compare import compare_page, names_of

    check_place(out, overwrite)
    names = names_of(recordings)
    page = compare_page({name: read(path) for name, path in zip(names, recordings, strict=True)}, align)
    write_whole(out, page.encode(), overwrite)
    click.echo(out)
