"""Rows of a monitor on a terminal, and the end of the monitor by a signal or by the end of its wire."""

import asyncio
import math
import signal
from collections.abc import Mapping
from contextlib import suppress
from functools import partial
from typing import NamedTuple

import click

from hil_bridge.clock import Clock
from hil_bridge.errors import TransportError
from hil_bridge.errors.text_files import harmless


class Row(NamedTuple):
    """Row of a monitor's output."""

    at: float
    """Time, s; NaN if unknown."""
    direction: str
    text: str
    data: bytes = b""
    """Bytes of the row, printed on request."""
    trouble: bool = False
    line_time: float | None = None
    """Duration of the bytes on the line, s; None if unknown."""


class Printer:
    """Printer of rows, with their times since the first row and since the previous row."""

    def __init__(self, raw: bool, begun: float | None = None) -> None:
        self._raw = raw
        self._begun = begun
        self._before = begun

    def row(self, row: Row) -> None:
        """Print a row: time, time since the previous row, direction, line time, text."""
        self._begun = row.at if self._begun is None else self._begun
        since = row.at - (row.at if self._before is None else self._before)
        self._before = row.at
        took = "" if row.line_time is None else f"{row.line_time * 1e3:.1f} ms"
        times = f"{row.at - self._begun:12.6f} {since:+10.6f}"
        if math.isnan(row.at):
            times = f"{'-':>12} {'-':>10}"
        times += f" {row.direction:<6} {took:>8}"
        hexed = f"  {{{row.data.hex(' ').upper()}}}" if self._raw and row.data else ""
        click.echo(f"{times} {'!' if row.trouble else ' '} {harmless(row.text)}{hexed}")


def field_text(field: Mapping[str, object], zeros: bool = False) -> str:
    """Return name, value and unit of a decoded field. Return "" for a field that is 0, unless `zeros` is set."""
    name, value, unit = str(field["name"]), field["value"], str(field["unit"])
    if isinstance(value, (int, float)):
        if not value and not zeros:
            return ""
        value = f"{value:.7g}" if isinstance(value, float) else f"{value:d}"
    return " ".join(filter(None, (name.replace("_", " "), str(value), unit)))


def end(ended: "asyncio.Future[None]", cause: TransportError | None = None) -> None:
    """End a monitor. If its wire has failed, print the cause."""
    if ended.done():
        return
    if cause is None:
        ended.set_result(None)
    else:
        ended.set_exception(cause)


def stop_on_signals(clock: Clock, ended: "asyncio.Future[None]") -> None:
    """Let SIGINT and SIGTERM end a monitor."""
    with suppress(NotImplementedError):  # no signal handlers in loops of other platforms
        for number in (signal.SIGINT, signal.SIGTERM):
            clock.loop.add_signal_handler(number, partial(end, ended))
