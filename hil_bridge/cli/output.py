"""What a command prints, where the reader may leave before the end, as `| head -1` does."""

import os
import sys
from collections.abc import Iterable

import click


def tell(lines: Iterable[str]) -> None:
    """Print the lines as far as they are read. A reader that has left changes no exit code."""
    try:
        for line in lines:
            click.echo(line)
    except BrokenPipeError:
        # what is still in the buffer would fail once more when the interpreter exits
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)
