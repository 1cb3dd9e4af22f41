"""A text that is shown again and again on a terminal, until an operator ends it."""

import time
from collections.abc import Callable
from contextlib import suppress

import click
from rich.console import Console
from rich.live import Live
from rich.text import Text


def redraw_until_interrupted(make: Callable[[], str], every_s: float) -> None:
    """Show the text that `make` gives, every so many seconds, until Ctrl-C. Where nothing can be redrawn, each text
    that differs from the one before is printed.
    """
    console = Console(highlight=False)
    with suppress(KeyboardInterrupt):
        if console.is_terminal and not console.is_dumb_terminal:
            with Live(Text(make()), console=console, auto_refresh=False) as live:
                while True:
                    live.update(Text(make()), refresh=True)
                    time.sleep(every_s)
        before = ""
        while True:
            if (text := make()) != before:
                click.echo(f"{text}\n")
                before = text
            time.sleep(every_s)
