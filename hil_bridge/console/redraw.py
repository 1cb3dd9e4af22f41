"""Text that is redrawn on a terminal until interrupted."""

import time
from collections.abc import Callable
from contextlib import suppress

import click
from rich.console import Console
from rich.live import Live
from rich.text import Text


def redraw_until_interrupted(make: Callable[[], str], every_s: float) -> None:
    """Display the text that `make` returns, every `every_s` seconds, until Ctrl-C. If the output cannot be redrawn,
    print each text that differs from the previous one.
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
