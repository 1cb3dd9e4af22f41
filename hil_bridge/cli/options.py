"""Parts that several commands share: an option, and output whose reader may leave before its end."""

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import click

from hil_bridge.cli.paths import FILE

overwrite_option = click.option("--overwrite", is_flag=True, help="Replace files that are there already.")


def output_option(
    metavar: str, meaning: str, default: Path | None = None
) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """The option of the file or the folder that a command writes: `-o`, `--output`, the argument `out`.

    Its spelling before, `--out`, is answered with this one.
    """
    option = click.option(
        "-o",
        "--output",
        "out",
        type=FILE,
        default=default,
        show_default=default is not None,
        metavar=metavar,
        help=meaning,
    )
    before = click.option("--out", "earlier_out", hidden=True, expose_value=False, callback=_refuse_out)
    return lambda command: option(before(command))


def _refuse_out(context: click.Context, parameter: click.Parameter, given: str | None) -> None:
    if given is not None:
        raise click.UsageError(f"--out is -o or --output now: write -o {given}", context)


def tell(lines: Iterable[str]) -> None:
    """Print lines for as long as they are read (`| head`), so that the command still ends with its own exit code."""
    try:
        for line in lines:
            click.echo(line)
    except BrokenPipeError:
        pass
