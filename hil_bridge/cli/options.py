"""Parts that several commands share: an option, and output whose reader may leave before its end."""

from collections.abc import Iterable

import click

overwrite_option = click.option("--overwrite", is_flag=True, help="Replace files that are there already.")


def tell(lines: Iterable[str]) -> None:
    """Print lines for as long as they are read (`| head`), so that the command still ends with its own exit code."""
    try:
        for line in lines:
            click.echo(line)
    except BrokenPipeError:
        pass
