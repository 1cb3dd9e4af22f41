"""Progress of many runs on standard error: a bar on a terminal, otherwise a line from time to time."""

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import TypeAlias

import click
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

LINE_SECONDS = 60.0
"""Time between two lines if standard error is not a terminal, s. Chosen: a log stays short."""

Advance: TypeAlias = Callable[[int, int], None]
"""Callback that receives the number of runs that have ended, and the number of these runs that failed."""


@contextmanager
def run_progress(total: int | None) -> Iterator[Advance]:
    """Display rate, remaining time and failures inside the context. `total` is the number of runs; None if it is
    unknown.
    """
    console = Console(stderr=True)
    began = printed_at = time.monotonic()
    done = failures = 0
    columns = (
        TextColumn("runs"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[rate]}"),
        TextColumn("{task.fields[failed]}"),
        TimeRemainingColumn(),
    )
    with ExitStack() as stack:
        bar = stack.enter_context(Progress(*columns, console=console)) if console.is_terminal else None
        runs = bar.add_task("runs", total=total, rate="", failed="") if bar else None

        def advance(count: int, failed: int) -> None:
            nonlocal done, failures, printed_at
            done, failures = done + count, failures + failed
            now = time.monotonic()
            rate = done / (now - began) if now > began else 0.0
            broken = f"{failures} failed" if failures else ""
            if bar is not None and runs is not None:
                bar.update(runs, advance=count, rate=f"{rate:.1f} runs/s", failed=broken)
            elif now >= printed_at + LINE_SECONDS:
                printed_at = now
                click.echo(_line(done, total, rate, broken), err=True)

        yield advance


def _line(done: int, total: int | None, rate: float, broken: str) -> str:
    if total is None:
        return f"{done} runs, {rate:.1f} runs/s{f', {broken}' if broken else ''}"
    left = f", {(total - done) / rate / 60.0:.0f} min left" if rate else ""
    return f"{done} of {total} runs, {rate:.1f} runs/s{left}{f', {broken}' if broken else ''}"
